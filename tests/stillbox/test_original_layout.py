"""Sets on the disk in the original layout."""

import json

import cv2
import numpy as np
import pytest

from flightdepth import cli
from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.stillbox import original_layout
from flightdepth.stillbox.original_layout import OriginalLayout

CONFIG = StillBoxConfig(frames=2)
TEXTURES = Textures.procedural(2, 1)


def scene_and_frames(number):
    scene = draw_scene(CONFIG, len(TEXTURES), 1, number)
    return scene, render(scene, TEXTURES, Camera.from_fov(64, 64, 90))


@pytest.fixture
def written(tmp_path):
    """Two scenes on the disk, and what they were."""
    layout = OriginalLayout(tmp_path, CONFIG, 64, seed=1)
    scenes = [scene_and_frames(number) for number in range(2)]
    for number, scene in enumerate(scenes):
        layout.add(number, *scene)
    return tmp_path / "00", scenes, json.loads((tmp_path / "00" / "metadata.json").read_text())


def test_the_head(written):
    facts = written[2]
    assert (facts["fov"], facts["scenes_nb"], facts["resolution"]) == (90, 2, [64, 64])
    assert facts["args"]["seed"] == 1


def test_every_file_that_is_named_stands(written):
    folder, _, facts = written
    named = {name for scene in facts["scenes"] for name in (*scene["imgs"], *scene["depth"])}
    assert named | {"metadata.json"} == {path.name for path in folder.iterdir()}
    assert {"RGB_0000_00.jpg", "RGB_0001_01.jpg", "depth_0001_00.npy"} <= named


def test_depth_comes_back(written):
    folder, scenes, facts = written
    for (_, frames), scene in zip(scenes, facts["scenes"], strict=True):
        for name, depth_m in zip(scene["depth"], frames.depth_m, strict=True):
            found = np.load(folder / name, allow_pickle=False)
            assert found.dtype == np.float32
            assert np.array_equal(found, depth_m.clip(0.1, 200))


def test_pictures_come_back_as_jpeg_can(written):
    folder, scenes, facts = written
    bgr = cv2.imread(str(folder / facts["scenes"][0]["imgs"][1]))
    difference = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(float) - scenes[0][1].images[1]
    assert np.abs(difference).mean() < 4


def test_speed_is_right_up_forward(written):
    _, scenes, facts = written
    for (scene, _), found in zip(scenes, facts["scenes"], strict=True):
        moved = (scene.camera_position[1] - scene.camera_position[0]) @ scene.world_from_camera[0]
        right, up, forward = np.array(found["speed"]) * found["time_step"]
        assert [right, -up, forward] == pytest.approx(moved.tolist())
        assert np.linalg.norm(found["speed"]) == pytest.approx(1)


def test_a_full_folder_is_followed_by_the_next(monkeypatch, tmp_path):
    monkeypatch.setattr(original_layout, "SCENES_PER_FOLDER", 1)
    layout = OriginalLayout(tmp_path, CONFIG, 64, seed=1)
    for number in range(2):
        layout.add(number, *scene_and_frames(number))
    counts = [json.loads((tmp_path / n / "metadata.json").read_text())["scenes_nb"] for n in ("00", "01")]
    assert counts == [1, 1]


def test_a_crash_leaves_whole_scenes(monkeypatch, tmp_path):
    layout = OriginalLayout(tmp_path, CONFIG, 64, seed=1)
    layout.add(0, *scene_and_frames(0))
    monkeypatch.setattr(original_layout, "npy", lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        layout.add(1, *scene_and_frames(1))
    assert json.loads((tmp_path / "00" / "metadata.json").read_text())["scenes_nb"] == 1


def test_render_writes_a_set(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["render", "64", "--scenes", "5", "--out", "set", "--procedural", "2"]) == 0
    facts = json.loads((tmp_path / "set" / "00" / "metadata.json").read_text())
    assert (facts["scenes_nb"], len(facts["scenes"][4]["imgs"])) == (5, 10)
    assert "set: 5 scenes of 10 frames, 64 px, in the folder layout" in capsys.readouterr().out
