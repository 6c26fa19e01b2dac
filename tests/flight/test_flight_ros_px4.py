"""PX4's own messages in ROS 2 recordings."""

import shutil
import sqlite3
from contextlib import closing, suppress

import numpy as np
import pytest
from px4_files import (
    GIMBAL,
    GIMBAL_1_13,
    ODOMETRY_1_13,
    POSITION_1_16,
    POSITION_OLD,
    SINCE_POWER_US,
    SYNCED_US,
    attitude,
    gimbal,
    odometry,
    of_ros,
    position,
    write_px4,
    write_px4_mcap,
    write_px4_ros1,
)

from flightdepth.errors import BadInput
from flightdepth.flight.ros import read_ros
from flightdepth.flight.ros_frames import ros_frames
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_euler, rotation_from_quaternion
from tests_logs import quaternion, velocity
from tests_recordings import START_NS, Messages

MADE = Messages("cdr")
PICTURE = np.full((8, 8, 3), 90, np.uint8)


def flight(rows=30, **options):
    """A velocity and an attitude every 0.1 s."""
    return [
        message for i in range(rows) for message in (position(i, **options), attitude(i, **clock_of(options)))
    ]


def clock_of(options):
    return {name: value for name, value in options.items() if name == "clock_us"}


def without_definitions(folder):
    """As ROS 2 writes SQLite before Iron."""
    (file,) = folder.glob("*.db3")
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("DROP TABLE message_definitions")
    return folder


CONTAINERS = {
    "MCAP of rosbags": write_px4,
    "SQLite with definitions": lambda path, messages: write_px4(path, messages, "SQLITE3"),
    "MCAP with .msg texts": write_px4_mcap,
    "ROS 1": write_px4_ros1,
    "MCAP, zstd": lambda path, messages: write_px4_mcap(path, messages, compression="ZSTD"),
}


@pytest.mark.parametrize("container", CONTAINERS)
def test_what_px4_publishes_is_read_from_each_container(tmp_path, container):
    """Was refused: ROS does not ship the definitions of PX4's messages."""
    telemetry = read_telemetry(CONTAINERS[container](tmp_path / "flight", flight()))
    assert [tuple(sample.velocity) for sample in telemetry.velocities] == [velocity(i) for i in range(30)]
    assert [sample.stamp_ns for sample in telemetry.velocities] == [i * 100_000_000 for i in range(30)]
    assert {sample.frame for sample in telemetry.velocities} == {"world"}
    assert telemetry.velocities[0].sigma == pytest.approx(np.sqrt((0.5**2 + 0.25**2) / 3))
    for i, body in enumerate(telemetry.body_attitudes):
        assert body.stamp_ns == i * 100_000_000
        np.testing.assert_allclose(body.world_from_body, quaternion(i), atol=1e-6)
    assert len(telemetry.body_attitudes) == 30
    assert telemetry.counts == {}
    assert "of /fmu/out/vehicle_local_position_v1; its time 0 is 1700000000.000 s" in telemetry.name
    assert not telemetry.time_0_told  # no picture in it


def test_sqlite_without_definitions_is_refused_with_what_to_do(tmp_path):
    path = without_definitions(write_px4(tmp_path / "flight", flight(), "SQLITE3"))
    with pytest.raises(BadInput, match=r"60 messages of PX4 whose definition .* Record as MCAP") as refused:
        read_telemetry(path)
    assert "/fmu/out/vehicle_local_position_v1 (px4_msgs/msg/VehicleLocalPosition)" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_without_definitions_another_velocity_is_taken_and_the_lack_is_told(tmp_path):
    others = [of_ros("/odom", i / 10, MADE.odometry(i / 10, (4, 1, 0))) for i in range(5)]
    path = without_definitions(write_px4(tmp_path / "flight", [*flight(4), *others], "SQLITE3"))
    telemetry = read_telemetry(path)
    assert len(telemetry.velocities) == 5
    assert telemetry.counts == {"messages of PX4 whose definition the recording does not hold": 8}


def test_a_definition_without_a_text_is_none(tmp_path):
    """So rosbag2 writes MCAP where px4_msgs is not sourced."""
    path = write_px4_mcap(
        tmp_path / "flight.mcap", [(*each[:3], "", *each[4:]) for each in flight()], encoding=""
    )
    with pytest.raises(BadInput, match="where px4_msgs is sourced"):
        read_telemetry(path)


def test_fields_that_a_version_lacks_are_not_missed(tmp_path):
    assert len(POSITION_OLD) < len(POSITION_1_16)
    path = write_px4_mcap(tmp_path / "flight.mcap", [position(i, definition=POSITION_OLD) for i in range(5)])
    found = read_telemetry(path).velocities
    assert [tuple(sample.velocity) for sample in found] == [velocity(i) for i in range(5)]
    assert {sample.sigma for sample in found} == {None}


def test_a_version_without_what_a_velocity_needs_is_told(tmp_path):
    short = POSITION_1_16.replace("bool v_z_valid\n", "")
    path = write_px4_mcap(tmp_path / "flight.mcap", [position(i, definition=short) for i in range(5)])
    with pytest.raises(BadInput, match="1 topics without the field v_z_valid"):
        read_telemetry(path)


@pytest.mark.parametrize("flag", ["v_xy_valid", "v_z_valid"])
def test_velocities_marked_invalid_are_left_out(tmp_path, flag):
    messages = [position(i, **({flag: False} if i < 10 else {})) for i in range(30)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert [tuple(sample.velocity) for sample in telemetry.velocities] == [velocity(i) for i in range(10, 30)]
    assert telemetry.counts == {"velocities marked invalid": 10}


def test_where_all_are_invalid_the_refusal_says_so(tmp_path):
    path = write_px4_mcap(tmp_path / "flight.mcap", [position(i, v_xy_valid=False) for i in range(30)])
    with pytest.raises(BadInput, match="30 velocities marked invalid"):
        read_telemetry(path)


def test_an_invalid_position_leaves_the_velocity_to_an_odometry(tmp_path):
    messages = [position(i, v_xy_valid=False) for i in range(30)]
    messages += [of_ros("/odom", i / 10, MADE.odometry(i / 10, (4, 1, 0))) for i in range(5)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert "of /odom" in telemetry.name
    assert telemetry.counts == {}


def test_px4s_own_velocity_comes_before_any_odometry(tmp_path):
    messages = [*flight(5), *(odometry(i, velocity_frame=1) for i in range(20))]
    messages += [of_ros("/odom", i / 10, MADE.odometry(i / 10, (4, 1, 0))) for i in range(20)]
    path = write_px4_mcap(tmp_path / "flight.mcap", messages)
    assert "of /fmu/out/vehicle_local_position_v1" in read_ros(path).name
    assert "of /odom" in read_ros(path, topic="/odom").name


@pytest.mark.parametrize("frame", [1, 2])
def test_an_odometry_of_px4_in_the_world(tmp_path, frame):
    messages = [odometry(i, velocity_frame=frame, velocity_variance=(0.09, 0.04, 0.01)) for i in range(30)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert [tuple(sample.velocity) for sample in telemetry.velocities] == [velocity(i) for i in range(30)]
    assert telemetry.velocities[0].sigma == pytest.approx(np.sqrt(0.14 / 3))
    np.testing.assert_allclose(telemetry.body_attitudes[3].world_from_body, quaternion(3), atol=1e-6)


@pytest.mark.parametrize("definition", [None, ODOMETRY_1_13])
def test_an_odometry_of_px4_in_the_body_is_turned_by_its_attitude(tmp_path, definition):
    known = {} if definition is None else {"definition": definition}
    path = write_px4_mcap(tmp_path / "f.mcap", [odometry(i, velocity_frame=3, **known) for i in range(5)])
    found = read_telemetry(path).velocities
    expected = [rotation_from_quaternion(quaternion(i)) @ velocity(i) for i in range(5)]
    np.testing.assert_allclose([sample.velocity for sample in found], expected, atol=1e-5)


def test_variances_that_nobody_set_are_no_deviation(tmp_path):
    path = write_px4_mcap(tmp_path / "flight.mcap", [odometry(i, velocity_frame=1) for i in range(5)])
    assert {sample.sigma for sample in read_telemetry(path).velocities} == {None}


def test_frames_of_px4_1_13_count_from_0(tmp_path):
    variances = np.zeros(21)
    variances[[0, 6, 11]] = 0.09, 0.04, 0.01
    messages = [
        odometry(i, definition=ODOMETRY_1_13, velocity_frame=0, velocity_covariance=variances)
        for i in range(5)
    ]
    found = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages)).velocities
    assert [tuple(sample.velocity) for sample in found] == [velocity(i) for i in range(5)]
    assert found[0].sigma == pytest.approx(np.sqrt(0.14 / 3))


def test_an_odometry_of_an_unknown_frame_is_counted_not_guessed(tmp_path):
    path = write_px4_mcap(tmp_path / "flight.mcap", [odometry(i, velocity_frame=0) for i in range(5)])
    with pytest.raises(BadInput, match="5 velocities of unknown axes"):
        read_telemetry(path)


def test_velocities_that_are_not_known_are_left_out(tmp_path):
    """PX4 tells NaN for what a visual odometry does not know."""
    messages = [
        odometry(i, velocity_frame=1, **({"velocity": (np.nan,) * 3} if i < 2 else {})) for i in range(5)
    ]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert len(telemetry.velocities) == 3
    assert telemetry.counts == {"velocities that are not numbers": 2}


# A gimbal that looks down by 30 degrees; yaw by the heading (32) or from north (64).
DOWN = rotation_from_euler(0, -np.pi / 6, 0)
DOWN_WXYZ = (np.cos(np.pi / 12), 0, -np.sin(np.pi / 12), 0)
EAST_WXYZ = (np.sqrt(0.5), 0, 0, np.sqrt(0.5))
CAMERA_AXES = np.array(
    [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
)  # x forward, y right, z down from right, down, forward


@pytest.mark.parametrize(("flags", "heading_rad"), [(32, np.pi / 2), (64, 0.0)])
def test_a_gimbals_attitude_is_the_cameras(tmp_path, flags, heading_rad):
    messages = [position(i) for i in range(10)] + [attitude(i, q=EAST_WXYZ) for i in range(10)]
    messages += [gimbal(i, q=DOWN_WXYZ, device_flags=flags) for i in range(10)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert len(telemetry.attitudes) == 10
    expected = rotation_from_euler(0, 0, heading_rad) @ DOWN @ CAMERA_AXES
    found = rotation_from_quaternion(telemetry.attitudes[4].world_from_camera)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert "attitude of the camera" in telemetry.name


def test_flags_that_a_damaged_definition_calls_no_integers_are_read(tmp_path):
    """Ended in a traceback, in a ULog too."""
    odd = GIMBAL.replace("uint16 device_flags", "float64 device_flags")
    messages = [position(i) for i in range(5)]
    messages += [gimbal(i, q=DOWN_WXYZ, device_flags=64.0, definition=odd) for i in range(5)]
    assert len(read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages)).attitudes) == 5


def test_a_gimbal_without_a_heading_is_counted(tmp_path):
    messages = [position(i) for i in range(10)]
    messages += [gimbal(i, q=DOWN_WXYZ, definition=GIMBAL_1_13) for i in range(10)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert telemetry.counts == {"gimbal attitudes without a heading": 10}


def test_the_attitude_of_the_velocitys_source_comes_before_one_with_another_north(tmp_path):
    others = [of_ros("/vio", i / 50, MADE.odometry(i / 50, (0, 0, 0))) for i in range(50)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", [*flight(10), *others]))
    assert len(telemetry.body_attitudes) == 10


def test_resets_of_the_attitude_are_told(tmp_path):
    messages = [position(i) for i in range(10)]
    messages += [attitude(i, quat_reset_counter=i // 4) for i in range(10)]
    assert "(2 resets of the attitude)" in read_telemetry(write_px4_mcap(tmp_path / "f.mcap", messages)).name


# The clock.


def pictured(messages, *, ahead_s=0.0):
    """The same flight with pictures from time 1 s on, which are recorded 50 ms late."""
    pictures = [
        of_ros("/camera/image_raw", 1.05 + i / 10, MADE.image(1.0 + i / 10 + ahead_s, PICTURE + i, "rgb8"))
        for i in range(5)
    ]
    return sorted([*messages, *pictures], key=lambda each: each[1])


@pytest.mark.parametrize(("clock_us", "late_ns"), [(SYNCED_US, 0), (SINCE_POWER_US, 8_000_000)])
def test_pictures_share_the_clock(tmp_path, clock_us, late_ns):
    """Synchronised by the agent, or since power-up: then by the way of the messages, 8 ms here."""
    path = write_px4_mcap(tmp_path / "flight.mcap", pictured(flight(clock_us=clock_us)))
    telemetry = read_telemetry(path)
    frames = list(ros_frames(path))
    assert [frame.stamp_ns for frame in frames] == [i * 100_000_000 for i in range(5)]
    assert frames[0].image[0, 0, 0] == 90
    stamps_ns = np.array([sample.stamp_ns for sample in telemetry.velocities])
    np.testing.assert_array_equal(stamps_ns, np.arange(-10, 20) * 100_000_000 + late_ns)
    assert "its time 0 is 1700000001.000 s" in telemetry.name
    assert telemetry.counts == {}


@pytest.mark.parametrize("clock_us", [SINCE_POWER_US, SYNCED_US])
def test_pictures_with_the_time_of_a_simulation(tmp_path, clock_us):
    """Their clock and PX4's begin at 7 s while the recorder tells the time of day, or PX4 does too."""
    ahead_s = SINCE_POWER_US / 1e6 - START_NS / 1e9
    path = write_px4_mcap(tmp_path / "flight.mcap", pictured(flight(clock_us=clock_us), ahead_s=ahead_s))
    stamps_ns = np.array([sample.stamp_ns for sample in read_telemetry(path).velocities])
    np.testing.assert_allclose(stamps_ns, np.arange(-10, 20) * 1e8, atol=60e6)
    assert len(list(ros_frames(path))) == 5


def test_a_second_power_up_in_a_recording_is_placed_by_its_own(tmp_path):
    first = [position(i, clock_us=SINCE_POWER_US) for i in range(20)]
    second = [position(i, clock_us=SINCE_POWER_US - 5_000_000) for i in range(60, 80)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", [*first, *second]))
    stamps_ns = [sample.stamp_ns for sample in telemetry.velocities]
    assert stamps_ns == [i * 100_000_000 for i in (*range(20), *range(60, 80))]


def test_a_moment_out_of_step_is_placed_by_the_recorder(tmp_path):
    """PX4's client falls back to its own clock while it seeks that of its agent again."""
    messages = [position(i, clock_us=SINCE_POWER_US if 10 <= i < 15 else SYNCED_US) for i in range(30)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    late_ns = [8_000_000 if 10 <= i < 15 else 0 for i in range(30)]
    assert [sample.stamp_ns for sample in telemetry.velocities] == [
        i * 100_000_000 + late for i, late in enumerate(late_ns)
    ]


@pytest.mark.parametrize("stamp_us", [0, 5, 2**63, 2**64 - 1])
def test_a_damaged_time_costs_its_message_only(tmp_path, stamp_us):
    messages = [position(i, **({"timestamp": stamp_us} if i == 7 else {})) for i in range(30)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert len(telemetry.velocities) == 29
    assert telemetry.counts == {"records with a damaged time": 1}


def test_a_time_of_measurement_that_is_not_set_is_that_of_publication(tmp_path):
    messages = [odometry(i, velocity_frame=1, timestamp_sample=0) for i in range(5)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert "its time 0 is 1700000000.002 s" in telemetry.name


# Faults.


def single_sqlite(path, messages):
    folder = write_px4(path.with_suffix(".folder"), messages, "SQLITE3")
    return shutil.move(next(folder.glob("*.db3")), path)


FILES = {"MCAP": write_px4_mcap, "SQLite": single_sqlite}


@pytest.mark.parametrize("container", FILES)
def test_a_cut_recording_gives_what_came_before(tmp_path, container):
    whole = FILES[container](tmp_path / "whole", flight(12))
    data, cut, lengths = whole.read_bytes(), tmp_path / "cut", []
    for end in [*range(1, len(data), max(1, len(data) // 60)), len(data)]:
        cut.write_bytes(data[:end])
        try:
            telemetry = read_telemetry(cut)
        except BadInput:
            lengths.append(0)
            continue
        found = [tuple(sample.velocity) for sample in telemetry.velocities]
        assert found == [velocity(i) for i in range(len(found))]
        assert telemetry.counts or len(found) == 12, f"{end} of {len(data)} bytes: the cut is not told"
        lengths.append(len(found))
    assert lengths == sorted(lengths)
    assert lengths[-1] == 12


def trashed(data, seed):
    """A few bytes changed, lost or doubled."""
    chance = np.random.default_rng(seed)
    out = bytearray(data)
    for at in chance.integers(len(data) - 64, size=chance.choice([1, 3, 20])):
        length, what = chance.integers(1, 64), chance.integers(3)
        out[at : at + (1, length, 0)[what]] = (chance.bytes(1), b"", out[at : at + length])[what]
    return bytes(out)


@pytest.mark.parametrize("container", FILES)
def test_trash_is_refused_or_counted(tmp_path, container):
    data = FILES[container](tmp_path / "whole", pictured(flight(12))).read_bytes()
    damaged, read = tmp_path / "damaged", 0
    for seed in range(200):
        damaged.write_bytes(trashed(data, seed))
        with suppress(BadInput):
            read += all(np.isfinite(sample.velocity).all() for sample in read_telemetry(damaged).velocities)
    assert read > 20


@pytest.mark.parametrize(
    "definition",
    [
        "string[100000000] timestamp\n",  # rosbags unfolds it for half a minute
        "VehicleLocalPosition itself\n",
        "Unknown timestamp\n",
        "uint8[4000000000] timestamp\n",
        POSITION_1_16.replace("uint64 timestamp", "float64 timestamp", 1),
        "no definition $$$",
        "\0",
    ],
)
def test_a_definition_that_is_no_message_of_numbers_is_damage(tmp_path, definition):
    messages = [(*each[:3], definition, *each[4:]) for each in (position(i) for i in range(3))]
    path = write_px4_mcap(tmp_path / "flight.mcap", messages)
    with pytest.raises(BadInput, match="3 messages that cannot be read"):
        read_telemetry(path)


def test_a_definition_that_changes_on_the_way_costs_the_rest(tmp_path):
    messages = [position(i, definition=POSITION_1_16 if i < 5 else POSITION_OLD) for i in range(8)]
    telemetry = read_telemetry(write_px4_mcap(tmp_path / "flight.mcap", messages))
    assert len(telemetry.velocities) == 5
    assert telemetry.counts == {"messages that cannot be read": 3}
