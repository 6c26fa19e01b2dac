"""Sets on the disk in the original layout."""

import json

import cv2
import numpy as np
import pytest
from small_sets import TEXTURES, as_rendered, small_source

from flightdepth.errors import BadInput
from flightdepth.scenes import StillBoxConfig
from flightdepth.stillbox import original_layout
from flightdepth.stillbox.encoding import Source
from flightdepth.stillbox.original_layout import OriginalLayout
from flightdepth.stillbox.sets import SceneSet

SOURCE = small_source(frames=2)
ARGUMENTS = SOURCE.arguments(TEXTURES)


def metadata(folder, number="00"):
    return json.loads((folder / number / "metadata.json").read_text())


def encoded(number):
    return SOURCE.encoded(number, TEXTURES)


@pytest.fixture
def written(tmp_path):
    """Two scenes on the disk, and what they were."""
    with OriginalLayout(tmp_path, ARGUMENTS) as layout:
        for number in range(2):
            layout.add(encoded(number))
    return tmp_path / "00", [as_rendered(SOURCE, n)[1] for n in range(2)], metadata(tmp_path)


def test_the_head(written):
    facts = written[2]
    assert facts.keys() == {"args", "fov", "resolution", "scenes_nb", "scenes"}
    assert (facts["fov"], facts["scenes_nb"], facts["resolution"]) == (90, 2, [16, 12])
    assert facts["args"] == ARGUMENTS
    assert facts["args"]["frames"] == 2


def test_every_file_that_is_named_stands(written):
    folder, _, facts = written
    named = {name for scene in facts["scenes"] for name in (*scene["imgs"], *scene["depth"])}
    assert named | {"metadata.json"} == {path.name for path in folder.iterdir()}
    assert {"RGB_0000_00.jpg", "RGB_0001_01.jpg", "depth_0001_00.npy"} <= named


def test_depth_comes_back(written):
    folder, scenes, facts = written
    for rendered, scene in zip(scenes, facts["scenes"], strict=True):
        for name, depth_m in zip(scene["depth"], rendered.depth_m, strict=True):
            found = np.load(folder / name, allow_pickle=False)
            assert found.dtype == np.float32
            assert np.array_equal(found, depth_m.clip(0.1, 200))


def test_pictures_come_back_as_jpeg_can(written):
    folder, scenes, facts = written
    bgr = cv2.imread(str(folder / facts["scenes"][0]["imgs"][1]))
    difference = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(float) - scenes[0].images[1]
    assert np.abs(difference).mean() < 4


def test_a_full_folder_is_followed_by_the_next(monkeypatch, tmp_path):
    monkeypatch.setattr(original_layout, "SCENES_PER_FOLDER", 1)
    with OriginalLayout(tmp_path, ARGUMENTS) as layout:
        for number in range(2):
            layout.add(encoded(number))
    assert [metadata(tmp_path, name)["scenes_nb"] for name in ("00", "01")] == [1, 1]
    assert (tmp_path / "01" / "RGB_0000_00.jpg").exists()


def test_a_crash_leaves_whole_scenes(monkeypatch, tmp_path):
    broken = encoded(1)
    object.__setattr__(broken, "depths", (broken.depths[0], None))
    with pytest.raises(TypeError), OriginalLayout(tmp_path, ARGUMENTS) as layout:
        layout.add(encoded(0))
        layout.add(broken)
    assert metadata(tmp_path)["scenes_nb"] == 1
    assert {p.name.split("_")[1] for p in (tmp_path / "00").iterdir() if "_" in p.name} == {"0000"}


def test_metadata_is_written_now_and_then(tmp_path):
    times = iter([0, 1, 4, 6, 6, 7, 12, 12])  # the clock is asked at the start, after a scene, after a save
    layout = OriginalLayout(tmp_path, ARGUMENTS, clock=lambda: next(times))
    seen = []
    for number in range(5):
        layout.add(encoded(number))
        path = tmp_path / "00" / "metadata.json"
        seen.append(metadata(tmp_path)["scenes_nb"] if path.exists() else 0)
    assert seen == [0, 0, 3, 3, 5]


def test_damaged_metadata_is_named(written):
    path = written[0] / "metadata.json"
    path.write_text('{"scenes"')
    with pytest.raises(BadInput, match=r"metadata .*metadata\.json: expected JSON with scenes"):
        OriginalLayout(written[0].parent, ARGUMENTS)


def rotation(w, x, y, z):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_as_the_docs_say_a_point_is_where_the_other_frame_sees_it(tmp_path):
    """An empty room and a camera that turns, by the words of docs/stillbox-disk.md alone: right, up, forward."""
    config = StillBoxConfig(frames=3, meshes=(0, 0), orientation_noise_rad=0.05, horizontal_fov_deg=70)
    source = Source(SceneSet(config, 64, 48, seed=1))
    with OriginalLayout(tmp_path, source.arguments(TEXTURES)) as layout:
        layout.add(source.encoded(0, TEXTURES))
    facts = metadata(tmp_path)
    scene, (width, height) = facts["scenes"][0], facts["resolution"]
    focal_px = width / 2 / np.tan(np.radians(facts["fov"]) / 2)
    depth_m = [np.load(tmp_path / "00" / name).astype(float) for name in scene["depth"]]
    turns = [rotation(*each) for each in scene["orientation"]]
    places_m = np.arange(3)[:, None] * np.array(scene["speed"]) * scene["time_step"]
    (v, u), cx, cy = np.mgrid[:height, :width], (width - 1) / 2, (height - 1) / 2
    rays = np.stack([(u - cx) / focal_px, -(v - cy) / focal_px, np.ones_like(u)], axis=-1)

    world = (rays * depth_m[2][..., None]) @ turns[2].T + places_m[2]
    x, y, z = np.moveaxis((world - places_m[0]) @ turns[0], -1, 0)
    x_px, y_px = x / z * focal_px + cx, -y / z * focal_px + cy
    left, top = np.floor(x_px).astype(int), np.floor(y_px).astype(int)
    seen = (left >= 0) & (left < width - 1) & (top >= 0) & (top < height - 1)
    assert seen.mean() > 0.7
    left, top, x_px, y_px, z = (each[seen] for each in (left, top, x_px, y_px, z))
    inverse = sum(  # linear on a wall
        (1 - abs(x_px - column)) * (1 - abs(y_px - row)) / depth_m[0][row, column]
        for row in (top, top + 1)
        for column in (left, left + 1)
    )
    assert np.percentile(abs(z * inverse - 1), 80) < 1e-6  # but along the edges of the room
