"""Sets on the disk in the original layout."""

import json

import cv2
import numpy as np
import pytest
from small_sets import TEXTURES, small_source

from flightdepth.errors import BadInput
from flightdepth.stillbox import original_layout
from flightdepth.stillbox.original_layout import OriginalLayout

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
    return tmp_path / "00", [SOURCE.scenes.rendered(n, TEXTURES)[1] for n in range(2)], metadata(tmp_path)


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
