"""A COLMAP project, read back by its format page, and by COLMAP's own reader where that is there."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from colmap_model import projected, read_model
from flown_folder import FRAMES, LOOKING_EAST, LOOKING_NORTH, RED, STEP_M, WALL_M, pose, write_flown
from output_samples import HEIGHT, SOURCE, WIDTH

from flightdepth.camera import Camera
from flightdepth.commands.demo import VIDEO
from flightdepth.errors import BadInput
from flightdepth.outputs import colmap
from flightdepth.outputs.cloud import CloudSettings, cloud_of
from flightdepth.outputs.colmap import every_picture, millimetres, shuffled, usable_depth, write_colmap
from flightdepth.outputs.pictures import pictures
from flightdepth.outputs.video_pictures import video_pictures
from flightdepth.runtimes.lens import pixel_rays

EVERY = CloudSettings(every=1, voxel_m=0.5)
BARREL = Camera(WIDTH, HEIGHT, 60, 58, 44, 33, (-0.2, 0.03, 0.001, 0.002, 0.01))
FISHEYE = Camera(WIDTH, HEIGHT, 50, 50, 47, 30, (0.02, -0.01, 0, 0), "fisheye")


def project(tmp_path, settings=EVERY, **options):
    """The folder of a project, and its model."""
    flight, folder = write_flown(tmp_path / "out", **options), tmp_path / "flight.colmap"
    folder.mkdir()
    write_colmap(folder, flight, cloud_of(flight, settings), pictures(flight), settings=settings)
    return folder, read_model(folder / "sparse" / "0")


def stored_m(folder, image):
    """What `depths` says of a picture, metres [H, W], 0 = unknown; as Nerfstudio reads it."""
    return cv2.imread(str(folder / "depths" / f"{image.name[:-4]}.png"), cv2.IMREAD_UNCHANGED) * 1e-3


@pytest.mark.parametrize("camera", [SOURCE.camera, BARREL, FISHEYE], ids=["ideal", "barrel", "fisheye"])
def test_points_fall_where_their_pictures_list_them_as_deep_as_their_depth(tmp_path, camera):
    folder, model = project(tmp_path, camera=camera)
    assert len(model.images) == FRAMES - 1
    listed = 0
    for number, image in model.images.items():
        rows = image.seen[:, 2].astype(int)
        pixels, there_m = projected(
            model, image, np.array([model.points[row].xyz for row in rows]).reshape(-1, 3)
        )
        assert pixels == pytest.approx(image.seen[:, :2], abs=1e-6)
        columns, lines = np.floor(pixels).astype(int).T  # COLMAP's first pixel is from 0 to 1
        assert stored_m(folder, image)[lines, columns] == pytest.approx(there_m, rel=0.01)
        assert [(number, place) in model.points[row].track for place, row in enumerate(rows)] == [True] * len(
            rows
        )
        listed += len(rows)
    assert listed == sum(len(point.track) for point in model.points.values()) > 1000


@pytest.mark.parametrize("camera", [SOURCE.camera, BARREL, FISHEYE], ids=["ideal", "barrel", "fisheye"])
def test_depth_through_cameras_and_poses_is_the_wall(tmp_path, camera):
    folder, model = project(tmp_path, camera=camera)
    for image in model.images.values():
        fx, fy, cx, cy = model.cameras[image.camera][3]
        depth_m = stored_m(folder, image)
        lines, columns = np.nonzero(depth_m)
        assert len(lines) > 0.9 * depth_m.size
        rays = np.stack([(columns + 0.5 - cx) / fx, (lines + 0.5 - cy) / fy, np.ones(len(lines))], axis=1)
        points = (rays * depth_m[lines, columns, None]) @ image.camera_from_world + image.place
        assert points[:, 1] == pytest.approx(WALL_M, abs=0.02)  # y is north


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_depth_is_undistorted_as_its_picture_is(tmp_path, monkeypatch, camera):
    """A wall looks the same through any lens: here depth grows to the right."""

    def slanted_m(x):
        return WALL_M * (1 + 0.2 * x)

    filmed_m = slanted_m(pixel_rays(camera, 1)[..., 0]).astype(np.float32)
    monkeypatch.setattr(colmap, "usable_depth", lambda *_: filmed_m)
    folder, model = project(tmp_path, camera=camera)
    ((_, width, height, (fx, _, cx, _)),) = model.cameras.values()
    true_m = np.broadcast_to(slanted_m((np.arange(width) + 0.5 - cx) / fx), (height, width))
    stored = stored_m(folder, next(iter(model.images.values())))
    assert stored == pytest.approx(
        true_m, rel=0.4 / fx
    )  # but for half a pixel as filmed, at the rim of a fisheye wide
    assert filmed_m != pytest.approx(true_m, rel=0.8 / fx)


def test_the_principal_point_counts_from_the_corner(tmp_path):
    """COLMAP's 0, 0 is the picture's corner, OpenCV's the first pixel's centre: half a pixel between them."""
    lens = Camera(WIDTH, HEIGHT, 60, 61, 40, 35)
    _, model = project(tmp_path, camera=lens)
    assert model.cameras == {1: ("PINHOLE", WIDTH, HEIGHT, (60, 61, 40.5, 35.5))}


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_other_lenses_are_pinholes_whose_axis_is_the_middle(tmp_path, camera):
    """Some trainers know no other lens, and no principal point."""
    _, model = project(tmp_path, camera=camera)
    ((kind, width, height, (_, _, cx, cy)),) = model.cameras.values()
    assert (kind, width, height, cx, cy) == ("PINHOLE", WIDTH, HEIGHT, WIDTH / 2, HEIGHT / 2)


NORTHWARDS = [
    [1, 0, 0],
    [0, 0, -1],
    [0, 1, 0],
]  # a camera's axes, right, down and forward, in east, north, up
EASTWARDS = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]


@pytest.mark.parametrize(
    ("looks", "at_ned", "step_ned", "axes"),
    [
        (LOOKING_NORTH, (1, 2, -3), (STEP_M, 0, 0), NORTHWARDS),
        (LOOKING_EAST, (1, 2, -3), (0, STEP_M, 0), EASTWARDS),
    ],
    ids=["north", "east"],
)
def test_the_world_is_east_north_up(tmp_path, looks, at_ned, step_ned, axes):
    places = np.array(at_ned) + np.arange(FRAMES)[:, None] * np.array(step_ned)
    poses = [
        replace(pose(i, 0), position_ned=place, world_from_camera=looks) for i, place in enumerate(places)
    ]
    _, model = project(tmp_path, poses=poses)
    for index, image in enumerate(model.images.values(), start=1):
        north, east, down = places[index]
        assert image.place == pytest.approx([east, north, -down], abs=1e-6)
        assert image.camera_from_world == pytest.approx(np.array(axes), abs=1e-8)
    ahead = np.array([point.xyz for point in model.points.values()]) @ axes[2]
    assert ahead == pytest.approx(WALL_M + np.dot([2, 1, 3], axes[2]), abs=0.02)


def test_a_lens_that_zoomed_is_several_cameras(tmp_path):
    lens = SOURCE.camera
    zooms = {i: lens.zoomed(1.5 if i >= 8 else 1) for i in range(FRAMES)}
    _, model = project(tmp_path, cameras=zooms)
    focals = {number: camera[3][0] for number, camera in model.cameras.items()}
    assert focals == {1: pytest.approx(lens.fx), 2: pytest.approx(1.5 * lens.fx, abs=0.01)}
    assert [image.camera for image in model.images.values()] == [1] * 7 + [2] * (FRAMES - 8)


def test_what_a_folder_holds(tmp_path):
    folder, model = project(tmp_path)
    names = [f"{i:06d}" for i in range(1, FRAMES)]  # the first has no depth
    assert [image.name for image in model.images.values()] == [f"{name}.jpg" for name in names]
    for kind, ending in (("images", "jpg"), ("depths", "png")):
        assert sorted(path.name for path in (folder / kind).iterdir()) == [
            f"{name}.{ending}" for name in names
        ]
    shown = cv2.imread(str(folder / "images" / "000005.jpg"))
    assert shown.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(shown[..., ::-1].astype(int) - RED).max() <= 8
    note = json.loads((folder / "flightdepth.json").read_text())
    assert (note["flight"], note["depths"]["unit_m"]) == ("flight.mp4", 0.001)


def test_points_have_the_clouds_colours(tmp_path):
    _, model = project(tmp_path)
    assert {point.error for point in model.points.values()} == {-1}
    assert np.abs(np.array([point.rgb for point in model.points.values()]) - RED).max() <= 6


def test_only_frames_of_one_origin_with_an_attitude(tmp_path):
    poses = [pose(i, STEP_M * i, segment=int(i >= FRAMES - 3)) for i in range(FRAMES)]
    poses[1] = pose(1, STEP_M, attitude="unknown")
    folder, model = project(tmp_path, poses=poses)
    kept = range(2, FRAMES - 3)
    assert [image.name for image in model.images.values()] == [f"{i:06d}.jpg" for i in kept]
    assert len(list((folder / "images").iterdir())) == len(list((folder / "depths").iterdir())) == len(kept)


def test_a_picture_lists_the_first_points_of_a_mixed_order(tmp_path, monkeypatch):
    """So that two pictures of one place list the same ones, and a long flight's lists stay small."""
    monkeypatch.setattr(colmap, "MOST_SEEN", 40)
    _, model = project(tmp_path)
    lists = [set(image.seen[:, 2].astype(int)) for image in model.images.values()]
    assert {len(seen) for seen in lists} == {40}
    assert len(lists[4] & lists[5]) > 20


def test_a_mixed_order_keeps_each_point_with_its_colour(tmp_path):
    cloud = cloud_of(write_flown(tmp_path / "out"), EVERY)
    mixed = shuffled(replace(cloud, colours=np.rint(cloud.points_m + 50).astype(np.uint8)))
    assert not np.array_equal(mixed.points_m, cloud.points_m)
    assert sorted(mixed.points_m.tolist()) == sorted(cloud.points_m.tolist())
    assert np.array_equal(mixed.colours, np.rint(mixed.points_m + 50).astype(np.uint8))


def test_millimetres_by_hand():
    depth_m = np.array([[0.0004, 1.2344, 65.535, 65.536, np.nan, 600.0]], np.float32)
    assert millimetres(depth_m).tolist() == [[0, 1234, 65535, 0, 0, 0]]


def test_depth_that_does_not_count_is_unknown(tmp_path):
    flight = write_flown(tmp_path / "out", share=0.05)
    told = [EVERY, replace(EVERY, max_range_m=14), replace(EVERY, min_confidence=0.9)]
    known = [np.isfinite(usable_depth(flight, 11, settings)).mean() for settings in told]
    assert known == [1, 0, 0]
    assert np.isfinite(usable_depth(flight, 12 - 1, replace(EVERY, max_range_m=14.6))).all()


@pytest.mark.parametrize(("frames", "step"), [(12, 5), (1500, 5), (1501, 6), (9000, 30)])
def test_three_hundred_pictures_at_most(frames, step):
    assert every_picture(frames) == step


@pytest.mark.parametrize("camera", [SOURCE.camera, BARREL, FISHEYE], ids=["ideal", "barrel", "fisheye"])
def test_colmap_reads_it(tmp_path, camera):
    pycolmap = pytest.importorskip("pycolmap")
    folder, _ = project(tmp_path, camera=camera)
    found = pycolmap.Reconstruction(folder / "sparse" / "0")
    assert (found.num_images(), found.num_reg_images()) == (FRAMES - 1, FRAMES - 1)
    for number, image in found.images.items():
        assert image.projection_center() == pytest.approx([0, STEP_M * number, 0], abs=1e-6)
        for point in image.get_observation_points2D():
            xyz = found.points3D[point.point3D_id].xyz
            assert image.project_point(xyz) == pytest.approx(point.xy, abs=1e-6)


# The pictures


def shades(folder, count=FRAMES):
    """A folder of pictures, each of another grey."""
    folder.mkdir()
    for i in range(count):
        cv2.imwrite(str(folder / f"shot{i:03d}.png"), np.full((HEIGHT, WIDTH, 3), 10 * i, np.uint8))
    return folder


def at_rate(flight, **settings):
    source = flight.record.source
    settings = source.settings | {"rate": 10} | settings
    source = source.model_copy(update={"settings": settings})
    flight.record = flight.record.model_copy(update={"source": source})
    return flight


def test_pictures_of_the_video_are_those_of_their_frames(tmp_path):
    flight = at_rate(write_flown(tmp_path / "out"))
    shown = dict(video_pictures(flight, shades(tmp_path / "shots"), every=3))
    assert {index: int(image.mean()) for index, image in shown.items()} == {0: 0, 3: 30, 6: 60, 9: 90}


def test_a_part_of_a_video_begins_where_the_run_did(tmp_path):
    """Its frames count from 0, their times from the video's first picture."""
    flight = at_rate(write_flown(tmp_path / "out", frames=6), start=0.4)
    flight.rows = [replace(row, stamp_ns=row.stamp_ns + 400_000_000) for row in flight.rows]
    shown = dict(video_pictures(flight, shades(tmp_path / "shots")))
    assert [int(image.mean()) for image in shown.values()] == [40, 50, 60, 70, 80, 90]


def test_another_video_is_refused(tmp_path):
    flight, shots = at_rate(write_flown(tmp_path / "out")), shades(tmp_path / "shots", 8)
    with pytest.raises(BadInput, match=r"expected a picture at 0.8.* s, got none\. Give what .* flight\.mp4"):
        list(video_pictures(flight, shots))
    source = flight.record.source.model_copy(update={"video_bytes": 1234})
    flight.record = flight.record.model_copy(update={"source": source})
    with pytest.raises(BadInput, match="expected 1,234 bytes"):
        list(video_pictures(flight, shots))


def test_a_video_of_another_size_is_refused(tmp_path):
    with pytest.raises(BadInput, match="expected 96x64 px, got 640x360 px"):
        list(video_pictures(write_flown(tmp_path / "out"), VIDEO))
