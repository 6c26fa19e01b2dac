import laspy
import numpy as np
import pytest
from flown_folder import LOOKING_EAST, RED, STEP_M, WALL_M, pose, write_flown
from output_samples import HEIGHT, SOURCE, WIDTH, known

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.outputs import voxels
from flightdepth.outputs.cloud import (
    CloudSettings,
    View,
    agreed,
    cloud_of,
    looked_up,
    off_edges,
    own_share,
    seen_points,
    views,
)
from flightdepth.outputs.cloud_files import write_las, write_ply
from flightdepth.outputs.voxels import Cloud, VoxelGrid

EVERY = CloudSettings(every=1, voxel_m=0.1)
CAMERA = SOURCE.camera


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_flown(tmp_path_factory.mktemp("flown") / "out")


def view(depth_m, at=None, *, confidence=0.8, camera=CAMERA, step=1, share=None):
    depth_m = known(depth_m).depth_m
    image = np.full((HEIGHT, WIDTH, 3), RED, np.uint8)[::step, ::step]
    confidence = np.full(image.shape[:2], confidence, np.float32)
    return View(image, depth_m, confidence, at or pose(0, 0.0), camera, share)


def test_every_point_lies_on_the_wall(folder):
    cloud = cloud_of(folder, EVERY)
    assert len(cloud) > 500
    assert cloud.points_m[:, 1] == pytest.approx(WALL_M, abs=0.02)  # y is north


def test_points_have_the_pictures_colours_and_the_maps_confidence(folder):
    cloud = cloud_of(folder, EVERY)
    assert np.abs(cloud.colours.astype(int) - RED).max() <= 6  # the preview packs them
    assert cloud.confidence == pytest.approx(0.8, abs=1 / 255)


def test_the_wall_is_as_wide_as_four_frames_see_it(folder):
    """90 degrees across: twice as wide as far. A point needs three other frames that see it, so the fourth counts."""
    points, fourth_m = cloud_of(folder, EVERY).points_m, WALL_M - 4 * STEP_M
    assert np.ptp(points[:, 0]) == pytest.approx(2 * fourth_m, rel=0.02)
    assert np.ptp(points[:, 2]) == pytest.approx(2 * fourth_m * HEIGHT / WIDTH, rel=0.02)


def test_a_lens_that_zoomed_sees_a_narrower_wall(tmp_path):
    """Found in review: clouds took the flight's one focal length, and points lay 17 % off, where it was 7."""
    cameras = dict.fromkeys(range(12), CAMERA.zoomed(2.0))
    points = cloud_of(write_flown(tmp_path / "out", cameras=cameras), EVERY).points_m
    assert np.ptp(points[:, 0]) == pytest.approx(WALL_M - 4 * STEP_M, rel=0.02)


def test_views_that_wait_hold_no_more_of_a_picture_than_is_used(folder):
    """Found in review: seventeen whole pictures waited at a time, 1.9 GB for a video of 3840x2160."""
    first = next(views(folder, 1, 8))
    for kept in (first.image, first.confidence):
        assert kept.shape[:2] == (HEIGHT // 8, WIDTH // 8)
        assert kept.base is None


def test_a_camera_that_looks_east_sees_points_in_the_east():
    east = pose(0, 0.0)
    object.__setattr__(east, "world_from_camera", LOOKING_EAST)
    points, rows, columns = seen_points(view(10, east), 1, EVERY)
    assert points[:, 1] == pytest.approx(10)
    right = points[columns == WIDTH - 1]
    assert (right[:, 0] < 0).all()  # right of east is south
    assert (points[rows == 0, 2] < 0).all()  # the top row is up: down is negative


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_a_lens_is_undone(model):
    lens = Camera(WIDTH, HEIGHT, 48, 48, 47.5, 31.5, (0.05, -0.01, 0.0, 0.0), model)
    one = view(10, camera=lens, step=5)
    points, _, _ = seen_points(one, 5, EVERY)
    there_m, stored_m = looked_up(points, one)  # back through the lens to the pixel it came from
    assert there_m == pytest.approx(10)
    assert np.isfinite(stored_m).mean() > 0.95


@pytest.mark.parametrize(
    ("settings", "share"),
    [
        (CloudSettings(min_confidence=0.9), 0),
        (CloudSettings(max_range_m=9), 0),
        (CloudSettings(min_confidence=0.8, max_range_m=11), 1),
    ],
)
def test_what_is_unsure_or_far_is_left_out(settings, share):
    points, _, _ = seen_points(view(10), 1, settings)
    assert len(points) == share * WIDTH * HEIGHT


@pytest.mark.parametrize(("max_sigma", "share"), [(0.05, 0), (0.12, 0.5), (0.3, 1)])
def test_what_has_a_wide_error_bar_is_left_out(max_sigma, share):
    """Half of the picture errs by a tenth, half by a fifth."""
    wide = np.where(np.arange(WIDTH) < WIDTH // 2, np.float32(0.1), np.float32(0.2)) * np.ones(
        (HEIGHT, 1), np.float32
    )
    points, _, columns = seen_points(view(10, share=wide), 1, CloudSettings(max_sigma=max_sigma))
    assert len(points) == share * WIDTH * HEIGHT
    assert (columns < WIDTH // 2).all() or share == 1


def test_an_unsure_speed_says_nothing_against_a_shape():
    """It is in the error bars of all pixels alike: in squares, as shares of the depth."""
    depth_m = np.linspace(5, 50, 200, dtype=np.float32).reshape(10, 20)
    own = np.linspace(0, 0.2, 200, dtype=np.float32).reshape(10, 20)
    with_speed = own_share(np.hypot(own, np.float32(0.15)) * depth_m, depth_m)
    assert with_speed == pytest.approx(own_share(own * depth_m, depth_m), abs=1e-4)
    assert with_speed[own > 0.05] == pytest.approx(
        own[own > 0.05], abs=1.1e-3
    )  # but for the best pixels' own
    assert np.isnan(own_share(own, np.full_like(own, np.nan))).all()


def test_of_a_flight_what_is_unsure_beyond_what_all_of_it_is_gives_no_point(folder, tmp_path):
    """All is unsure by a sixth, as of a bad speed; the right half by a tenth of its own beside."""
    shares = np.full((HEIGHT, WIDTH), 0.15, np.float32)
    assert len(cloud_of(write_flown(tmp_path / "all", share=shares), EVERY)) == len(cloud_of(folder, EVERY))
    shares[:, WIDTH // 2 :] = np.hypot(0.15, 0.1)
    left = cloud_of(write_flown(tmp_path / "half", share=shares), EVERY).points_m
    assert left[:, 0].max() < 0
    assert left[:, 0].min() == pytest.approx(cloud_of(folder, EVERY).points_m[:, 0].min(), abs=0.1)


def test_unknown_and_sky_give_no_point():
    assert len(seen_points(view(np.nan), 1, EVERY)[0]) == 0


def test_an_edge_and_its_surroundings_are_left_out():
    depth_m = np.where(np.arange(WIDTH) < 40, np.float32(10), np.float32(30)) * np.ones(
        (HEIGHT, 1), np.float32
    )
    kept = off_edges(depth_m)
    assert not kept[:, 38:42].any()
    assert kept[:, :38].all()
    assert kept[:, 42:].all()


@pytest.mark.parametrize(("ratio", "edge"), [(1.19, False), (1.21, True)])
def test_a_slope_is_no_edge(ratio, edge):
    depth_m = np.full((9, 9), 10, np.float32)
    depth_m[:, 5:] *= ratio
    assert off_edges(depth_m)[4].tolist() == [True] * 3 + [not edge] * 4 + [True] * 2


@pytest.mark.parametrize(
    ("agree", "differ", "counts"), [(2, 0, False), (3, 0, True), (3, 3, True), (3, 4, False), (4, 4, True)]
)
def test_three_must_agree_and_half_of_those_that_see_it(agree, differ, counts):
    points, _, _ = seen_points(view(10, step=16), 16, EVERY)
    kept, _ = agreed(points, [*[view(10.9)] * agree, *[view(11.1)] * differ])
    assert (kept == counts).all()


def test_a_point_that_the_others_contradict_is_left_out():
    wrong, right = view(5, step=4), [view(10, pose(i, 0.5 * i)) for i in range(1, 5)]
    points, _, _ = seen_points(wrong, 4, EVERY)
    assert not agreed(points, right)[0].any()


def test_points_move_to_the_mean_of_what_agrees():
    points, _, _ = seen_points(view(10, step=8), 8, EVERY)
    kept, farther = agreed(points, [view(10.5) for _ in range(4)])
    assert kept.all()
    assert farther == pytest.approx((1 + 4 * 1.05) / 5)


@pytest.mark.parametrize(("off_axis_deg", "seen"), [(0, True), (30, True), (50, False), (59, False)])
def test_what_lies_beside_the_picture_is_not_looked_up(off_axis_deg, seen):
    """A barrel's polynomial folds back at 49 degrees: points far aside fell into the picture, and had a depth there."""
    lens = Camera(WIDTH, HEIGHT, 75, 75, 47.5, 31.5, (-0.25, 0, 0, 0))
    east_m = 10 * np.tan(np.radians(off_axis_deg))
    _, stored_m = looked_up(np.array([[10.0, east_m, 0.0]]), view(10, camera=lens))
    assert np.isfinite(stored_m).tolist() == [seen]


def test_what_is_as_far_as_files_tell_or_farther_is_no_surface():
    """Of 655.35 m or farther a sphere of 655.35 m was made, where --max-range allowed it."""
    far = CloudSettings(max_range_m=1000)
    for depth_m, points in ((655.34, WIDTH * HEIGHT), (655.35, 0)):
        assert len(seen_points(view(depth_m), 1, far)[0]) == points


def test_a_flight_without_poses_says_so(tmp_path):
    folder = write_flown(tmp_path / "out", posed=False)
    with pytest.raises(BadInput, match="no frame with known position"):
        cloud_of(folder, EVERY)


@pytest.mark.parametrize(
    "wrong",
    [
        {"voxel_m": 0},
        {"min_confidence": 2},
        {"max_range_m": float("nan")},
        {"every": 0},
        {"max_sigma": 0},
        {"max_sigma": float("nan")},
    ],
)
def test_settings_that_cannot_be(wrong):
    with pytest.raises(BadInput, match="--"):
        CloudSettings(**wrong)


@pytest.mark.parametrize(
    "extreme",
    [
        {"voxel_m": 0.01},
        {"min_confidence": 0},
        {"min_confidence": 1},
        {"max_range_m": 1e-3},
        {"every": 1},
        {"max_sigma": 1e-3},
    ],
)
def test_settings_that_just_can_be(extreme):
    assert CloudSettings(**extreme)


# Voxels


def test_a_voxel_keeps_the_mean_weighted_by_confidence():
    grid = VoxelGrid(1.0)
    grid.add(np.array([[0.2, 0.5, 0.5]]), np.array([[100, 0, 0]], np.uint8), np.array([0.75], np.float32))
    grid.add(np.array([[0.6, 0.5, 0.5]]), np.array([[200, 0, 0]], np.uint8), np.array([0.25], np.float32))
    cloud = grid.cloud()
    assert cloud.points_m == pytest.approx(np.array([[0.3, 0.5, 0.5]]))
    assert cloud.colours.tolist() == [[125, 0, 0]]
    assert cloud.confidence == pytest.approx(0.5)


def gathered(points_m, voxel_m):
    grid, count = VoxelGrid(voxel_m), len(points_m)
    grid.add(np.asarray(points_m, float), np.zeros((count, 3), np.uint8), np.ones(count, np.float32))
    return grid.cloud().points_m


def test_a_voxel_begins_at_whole_lengths():
    found = gathered([(-0.5, 0, 0), (0.0, 0, 0), (0.5, 0, 0), (1.0, 0, 0)], 1.0)
    assert sorted(found[:, 0].tolist()) == [-0.5, 0.25, 1.0]


def test_neighbouring_voxels_stay_apart_on_every_axis():
    middles = np.stack(np.meshgrid(*3 * [np.arange(-2, 2) + 0.5]), axis=-1).reshape(-1, 3)
    assert {tuple(point) for point in gathered(middles, 1.0)} == {tuple(point) for point in middles}


def test_a_voxels_colour_is_the_nearest_whole_one_of_each_channel():
    grid = VoxelGrid(1.0)
    colours = np.array([[10, 20, 30], [11, 22, 30], [11, 21, 31]], np.uint8)
    grid.add(np.full((3, 3), 0.5), colours, np.ones(3, np.float32))
    assert grid.cloud().colours.tolist() == [[11, 21, 30]]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_flight_beyond_the_last_voxel_is_refused(axis, sign):
    """2^20 of 1 cm either way."""
    within, beyond = np.zeros((2, 1, 3))
    within[0, axis], beyond[0, axis] = sign * 10485.755, sign * 10485.765
    np.testing.assert_allclose(gathered(within, 0.01), within)
    with pytest.raises(BadInput, match="leaves 10486 m"):
        gathered(beyond, 0.01)


def test_the_order_of_frames_does_not_matter():
    rng = np.random.default_rng(0)
    frames = [
        (rng.uniform(-5, 5, (200, 3)), rng.integers(0, 255, (200, 3), np.uint8), rng.uniform(0.1, 1, 200))
        for _ in range(40)
    ]
    grids = VoxelGrid(0.5), VoxelGrid(0.5)
    for grid, order in zip(grids, (frames, frames[::-1]), strict=True):
        for points, colours, confidence in order:
            grid.add(points, colours, confidence.astype(np.float32))
    one, other = (grid.cloud() for grid in grids)
    assert np.allclose(one.points_m, other.points_m)
    cells = np.floor(one.points_m / 0.5)
    assert len(np.unique(cells, axis=0)) == len(one)


def flown_rows(grid, frames):
    """Rows sorted while `frames` are added, each of 50 points that none saw before."""
    with pytest.MonkeyPatch.context() as patch:
        rows, merged = [], voxels._merged
        patch.setattr(voxels, "_merged", lambda keys, sums: rows.append(len(keys)) or merged(keys, sums))
        for number in range(frames):
            points = np.stack([np.arange(50.0), np.full(50, float(number)), np.zeros(50)], axis=1) + 0.5
            grid.add(points, np.full((50, 3), number % 200, np.uint8), np.full(50, 0.3, np.float32))
    return sum(rows)


def test_work_grows_with_the_flight_and_not_with_its_square(monkeypatch):
    """Found in review: each 16 frames the whole cloud was sorted again."""
    monkeypatch.setattr(voxels, "MERGE_LEAST", 1000, raising=False)
    short, long = (flown_rows(VoxelGrid(1.0), frames) for frames in (200, 1600))
    assert long < 1.5 * 8 * short


def test_when_voxels_are_merged_changes_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    clouds = []
    frames = [(rng.uniform(-5, 5, (200, 3)), rng.uniform(0.1, 1, 200).astype(np.float32)) for _ in range(40)]
    for least in (0, 500, 1_000_000):
        monkeypatch.setattr(voxels, "MERGE_LEAST", least)
        grid = VoxelGrid(0.5)
        for points, confidence in frames:
            grid.add(points, np.full((200, 3), 7, np.uint8), confidence)
        clouds.append(grid.cloud())
    for cloud in clouds[1:]:
        assert np.array_equal(cloud.points_m, clouds[0].points_m)
        assert np.array_equal(cloud.confidence, clouds[0].confidence)


# Files


CLOUD = Cloud(
    np.array([[0.1234, -5.5, 2.0], [100.0, 20.25, -3.0], [7.0, 8.0, 9.0]]),
    np.array([[255, 0, 1], [2, 3, 4], [128, 64, 32]], np.uint8),
    np.array([1.0, 0.5, 0.25], np.float32),
)


def test_ply_comes_back_by_its_own_header(tmp_path):
    write_ply(tmp_path / "a.ply", CLOUD)
    header, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert "element vertex 3" in lines
    types = {"float": "<f4", "uchar": "u1"}
    fields = [(name, types[kind]) for _, kind, name in (line.split() for line in lines if "property" in line)]
    points = np.frombuffer(body, fields)
    assert len(points) == 3
    assert np.allclose(np.stack([points[axis] for axis in "xyz"], axis=1), CLOUD.points_m)
    assert [tuple(point)[3:6] for point in points] == [tuple(colour) for colour in CLOUD.colours.tolist()]
    assert points["confidence"].tolist() == [1.0, 0.5, 0.25]


@pytest.mark.parametrize("kind", ["las", "laz"])
def test_las_comes_back_to_the_millimetre(tmp_path, kind):
    write_las(tmp_path / f"a.{kind}", CLOUD)
    read = laspy.read(tmp_path / f"a.{kind}")
    assert np.abs(read.xyz - CLOUD.points_m).max() <= 0.0005 + 1e-9
    assert (np.stack([read.red, read.green, read.blue], axis=1) // 257).tolist() == CLOUD.colours.tolist()
    assert read["confidence"].tolist() == [1.0, 0.5, 0.25]
