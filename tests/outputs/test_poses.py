import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from output_samples import csv_text, known, unknown

from flightdepth.flight import AttitudeSample, Frame, PositionSample, VelocitySample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import (
    NED_FROM_CAMERA,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)
from flightdepth.outputs import poses
from flightdepth.outputs.poses import (
    COLUMNS,
    REMEMBERED,
    FramePose,
    PoseTrack,
    pose_cells,
    poses_from_csv,
    tum_trajectory,
)
from flightdepth.ranges.seen_turns import SeenOrientation

S = 1_000_000_000
PICTURE = np.zeros((8, 8, 3), np.uint8)
LOOKING_NORTH = quaternion_from_rotation(NED_FROM_CAMERA)


def at(track, seconds, result=None, index=None):
    stamp_ns = round(seconds * S)
    frame = Frame(round(seconds * 10) if index is None else index, stamp_ns, PICTURE)
    return track.at(frame, result or unknown())


def flown(velocities, frame="world"):
    """A track that was given (seconds, velocity) all at once."""
    track = PoseTrack()
    for seconds, velocity in velocities:
        track.add(VelocitySample(round(seconds * S), np.array(velocity, float), frame))
    return track


def test_positions_are_integrated_from_the_first_frame():
    track = flown([(0, (2, 0, 0)), (1, (2, 0, 0)), (2, (2, 1, 0))])
    where = [at(track, seconds).position_ned for seconds in (0.5, 1.0, 2.0)]
    assert np.allclose(where, [(0, 0, 0), (1, 0, 0), (3, 0.5, 0)])


def test_before_the_log_no_place_is_known():
    assert at(flown([(1, (2, 0, 0)), (2, (2, 0, 0))]), 0.5) is None


def test_nothing_is_summed_across_a_gap():
    track = flown([(0, (2, 0, 0)), (1, (2, 0, 0)), (9, (2, 0, 0)), (10, (2, 0, 0))])
    places = [at(track, seconds) for seconds in (0.0, 1.0, 9.0, 10.0)]
    assert [place.segment for place in places] == [0, 0, 1, 1]
    assert [place.position_ned[0] for place in places] == pytest.approx([0, 2, 0, 2])


def test_what_is_remembered_stays_bounded_where_places_come_and_go():
    """An index that had no place took nothing out: gaps in the log made it grow."""
    track = flown([(seconds, (2, 0, 0)) for second in range(0, 90, 3) for seconds in (second, second + 1)])
    for index in range(6 * REMEMBERED):
        at(track, index / 70, index=index)
        assert len(track._positions) <= REMEMBERED


def test_an_attitude_of_the_log_is_taken():
    track = flown([(0, (2, 0, 0)), (1, (2, 0, 0))])
    for seconds in (0, 1):
        track.add(AttitudeSample(seconds * S, LOOKING_NORTH))
    place = at(track, 0.5)
    assert place.attitude == "log"
    assert np.allclose(place.ned_from_camera, NED_FROM_CAMERA)


def test_an_attitude_is_that_of_the_frame_itself():
    """Not of the one before, at whose time the log tells none yet, and later another."""
    looking_east = quaternion_from_rotation(rotation_from_euler(0, 0, np.pi / 2) @ NED_FROM_CAMERA)
    track = flown([(s, (2, 0, 0)) for s in range(4)])
    for seconds, quaternion in ((1, LOOKING_NORTH), (2, looking_east)):
        track.add(AttitudeSample(seconds * S, quaternion))
    places = [at(track, seconds) for seconds in (0.0, 1.0, 2.0)]
    assert [place.attitude for place in places] == ["unknown", "log", "log"]
    assert np.allclose([place.world_from_camera for place in places[1:]], [LOOKING_NORTH, looking_east])


def test_without_attitude_and_direction_it_is_unknown():
    place = at(flown([(0, (2, 0, 0)), (1, (2, 0, 0))]), 0.5)
    assert place.attitude == "unknown"
    assert np.isnan(place.world_from_camera).all()


def test_velocities_of_the_camera_assume_that_it_never_turns():
    place = at(flown([(0, (0, 0, 3)), (1, (0, 0, 3))], "camera"), 0.0)
    assert place.attitude == "assumed"
    assert np.allclose(place.ned_from_camera, NED_FROM_CAMERA)  # it looks north, level
    track = flown([(0, (1, 0, 3)), (1, (1, 0, 3))], "camera")
    at(track, 0.0)
    assert np.allclose(at(track, 1.0).position_ned, (3, 1, 0))  # forward is north, right is east


def moving(direction):
    """A result whose only pair, a frame before, moved that way in the camera's axes, which did not turn."""
    return pairs([1], [direction])


def pairs(shifts, directions):
    """A result of pairs of a camera that did not turn."""
    n = len(shifts)
    result = known(10, (0.5,) * n)
    told = {"shifts": np.array(shifts), "moved_m": np.array(directions, float)}
    told |= {"orientation": SeenOrientation(np.eye(3), 0), "aside_rad": np.full(n, 0.01)}
    for name, value in told.items():
        object.__setattr__(result, name, value)
    return result


@pytest.mark.parametrize(("yaw_deg", "pitch_deg"), [(0, 0), (90, -30), (-120, -60), (45, 10)])
def test_a_level_cameras_attitude_follows_from_the_direction_seen(yaw_deg, pitch_deg):
    true = rotation_from_euler(0, np.radians(pitch_deg), np.radians(yaw_deg)) @ NED_FROM_CAMERA
    velocity = np.array([3.0, 1.0, 0.4])
    track = flown([(s, velocity) for s in range(4)])
    for i in range(30):
        place = at(track, i / 10, moving(true.T @ velocity), i)
    assert place.attitude == "pictures"
    assert np.allclose(place.ned_from_camera, true, atol=1e-6)


def test_of_more_places_than_are_remembered_the_oldest_is_forgotten(monkeypatch):
    monkeypatch.setattr(poses, "REMEMBERED", 3)
    velocity = np.array([3.0, 1.0, 0.4])
    track = flown([(s, velocity) for s in range(10)])
    told = [at(track, i, moving(NED_FROM_CAMERA.T @ velocity), i).attitude for i in range(10)]
    assert told == ["unknown", *["pictures"] * 9]


def test_the_attitude_that_pictures_tell_holds_for_a_fifth_of_a_second():
    """A frame whose own pair tells no direction has that of those before."""
    velocity = np.array([3.0, 1.0, 0.4])
    track = flown([(s, velocity) for s in range(4)])
    for i in range(11):
        at(track, i / 10, moving(NED_FROM_CAMERA.T @ velocity), i)
    assert [at(track, seconds).attitude for seconds in (1.2, 1.3)] == ["pictures", "unknown"]


@given(st.integers(0, 2**40), st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3))
def test_poses_come_back(stamp_ns, position):
    pose = FramePose(7, stamp_ns, 2, np.array(position), LOOKING_NORTH, "log")
    back = poses_from_csv(csv_text(COLUMNS, pose_cells(pose)))[7]
    assert (back.stamp_ns, back.segment, back.attitude) == (stamp_ns, 2, "log")
    assert np.allclose(back.position_ned, position, atol=1e-4)
    assert np.allclose(back.world_from_camera, LOOKING_NORTH)


def test_an_unknown_attitude_comes_back_unknown():
    pose = FramePose(0, 0, 0, np.zeros(3), np.full(4, np.nan), "unknown")
    back = poses_from_csv(csv_text(COLUMNS, pose_cells(pose)))[0]
    assert back.attitude == "unknown"
    assert np.isnan(back.world_from_camera).all()


@given(st.floats(-90, 90), st.floats(-180, 180), st.floats(-400, 9000) | st.just(np.nan))
def test_a_place_comes_back_to_the_millimetre(latitude, longitude, altitude):
    pose = FramePose(0, 0, 0, np.zeros(3), LOOKING_NORTH, "log", np.array([latitude, longitude, altitude]))
    back = poses_from_csv(csv_text(COLUMNS, pose_cells(pose)))[0]
    assert back.place == pytest.approx(pose.place, abs=5.1e-4, nan_ok=True)
    assert back.place[:2] == pytest.approx(pose.place[:2], abs=5.1e-10)


def test_a_table_of_an_older_version_tells_no_places():
    pose = FramePose(0, 0, 0, np.zeros(3), LOOKING_NORTH, "log")
    text = csv_text(COLUMNS[:11], pose_cells(pose)[:11])
    assert np.isnan(poses_from_csv(text)[0].place).all()


def test_the_longest_pair_tells_the_attitude_not_across_a_gap():
    """A pair that reaches back to another segment would compare places with different origins."""
    true = rotation_from_euler(0, np.radians(-30), np.radians(90)) @ NED_FROM_CAMERA
    velocity = np.array([1.0, 3.0, 0.4])
    track = flown([*((s, velocity) for s in range(3)), *((s, velocity) for s in range(9, 12))])
    both = pairs([1, 4], [[1.0, 0, 0], true.T @ velocity])
    told = []
    for i, seconds in enumerate([0.0, 0.5, 1.0, 1.5, 2.0, 9.0, 9.5, 10.0, 10.5, 11.0]):
        told.append(at(track, seconds, both, i))
    assert [place.attitude == "pictures" for place in told] == [i in (4, 9) for i in range(10)]
    assert np.allclose(told[9].ned_from_camera, true, atol=1e-6)


def test_a_place_and_a_time_of_a_table_stand_in_their_columns():
    place = np.array([48.1234567891, 11.1, 520.1234])
    pose = FramePose(
        7, 11, 2, np.array([1.0, 2.0, -3.0]), LOOKING_NORTH, "log", place, 1_777_000_000_000_000_001
    )
    cells = dict(zip(COLUMNS, map(str, pose_cells(pose)), strict=True))
    assert (cells["index"], cells["stamp_ns"], cells["segment"]) == ("7", "11", "2")
    assert [cells[axis] for axis in ("north_m", "east_m", "down_m")] == ["1.0000", "2.0000", "-3.0000"]
    assert (cells["latitude_deg"], cells["longitude_deg"]) == ("48.123456789", "11.100000000")
    assert (cells["altitude_m"], cells["utc_ns"]) == ("520.123", "1777000000000000001")


def test_a_quaternion_of_a_table_stands_in_its_columns():
    """All of LOOKING_NORTH's parts are a half."""
    pose = FramePose(0, 0, 0, np.zeros(3), np.array([0.1, 0.3, 0.5, 0.8]), "log")
    cells = dict(zip(COLUMNS, pose_cells(pose), strict=True))
    told = [cells[part] for part in ("qw", "qx", "qy", "qz")]
    assert told == ["0.100000000", "0.300000000", "0.500000000", "0.800000000"]


def test_an_attitude_that_nobody_knows_of_is_refused():
    pose = FramePose(0, 0, 0, np.zeros(3), LOOKING_NORTH, "log")
    text = csv_text(COLUMNS, pose_cells(pose)).replace("log", "guessed")
    with pytest.raises(ValueError, match="attitude 'guessed'"):
        poses_from_csv(text)


def test_a_trajectory_comes_back_as_a_log(tmp_path):
    """TUM's format is one that is read as well: the same ways and turns between poses, whatever its world's axes."""
    turns = [rotation_from_euler(0.1 * k, -0.2, 0.4 * k) @ NED_FROM_CAMERA for k in range(5)]
    flown = [
        FramePose(
            k, k * 200_000_000, 0, np.array([3.0 * k, -k, 0.1 * k]), quaternion_from_rotation(turn), "log"
        )
        for k, turn in enumerate(turns)
    ]
    zero_ns = 1_700_000_000_123_456_789
    text = tum_trajectory(flown, zero_ns)
    assert text.splitlines()[2].startswith("1700000000.323456789 -1.0000 3.0000 ")
    (tmp_path / "flight.tum").write_text(text)
    samples = read_telemetry(tmp_path / "flight.tum").samples
    back = [sample for sample in samples if isinstance(sample, AttitudeSample)]
    assert [sample.stamp_ns for sample in back] == [k * 200_000_000 for k in range(5)]
    read = [rotation_from_quaternion(sample.world_from_camera) for sample in back]
    for k in range(4):
        np.testing.assert_allclose(read[k].T @ read[k + 1], turns[k].T @ turns[k + 1], atol=1e-7)
    places = np.array([sample.position_ned for sample in samples if isinstance(sample, PositionSample)])
    seen = [read[k].T @ step for k, step in enumerate(np.diff(places, axis=0))]
    told = [turns[k].T @ (flown[k + 1].position_ned - flown[k].position_ned) for k in range(4)]
    np.testing.assert_allclose(seen, told, atol=1e-3)
