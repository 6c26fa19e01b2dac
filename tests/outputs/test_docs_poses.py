"""What docs/view.md hands to other programs: poses by its snippet, and by the command before it."""

import re
from pathlib import Path

import numpy as np
import pytest
from flown_folder import pose, write_flown

from flightdepth.cli import main

TEXT = (Path(__file__).parents[2] / "docs" / "view.md").read_text(encoding="utf-8")
(SNIPPET,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
SOUTH_EAST_DOWN = [0.353553391, 0.146446609, -0.353553391, -0.853553391]  # of heading 135 degrees, 45 down
HALF = np.sqrt(0.5)
# Its axes, east, north, up: the picture's right is south-west, its down north-west and down, its middle south-east.
RIGHT, DOWN, FORWARD = (-HALF, -HALF, 0), (-0.5, 0.5, -HALF), (0.5, -0.5, -HALF)


@pytest.fixture
def handed_on(tmp_path, monkeypatch):
    """What the snippet made of three poses, the second's attitude unknown, the third of another segment."""
    poses = [pose(0, 5.0), pose(1, 6.0, attitude="unknown"), pose(2, 7.0, segment=1)]
    object.__setattr__(poses[0], "world_from_camera", np.array(SOUTH_EAST_DOWN))
    object.__setattr__(poses[0], "position_ned", np.array([5.0, -2.0, -30.0]))
    object.__setattr__(poses[0], "stamp_ns", 1_234_567_890)
    write_flown(tmp_path / "out", frames=3, poses=poses)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(SNIPPET, names)
    assert main(["convert", "out", "flight.tum"]) == 0
    return names["map_from_camera"], (tmp_path / "flight.tum").read_text()


def test_a_matrix_brings_the_cameras_axes_to_east_north_up(handed_on):
    matrices, _ = handed_on
    assert list(matrices) == [0]
    expected = np.array([[*axis, 0] for axis in (RIGHT, DOWN, FORWARD)] + [[-2.0, 5.0, 30.0, 1]]).T
    assert matrices[0] == pytest.approx(expected, abs=1e-8)


def test_the_trajectory_is_tums(handed_on):
    """Seconds, the place, then a quaternion with w at its end, here turned into the axes that it brings to the map."""
    comment, line = handed_on[1].splitlines()
    assert comment.startswith("# ")
    time_s, *place, x, y, z, w = map(float, line.split())
    assert (time_s, *place) == pytest.approx((1.23456789, -2, 5, 30))
    axes = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    )
    assert np.array(axes) == pytest.approx(np.array([RIGHT, DOWN, FORWARD]), abs=1e-8)


def test_the_trajectory_may_be_written_again_but_over_nothing_else(handed_on, tmp_path, capsys):
    assert main(["convert", "out", "flight.tum"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "flight.tum: 1 poses of out, metres east, north, up" in told
    (tmp_path / "mine.tum").write_text("0 0 0 0 0 0 0 1\n")
    assert main(["convert", "out", "mine.tum"]) == 2
    assert (tmp_path / "mine.tum").read_text() == "0 0 0 0 0 0 0 1\n"


def test_opengls_camera_looks_back_along_its_z(handed_on):
    matrix = handed_on[0][0] @ np.diag([1, -1, -1, 1])
    assert -matrix[:3, 2] == pytest.approx(np.array(FORWARD), abs=1e-8)
    assert matrix[:3, 1] == pytest.approx(-np.array(DOWN), abs=1e-8)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
