"""The snippets of docs/python.md, one after the other, on the sample flight; and its table of names."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

import flightdepth as fd
from flightdepth.flight.video import Video
from flightdepth.motion import rotation_from_quaternion

TEXT = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
TWO_PICTURES, POSES = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
SAMPLE = Path(fd.__file__).parent / "sample"


@pytest.fixture(scope="module")
def flight():
    """Ten frames: stamp, picture, pose; to the left."""
    table = np.loadtxt(SAMPLE / "poses.csv", delimiter=",", skiprows=1)
    with Video(SAMPLE / "flight.mp4", start_s=6.66, end_s=7.0) as video:
        frames = list(video.frames())[:10]
    flown = []
    for frame in frames:
        row, pose = table[np.abs(table[:, 0] - frame.stamp_ns).argmin()], np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation_from_quaternion(row[4:]), row[1:4]
        flown.append((frame.stamp_ns, frame.image, pose))
    return flown


def test_the_snippets_give_the_depth_of_the_sample(flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, number in (("1.png", 3), ("2.png", 6)):
        cv2.imwrite(name, cv2.cvtColor(flight[number][1], cv2.COLOR_RGB2BGR))
    names = {"flight": flight}
    exec(TWO_PICTURES.replace('"motion"', '"motion-tiny"'), names)
    turn = flight[6][2][:3, :3]
    flown = turn.T @ (flight[6][2][:3, 3] - flight[3][2][:3, 3])
    np.testing.assert_allclose(names["flown"], flown, atol=0.03)
    of_two = names["depth_m"]
    assert names["told"].sigma_m.shape == names["told"].depth_m.shape
    exec(POSES, names)
    of_poses = names["depth_m"]
    assert of_two.shape == of_poses.shape == names["sigma_m"].shape == names["farther_than_m"].shape
    both = np.isfinite(of_two) & np.isfinite(of_poses)
    assert np.median(np.abs(of_two[both] / of_poses[both] - 1)) < 0.1


def test_the_table_has_each_public_name():
    table = TEXT.split("| name |")[1].split("\n\n")[0]
    first_cells = "".join(line.split("|")[1] for line in table.splitlines()[2:])
    assert sorted(re.findall(r"`(\w+)`", first_cells)) == sorted(fd.__all__)
