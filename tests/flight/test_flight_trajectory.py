"""Trajectories in TUM's format: their poses come back, whatever the world's axes."""

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.records import AttitudeSample, PositionSample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.trajectory import read_trajectory
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges.displacement import Trajectory

S = 10**9
NED_FROM = {
    "-z": np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    "z": np.eye(3),
    "y": np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
}
HEAD = "# timestamp tx ty tz qx qy qz qw\n"


def flown(pitch_deg=0.0, count=20):
    """Seconds, positions [n, 3] and attitudes [n, 3, 3], NED: a curve, the camera turning to the right."""
    at_s = np.arange(count) / 10
    ned = np.stack([4 * at_s, 0.5 * at_s**2, -10 - 0.3 * at_s], axis=1)
    turns = [rotation_from_euler(0, np.radians(pitch_deg), 0.2 * t) @ NED_FROM_CAMERA for t in at_s]
    return at_s, ned, np.array(turns)


def text_of(at_s, ned, turns, down="-z", since="0"):
    """The lines of poses in a world of other axes."""
    world_from_ned = NED_FROM[down].T
    lines = []
    for second, place, turn in zip(at_s, ned, turns, strict=True):
        w, x, y, z = quaternion_from_rotation(world_from_ned @ turn)
        cells = [f"{int(since) + second:.6f}", *(f"{metres:.6f}" for metres in world_from_ned @ place)]
        lines.append(" ".join([*cells, *(f"{part:.7f}" for part in (x, y, z, w))]))
    return HEAD + "\n".join(lines) + "\n"


def read(tmp_path, text):
    path = tmp_path / "trajectory.txt"
    path.write_text(text)
    return read_telemetry(path)


def states_of(log, at_s):
    trajectory = Trajectory()
    for sample in log.samples:
        match sample:
            case PositionSample():
                trajectory.add_position(sample.stamp_ns, sample.position_ned)
            case AttitudeSample():
                trajectory.add_attitude(sample.stamp_ns, sample.world_from_camera)
    return trajectory.at(np.round(at_s * S).astype(np.int64))


@pytest.mark.parametrize("down", ["-z", "z"])
@pytest.mark.parametrize("pitch_deg", [10, 0, -30, -90])
def test_its_poses_come_back_whether_z_is_up_or_down(tmp_path, down, pitch_deg):
    at_s, ned, turns = flown(pitch_deg)
    log = read(tmp_path, text_of(at_s, ned, turns, down))
    assert log.name == f"trajectory trajectory.txt: 20 poses of the camera, {down} down"
    states = states_of(log, at_s)
    np.testing.assert_allclose(states.position_m - states.position_m[0], ned - ned[0], atol=1e-4)
    np.testing.assert_allclose(states.world_from_camera, turns, atol=1e-5)
    assert not log.true_north and log.time_0_told and log.utc is None and log.counts == {}


def test_a_world_that_is_the_first_camera_looks_level(tmp_path):
    """ORB-SLAM's and KITTI's: nothing tells how the camera was pitched."""
    at_s, ned, turns = flown(pitch_deg=-20)
    ned, turns = (ned - ned[0]) @ turns[0] @ NED_FROM_CAMERA.T, NED_FROM_CAMERA @ turns[0].T @ turns
    log = read(tmp_path, text_of(at_s, ned, turns, "y"))
    assert log.name.endswith("y down")
    states = states_of(log, at_s)
    np.testing.assert_allclose(states.world_from_camera, turns, atol=1e-5)
    np.testing.assert_allclose(states.world_from_camera[0], NED_FROM_CAMERA, atol=1e-5)
    np.testing.assert_allclose(states.position_m - states.position_m[0], ned - ned[0], atol=1e-4)


def test_times_since_1970_tell_universal_time_to_the_nanosecond(tmp_path):
    text = text_of(*flown(), since="1403636579")
    text = text.replace("1403636579.000000", "1403636579.063555584")
    log = read(tmp_path, text)
    assert log.utc.ns_at_zero == 1403636579063555584 and log.utc.clock == "computer"
    assert not log.time_0_told and log.samples[0].stamp_ns == 0
    assert "its time 0 is 1403636579.064 s of its clock" in log.name


@pytest.mark.parametrize(("power", "digits"), [(3, 13), (6, 16), (9, 19)])
def test_times_may_be_whole_parts_of_a_second(tmp_path, power, digits):
    """ORB-SLAM3 writes EuRoC's nanoseconds."""
    lines = text_of(*flown(), since="1403636579").splitlines()
    cells = [line.split() for line in lines[1:]]
    text = "\n".join(
        " ".join([str(round(float(cell[0]) * 10) * 10 ** (power - 1)), *cell[1:]]) for cell in cells
    )
    assert len(text.split()[0]) == digits
    log = read(tmp_path, text)
    assert log.utc.ns_at_zero == 1403636579 * S
    assert log.attitudes[3].stamp_ns == 3 * S // 10


def test_a_covariance_behind_the_pose_and_commas_in_a_comment_are_passed_over(tmp_path):
    """OpenVINS writes twelve numbers more."""
    plain = read(tmp_path, text_of(*flown()))
    head = "# timestamp(s), tx, ty, tz, qx, qy, qz, qw, Pr11, Pr12\n"
    lines = text_of(*flown()).splitlines()[1:]
    log = read(tmp_path, head + "\n".join(line + " 0.1" * 12 for line in lines) + "\n")
    assert log.digest == plain.digest


def test_what_is_damaged_is_left_out_and_counted(tmp_path):
    lines = text_of(*flown()).splitlines()
    lines[4] = lines[4].replace(lines[4].split()[2], "nan")
    lines[7] += " 1"
    lines[9] = lines[8]
    lines[-1] = lines[-1][:30]
    log = read(tmp_path, "\n".join(lines))
    assert log.counts == {"lines damaged or cut off": 3, "poses not later than the one before": 1}
    at_s, ned, _ = flown()
    position = states_of(log, at_s[:18]).position_m
    np.testing.assert_allclose((position - position[0])[-1], ned[17] - ned[0], atol=1e-3)


def test_a_place_beyond_reason_is_damage(tmp_path):
    """It ended in NumPy's warning of an overflow."""
    lines = text_of(*flown()).splitlines(keepends=True)
    for at, far in ((4, "1e308"), (5, "-1e308"), (9, "1e8")):
        cells = lines[at].split()
        lines[at] = " ".join([cells[0], far, *cells[2:]]) + "\n"
    assert read(tmp_path, "".join(lines)).counts == {"lines damaged or cut off": 3}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD, "expected one of"),
        (HEAD + "0 1 2 3 0 0 0\n", "expected one of"),
        (HEAD + "0 1 2 3 0 0 0 7\n", "expected one of"),
        (HEAD + "0 1 2 3 0 0 0 1\n", "expected two poses or more within 1.5 s, got none"),
        (HEAD + "0 1 2 3 0 0 0 1\n9 1 2 3 0 0 0 1\n", "expected two poses or more within 1.5 s"),
        ("0 1 2 3 0 0 0 1\n1 900 2 3 0 0 0 1\n", "expected two poses or more within 1.5 s, got none"),
        ("1e999999 1 2 3 0 0 0 1\n", "expected one of"),
        ("nan 1 2 3 0 0 0 1\n", "expected one of"),
        ("1e40 1 2 3 0 0 0 1\n", "expected one of"),
    ],
)
def test_what_tells_no_way_is_refused(tmp_path, text, said):
    with pytest.raises(BadInput, match=said):
        read(tmp_path, text)


@pytest.mark.parametrize("count", [7, 12])
def test_poses_without_times_are_told_as_such(tmp_path, count):
    line = " ".join(["1.5e-01", "-2", "0"] + ["0.25"] * (count - 3))
    with pytest.raises(BadInput, match=r"got poses without times: docs/datasets\.md tells"):
        read(tmp_path, f"{line}\n{line}\n")


def test_a_file_without_a_pose_is_refused_by_its_reader(tmp_path):
    path = tmp_path / "none.txt"
    path.write_text(HEAD)
    with pytest.raises(BadInput, match="two poses or more"):
        read_trajectory(path)
