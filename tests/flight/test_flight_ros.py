import shutil
import sqlite3
import sys
from collections import Counter
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import zstandard

from flightdepth.errors import BadInput, MissingExtra
from flightdepth.flight import ros_messages
from flightdepth.flight.records import AttitudeSample, VelocitySample
from flightdepth.flight.ros import read_ros
from flightdepth.flight.ros2_bag import ros2_messages
from flightdepth.flight.ros_frames import ros_frames
from flightdepth.flight.ros_messages import (
    Orientation,
    axes_of,
    body_attitudes,
    camera_attitudes,
    frd_from_body,
    ned_from_map,
)
from flightdepth.flight.ros_records import ZSTD_MAGIC, DamagedError
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion
from tests_recordings import ROS_CONTAINERS, Messages, odometry_flight, write_mcap, write_ros1, write_ros2

MADE = Messages("cdr")
YAW_90 = (np.sqrt(0.5), 0, 0, np.sqrt(0.5))  # about up, from x to y: in ENU a body that looks north


def samples(path, kind=VelocitySample, **options):
    return [sample for sample in read_ros(path, **options).samples if isinstance(sample, kind)]


def recorded(tmp_path, *messages):
    """An MCAP of (topic, message), a message every 50 ms."""
    timed = [(topic, index / 20, message) for index, (topic, message) in enumerate(messages)]
    return write_mcap(tmp_path / "flight.mcap", timed)


@pytest.mark.parametrize("container", ROS_CONTAINERS)
def test_a_constant_velocity_comes_back_from_each_container(tmp_path, container):
    write, serial = ROS_CONTAINERS[container]
    # The body's x points east (no rotation in ENU): 4 forward, 1 left, -0.5 up is 1 north, 4 east, 0.5 down.
    path = write(tmp_path / "flight.bag", odometry_flight(serial, linear=(4.0, 1.0, -0.5)))
    telemetry = read_telemetry(path)
    found = telemetry.velocities
    assert np.allclose([sample.velocity for sample in found], (1.0, 4.0, 0.5))
    assert [sample.stamp_ns for sample in found] == [50_000_000 * index for index in range(40)]
    assert {round(sample.sigma, 9) for sample in found} == {0.1}
    assert telemetry.counts == {}


def test_odometry_is_turned_by_its_pose(tmp_path):
    # The body looks north: 4 forward, 1 left is 4 north, -1 east.
    path = recorded(tmp_path, ("/odom", MADE.odometry(0, (4, 1, 0), YAW_90)))
    assert np.allclose(samples(path)[0].velocity, (4, -1, 0))
    [body] = read_ros(path).body_attitudes
    assert np.allclose(rotation_from_quaternion(body.world_from_body), np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("frame", "child"), [("map", ""), ("map", "map")])
def test_odometry_without_a_body_is_in_the_map(tmp_path, frame, child):
    path = recorded(tmp_path, ("/odom", MADE.odometry(0, (4, 1, -2), YAW_90, frame=frame, child=child)))
    assert np.allclose(samples(path)[0].velocity, (1, 4, 2))


def test_a_map_that_is_ned_by_name_stays(tmp_path):
    path = recorded(
        tmp_path, ("/odom", MADE.odometry(0, (4, 1, -2), frame="odom_ned", child="base_link_frd"))
    )
    assert np.allclose(samples(path)[0].velocity, (4, 1, -2))
    assert np.allclose(read_ros(path).body_attitudes[0].world_from_body, (1, 0, 0, 0))


@pytest.mark.parametrize("frame", ["map_ned", "/ned", "local_origin_NED", "worldNED"])
def test_a_frame_is_ned_by_its_last_word(frame):
    assert axes_of(frame) == "world"
    assert np.array_equal(ned_from_map(frame), np.eye(3))


@pytest.mark.parametrize(("frame", "axes"), [("odom_combined", "world"), ("aligned", ""), ("Combined", "")])
def test_a_word_that_ends_like_ned_is_not_ned(tmp_path, frame, axes):
    """Found in review: climbs of robot_pose_ekf's odom_combined became falls."""
    assert axes_of(frame) == axes
    path = recorded(tmp_path, ("/odom", MADE.odometry(0, (4, 1, 2), frame=frame, child="")))
    assert np.allclose(samples(path)[0].velocity, (1, 4, -2))


@pytest.mark.parametrize(
    "frame", ["uav1_odom", "drone_map", "base_odom", "uav0_world", "fcu_map", "drone_0_local_origin"]
)
def test_a_map_that_a_vehicle_names_is_a_map(tmp_path, frame):
    """It was taken for a body, and what was seen from there for nothing that tells where the drone is."""
    path = recorded(tmp_path, ("/twist", MADE.twist_stamped(0, (4, 1, -2), frame)))
    assert samples(path)[0].frame == "world"
    assert np.allclose(samples(path)[0].velocity, (1, 4, 2))


@pytest.mark.parametrize("frame", ["imu_enu", "uav1/base_link", "base_link_frd"])
def test_a_body_is_no_map(frame):
    assert axes_of(frame) == "body"


def test_a_map_whose_z_points_down_stays(tmp_path):
    path = recorded(tmp_path, ("/twist", MADE.twist_stamped(0, (4, 1, -2), "odom_frd")))
    assert np.allclose(samples(path)[0].velocity, (4, 1, -2))


@pytest.mark.parametrize("frame", ["map", "odom", "world", "/local_origin"])
def test_a_twist_in_a_map_is_enu(tmp_path, frame):
    path = recorded(
        tmp_path, ("/mavros/local_position/velocity_local", MADE.twist_stamped(0, (4, 1, -2), frame))
    )
    assert np.allclose(samples(path)[0].velocity, (1, 4, 2))


def test_mavros_names_the_body_over_a_velocity_of_the_map(tmp_path):
    path = recorded(
        tmp_path,
        ("/mavros/local_position/pose", MADE.pose_stamped(0.0, YAW_90)),
        ("/mavros/local_position/velocity_local", MADE.twist_stamped(0.05, (5, 0, 1), "base_link")),
    )
    assert np.allclose(samples(path)[0].velocity, (0, 5, -1))


def test_mavros_global_odometry_is_taken_last_and_not_turned(tmp_path):
    """It is east, north, down in the map, though it says base_link."""
    topic = "/mavros/global_position/local"
    alone = [(topic, MADE.odometry(index / 20, (5, 0, -1), YAW_90)) for index in range(4)]
    assert np.allclose(samples(recorded(tmp_path, *alone))[0].velocity, (0, 5, -1))
    local = ("/mavros/local_position/odom", MADE.odometry(0.2, (1, 0, 0), YAW_90))
    assert "of /mavros/local_position/odom" in read_ros(recorded(tmp_path, *alone, local)).name


def test_a_twist_of_the_body_is_turned_by_the_pose_of_that_time(tmp_path):
    path = recorded(
        tmp_path,
        ("/mavros/local_position/pose", MADE.pose_stamped(0.0, YAW_90)),
        ("/mavros/local_position/velocity_body", MADE.twist_stamped(0.05, (4, 1, 0), "base_link")),
    )
    [sample] = samples(path)
    assert sample.frame == "world"
    assert np.allclose(sample.velocity, (4, -1, 0))


def test_a_twist_between_two_poses_is_turned_by_what_lies_between(tmp_path):
    """A body that turns by 40 degrees a second, its pose 6 times a second: the nearest was off by up to 3 degrees."""
    timed = []
    for k in range(7):
        half = np.radians(40 * k / 6) / 2  # about up, anticlockwise from east
        timed.append(("/pose", k / 6, MADE.pose_stamped(k / 6, (np.cos(half), 0, 0, np.sin(half)))))
    at_s = np.arange(1, 19) / 20
    timed += [("/twist", at, MADE.twist_stamped(at, (5.0, 0.0, 0.0), "base_link")) for at in at_s]
    found = [sample.velocity for sample in samples(write_mcap(tmp_path / "flight.mcap", timed))]
    course = np.radians(40 * at_s)
    expected = np.stack([5 * np.sin(course), 5 * np.cos(course), 0 * course], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_a_twist_of_the_body_alone_is_that_of_a_camera_that_looks_forward(tmp_path):
    path = recorded(tmp_path, ("/velocity", MADE.twist_stamped(0, (4, 1, -0.5), "base_link")))
    [sample] = samples(path)
    assert sample.frame == "camera"
    assert np.allclose(sample.velocity, (-1, 0.5, 4))  # right, down, forward


def test_a_twist_of_the_body_before_its_first_pose_is_left_out_and_counted(tmp_path):
    path = recorded(
        tmp_path,
        ("/mavros/local_position/velocity_body", MADE.twist_stamped(0.0, (4, 1, 0), "base_link")),
        ("/mavros/local_position/pose", MADE.pose_stamped(1.0, YAW_90)),
        ("/mavros/local_position/velocity_body", MADE.twist_stamped(1.05, (4, 1, 0), "base_link")),
    )
    [sample] = samples(path)
    assert sample.frame == "world"
    assert read_ros(path).counts == {"velocities without an orientation near them": 1}


def test_a_cameras_orientations_do_not_hide_the_drones(tmp_path):
    odometry = [
        MADE.odometry(t, (0, 0, 2), (0.5, -0.5, 0.5, -0.5), child="camera_optical_frame")
        for t in (0.01, 0.02, 0.03)
    ]
    path = recorded(
        tmp_path,
        ("/mavros/local_position/pose", MADE.pose_stamped(0.0, YAW_90)),
        *(("/vio", message) for message in odometry),
        ("/mavros/local_position/velocity_body", MADE.twist_stamped(0.05, (4, 1, 0), "base_link")),
    )
    [sample] = samples(path, topic="/mavros/local_position/velocity_body")
    assert sample.frame == "world"
    assert np.allclose(sample.velocity, (4, -1, 0))
    assert len(read_ros(path).body_attitudes) == 1


def test_an_optical_frame_is_the_camera_s(tmp_path):
    path = recorded(
        tmp_path,
        ("/velocity", MADE.twist_stamped(0, (1, 2, 3), "camera_optical_frame")),
        ("/vio", MADE.odometry(0.05, (0, 0, 2), (0.5, -0.5, 0.5, -0.5), child="camera_optical_frame")),
    )
    assert samples(path, topic="/velocity")[0].frame == "camera"
    assert np.allclose(samples(path, topic="/velocity")[0].velocity, (1, 2, 3))
    # That quaternion is FLU from optical: the camera looks along the map's x, east.
    assert np.allclose(samples(path)[0].velocity, (0, 2, 0))
    [attitude] = samples(path, AttitudeSample)
    axes = rotation_from_quaternion(attitude.world_from_camera)
    assert np.allclose(axes, [[-1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12)


def test_the_best_topic_is_chosen_and_another_can_be_asked_for(tmp_path):
    path = recorded(
        tmp_path,
        ("/twist", MADE.twist_stamped(0.00, (1, 0, 0), "map")),
        ("/twist", MADE.twist_stamped(0.05, (1, 0, 0), "map")),
        ("/sure", MADE.twist_with_covariance(0.1, (2, 0, 0), "map", 0.3)),
        ("/odom", MADE.odometry(0.15, (3, 0, 0), child="")),
    )
    assert [sample.velocity[1] for sample in samples(path)] == [3]
    assert [sample.velocity[1] for sample in samples(path, topic="/twist")] == [1, 1]
    [sure] = samples(path, topic="/sure")
    assert sure.sigma == pytest.approx(0.3)
    with pytest.raises(BadInput, match=r"a velocity in /none, got /odom \(nav_msgs/msg/Odometry\), /sure"):
        read_ros(path, topic="/none")


def test_an_odometry_whose_twist_is_never_filled_in_comes_after_one_that_moves(tmp_path):
    """Found in review: FAST-LIO tells poses only, and no frame had depth though the autopilot told the speed."""
    lidar = [("/Odometry", MADE.odometry(k / 100, (0, 0, 0))) for k in range(5)]
    real = ("/mavros/local_position/velocity_local", MADE.twist_stamped(0.1, (4, 1, 0), "map"))
    to_do = ("/cmd_vel", MADE.twist_stamped(0.1, (9, 0, 0), "base_link"))
    assert (
        "of /mavros/local_position/velocity_local" in read_ros(recorded(tmp_path, *lidar, to_do, real)).name
    )
    assert "of /Odometry" in read_ros(recorded(tmp_path, *lidar, to_do)).name


ENU_M_S = np.array([4.0, 1.0, -0.5])
PLACED = [(k / 20, ENU_M_S * k / 20) for k in range(60)]


def unfilled_odometry(time_s, place):
    return "/Odometry", MADE.odometry(time_s, (0, 0, 0), frame="camera_init", child="body", place=place)


def bare_pose(time_s, place, frame="map", topic="/vrpn_client_node/drone/pose"):
    return topic, MADE.pose_stamped(time_s, YAW_90, frame, place)


@pytest.mark.parametrize("message", [unfilled_odometry, bare_pose])
def test_where_no_velocity_moves_positions_tell_it(tmp_path, message):
    """Lidar odometry and motion capture tell where, not how fast."""
    path = recorded(tmp_path, *(message(*each) for each in PLACED))
    assert "by its positions" in read_ros(path).name
    found = samples(path)
    assert len(found) == len(PLACED)
    assert {sample.frame for sample in found} == {"world"}
    assert all(np.allclose(sample.velocity, (1.0, 4.0, 0.5), atol=1e-6) for sample in found)


def test_noise_of_positions_is_in_the_error_bar(tmp_path):
    rng = np.random.default_rng(0)
    path = recorded(tmp_path, *(bare_pose(at_s, place + rng.normal(0, 0.02, 3)) for at_s, place in PLACED))
    found = samples(path)
    off = np.array([sample.velocity - (1.0, 4.0, 0.5) for sample in found])[10:-10]
    assert np.sqrt((off**2).mean()) == pytest.approx(
        np.mean([sample.sigma for sample in found[10:-10]]), rel=0.5
    )
    assert np.abs(off).max() < 0.1


def test_a_velocity_that_moves_is_better_than_positions_and_these_than_what_is_asked_for(tmp_path):
    poses = [bare_pose(*each) for each in PLACED]
    real, asked = MADE.twist_stamped(0.1, (7, 0, 0), "map"), MADE.twist_stamped(0.1, (9, 0, 0), "map")
    path = recorded(tmp_path, *poses, ("/cmd_vel", asked), ("/twist", real))
    assert "of /twist;" in read_ros(path).name
    assert (
        "of /vrpn_client_node/drone/pose, by"
        in read_ros(recorded(tmp_path, *poses, ("/cmd_vel", asked))).name
    )


@pytest.mark.parametrize(
    ("frame", "topic"), [("map", "/goal_pose"), ("camera_optical_frame", "/tag"), ("base_link", "/pad")]
)
def test_a_place_to_go_to_and_a_place_that_is_seen_are_not_the_drones(tmp_path, frame, topic):
    path = recorded(tmp_path, *(bare_pose(*each, frame, topic) for each in PLACED))
    with pytest.raises(BadInput, match="expected a topic with a velocity"):
        read_ros(path)


def test_where_nothing_moves_the_best_kind_is_chosen(tmp_path):
    still = ("/twist", MADE.twist_stamped(0.0, (0, 0, 0), "map")), ("/odom", MADE.odometry(0.05, (0, 0, 0)))
    assert "of /odom" in read_ros(recorded(tmp_path, *still)).name


def test_what_a_drone_is_to_do_is_not_taken_for_what_it_does(tmp_path):
    """Setpoints come more often than what they ask for."""
    path = recorded(
        tmp_path,
        ("/mavros/local_position/pose", MADE.pose_stamped(0.0, YAW_90)),
        *(("/mavros/setpoint_position/local", MADE.pose_stamped(k / 100, (1, 0, 0, 0))) for k in range(5)),
        *(("/cmd_vel", MADE.twist_stamped(k / 100, (9, 0, 0), "base_link")) for k in range(5)),
        ("/mavros/local_position/velocity_body", MADE.twist_stamped(0.05, (4, 1, 0), "base_link")),
    )
    [sample] = samples(path)
    assert np.allclose(sample.velocity, (4, -1, 0))
    assert len(samples(path, topic="/cmd_vel")) == 5


def test_a_recording_without_velocity_names_its_topics(tmp_path):
    path = recorded(tmp_path, ("/pose", MADE.pose_stamped(0, (1, 0, 0, 0))))
    with pytest.raises(BadInput, match=r"got /pose \(geometry_msgs/msg/PoseStamped\)"):
        read_ros(path)


def test_a_frame_whose_name_says_nothing_is_counted_not_guessed(tmp_path):
    path = recorded(
        tmp_path,
        ("/a", MADE.twist_stamped(0, (1, 0, 0), "gps")),
        ("/b", MADE.twist_stamped(0.05, (2, 0, 0), "map")),
    )
    assert [sample.velocity[1] for sample in samples(path)] == [2]
    assert read_ros(path).counts == {"velocities of unknown axes (frame 'gps')": 1}


def test_backward_and_double_stamps_are_dropped_and_counted(tmp_path):
    times = [0.0, 0.05, 0.05, 0.02, 0.1]
    path = recorded(tmp_path, *[("/odom", MADE.odometry(time_s, (1, 0, 0))) for time_s in times])
    assert [sample.stamp_ns for sample in samples(path)] == [0, 50_000_000, 100_000_000]
    assert read_ros(path).counts == {"velocities not later than the one before": 2}


def test_a_first_time_that_jumps_is_not_where_times_begin(tmp_path):
    """It is left out, but all times counted from it."""
    times = [400_000_000, *(k / 20 for k in range(1, 10))]
    path = recorded(tmp_path, *[("/odom", MADE.odometry(time_s, (1, 0, 0))) for time_s in times])
    assert [sample.stamp_ns for sample in samples(path)] == [50_000_000 * k for k in range(9)]
    assert read_ros(path).counts == {"velocities not later than the one before": 1}


def test_a_time_that_no_clock_tells_is_damage():
    """MCAP counts in 64 bits without a sign, numpy with one: such a time ended in an OverflowError."""
    unset = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    assert ros_messages.stamp_of(unset, 5) == 5
    with pytest.raises(DamagedError, match="a time"):
        ros_messages.stamp_of(unset, 1 << 63)


def on_a_clock_from_0(time_s, made):
    """A message of a simulation that begins at 0."""
    kind, message = made
    time = MADE.store.types["builtin_interfaces/msg/Time"](int(time_s), round(time_s % 1 * 1e9))
    return kind, replace(message, header=replace(message.header, stamp=time))


def test_the_first_messages_of_a_simulation_are_at_its_0(tmp_path):
    """A time of 0 counted as one that nobody set: the first picture was put 54 years behind all others."""
    black = np.zeros((4, 4, 3), np.uint8)
    timed = [
        (topic, index / 20, on_a_clock_from_0(index / 20, made))
        for index in range(40)
        for topic, made in (("/image", MADE.image(0, black, "rgb8")), ("/odom", MADE.odometry(0, (4, 1, 0))))
    ]
    path = write_mcap(tmp_path / "flight.mcap", timed)
    telemetry, expected_ns = read_ros(path), [50_000_000 * index for index in range(40)]
    assert [sample.stamp_ns for sample in telemetry.velocities] == expected_ns
    assert [body.stamp_ns for body in telemetry.body_attitudes] == expected_ns
    assert [frame.stamp_ns for frame in ros_frames(path)] == expected_ns
    assert telemetry.counts == {} and "time 0 is 0.000 s" in telemetry.name


@pytest.mark.parametrize("unset", [5, 40, 150])
def test_times_that_nobody_set_are_those_of_the_recording(tmp_path, unset):
    timed = [
        (topic, at_s, on_a_clock_from_0(0, made) if index < unset else made)
        for index, (topic, at_s, made) in enumerate(odometry_flight("cdr", rows=max(unset, 40)))
    ]
    telemetry = read_ros(write_mcap(tmp_path / "flight.mcap", timed))
    assert [sample.stamp_ns for sample in telemetry.velocities] == [50_000_000 * k for k in range(len(timed))]
    assert telemetry.counts == {}


@pytest.mark.parametrize(
    "made",
    [
        lambda at_s, place: ("/pose", MADE.pose_stamped(at_s, (0, 0, 0, 0), "map", place)),
        lambda at_s, place: ("/odom", MADE.odometry(at_s, (0, 0, 0), (0, 0, 0, 0), place=place)),
        lambda at_s, place: ("/odom", MADE.odometry(at_s, ENU_M_S, (0, 0, 0, 0), child="")),
    ],
    ids=["pose", "odometry of places", "odometry in the map"],
)
def test_who_tells_no_orientation_tells_the_rest(tmp_path, made):
    """All of it was lost: messages that cannot be read."""
    telemetry = read_ros(recorded(tmp_path, *(made(*each) for each in PLACED)))
    assert len(telemetry.velocities) == len(PLACED)
    assert np.allclose([sample.velocity for sample in telemetry.velocities], (1.0, 4.0, 0.5), atol=1e-6)
    assert telemetry.body_attitudes == () and telemetry.counts == {}


def test_velocities_that_are_not_numbers_and_empty_rotations_are_counted(tmp_path):
    path = recorded(
        tmp_path,
        ("/odom", MADE.odometry(0.00, (np.nan, 0, 0))),
        ("/odom", MADE.odometry(0.05, (1, 0, 0), (0, 0, 0, 0))),
        ("/odom", MADE.odometry(0.10, (1, 0, 0))),
    )
    assert len(samples(path)) == 1
    assert read_ros(path).counts == {"messages that cannot be read": 2}


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_a_folder_that_lost_its_metadata_is_read(tmp_path, plugin):
    path = write_ros2(tmp_path / "flight", odometry_flight("cdr"), plugin)
    (path / "metadata.yaml").unlink()
    assert len(read_telemetry(path).velocities) == 40


def test_files_in_a_folder_are_read_in_the_order_of_their_dates(tmp_path):
    """Only the seconds counted, and the earlier file, read last, was left out."""
    flight = odometry_flight("cdr")
    write_mcap(tmp_path / "flight_2024_05_01-11_59_59.mcap", flight[:20])
    write_mcap(tmp_path / "flight_2024_05_01-12_00_00.mcap", flight[20:])
    telemetry = read_ros(tmp_path)
    assert len(telemetry.velocities) == 40 and telemetry.counts == {}


def test_each_file_that_was_cut_off_is_counted(tmp_path):
    """Of several files in SQLite one was told."""
    whole = next(write_ros2(tmp_path / "whole", odometry_flight("cdr"), "SQLITE3").glob("*.db3")).read_bytes()
    counts = Counter()
    cut = tmp_path / "cut"
    cut.mkdir()
    for number in range(2):
        (cut / f"flight_{number}.db3").write_bytes(whole[:-5000])
    assert list(ros2_messages(cut, lambda kind: True, counts))
    assert counts == {"recordings cut off": 2}


@pytest.mark.parametrize(
    ("write", "serial", "magic"),
    [
        (lambda path, rows: write_ros1(path, rows, "BZ2", chunk_size=4000), "ros1", b"BZh"),
        (lambda path, rows: write_mcap(path, rows, chunk_size=4000), "cdr", ZSTD_MAGIC),
    ],
    ids=["ROS 1", "MCAP"],
)
def test_a_damaged_first_chunk_costs_its_own_messages_alone(tmp_path, write, serial, magic):
    """It tells what is recorded where, and all that came after it was lost with it."""
    path = write(tmp_path / "flight.bag", odometry_flight(serial))
    whole = read_telemetry(path)
    data = path.read_bytes()
    at = data.index(magic) + 10
    path.write_bytes(data[:at] + bytes(byte ^ 0xFF for byte in data[at : at + 40]) + data[at + 40 :])
    telemetry = read_telemetry(path)
    assert 0 < len(whole.velocities) - len(telemetry.velocities) < 10
    assert telemetry.counts == {"damaged chunks": 1}
    path.write_bytes(data[: data.rindex(magic) + 20])  # without an index, and the last chunk, as ever
    assert 30 <= len(read_telemetry(path).velocities) < 40


@pytest.mark.parametrize(("container", "end"), [("ROS 1", 300), ("MCAP, zstd", 60)])
def test_a_damaged_index_costs_nothing(tmp_path, container, end):
    write, serial = ROS_CONTAINERS[container]
    path = write(tmp_path / "flight.bag", odometry_flight(serial))
    data = path.read_bytes()
    for damaged in (data[:-end] + bytes(end), data[:-end] + b"\xff" * end):
        path.write_bytes(damaged)
        assert len(read_telemetry(path).velocities) == 40


@pytest.mark.parametrize("damage", [ZSTD_MAGIC, ZSTD_MAGIC + bytes(20)], ids=["head", "body"])
def test_a_packed_message_that_is_damaged_costs_itself_only(tmp_path, damage):
    """One with a damaged head ended in a traceback, any other in the loss of all that came after it."""
    path = write_ros2(tmp_path / "flight", odometry_flight("cdr"), "SQLITE3")
    (file,) = path.glob("*.db3")
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("UPDATE messages SET data = ? WHERE id = 3", (damage,))
    telemetry = read_telemetry(path)
    assert len(telemetry.velocities) == 39
    assert telemetry.counts == {"damaged records": 1}


@pytest.mark.parametrize("container", ["ROS 2, SQLite", "ROS 2, MCAP", "MCAP, lz4"])
def test_messages_that_are_packed_one_by_one_are_read(tmp_path, monkeypatch, container):
    """Those in MCAP could not be."""
    whole, packed = Messages.bytes_of, zstandard.ZstdCompressor().compress
    monkeypatch.setattr(Messages, "bytes_of", lambda *given: packed(whole(*given)))
    write, serial = ROS_CONTAINERS[container]
    telemetry = read_telemetry(write(tmp_path / "flight", odometry_flight(serial)))
    assert len(telemetry.velocities) == 40 and telemetry.counts == {}


def database(folder, rows=40):
    """A recording in SQLite and its file."""
    path = write_ros2(folder, odometry_flight("cdr", rows=rows), "SQLITE3")
    return path, next(path.glob("*.db3"))


def test_sqlite_that_writes_ahead_leaves_nothing_beside_the_recording(tmp_path):
    """Where it may not write, as on a card that is locked, it read nothing."""
    path, file = database(tmp_path / "flight")
    with closing(sqlite3.connect(file)) as writer:
        writer.execute("PRAGMA journal_mode = WAL")
    there = sorted(path.iterdir())
    assert len(read_telemetry(path).velocities) == 40
    assert sorted(path.iterdir()) == there


def died(path, file, begin):
    """A copy of a recording whose recorder died as it wrote all messages again, 20 s later."""
    copy = path.with_name("died")
    again = "INSERT INTO messages SELECT id + 1000, topic_id, timestamp + 20000000000, data FROM messages"
    with closing(sqlite3.connect(file, isolation_level=None)) as writer:
        for command in (*begin, again):
            writer.execute(command)
        shutil.copytree(path, copy, ignore=shutil.ignore_patterns("*-shm"))
        if writer.in_transaction:
            writer.execute("ROLLBACK")
    return copy


def test_a_recorder_that_died_while_it_wrote_costs_what_it_wrote_then(tmp_path):
    """SQLite wanted to undo that, was not let, and read nothing."""
    path, file = database(tmp_path / "flight", rows=400)
    copy = died(path, file, ["PRAGMA journal_mode = DELETE", "PRAGMA cache_size = 5", "BEGIN"])
    assert list(copy.glob("*-journal"))
    assert len(read_telemetry(copy).velocities) == 400


def test_what_sqlite_wrote_ahead_is_read(tmp_path):
    path, file = database(tmp_path / "flight")
    copy = died(path, file, ["PRAGMA journal_mode = WAL", "PRAGMA wal_autocheckpoint = 0"])
    counts = Counter()
    assert len(list(ros2_messages(copy, lambda kind: True, counts))) == 80
    assert counts == {}


def test_packed_files_that_lie_unpacked_beside_them_are_no_matter(tmp_path):
    """What the remedy leaves: of a recording in several files only one at a time could be read."""
    path, file = database(tmp_path / "flight")
    (path / f"{file.name}.zstd").write_bytes(ZSTD_MAGIC)
    assert len(read_telemetry(path).velocities) == 40


def test_packed_files_are_refused_with_the_remedy(tmp_path):
    (tmp_path / "flight_0.db3.zstd").write_bytes(b"\x28\xb5\x2f\xfd")
    (tmp_path / "metadata.yaml").write_text("x: 1")
    with pytest.raises(BadInput, match=r"zstd -d flight_0\.db3\.zstd"):
        read_telemetry(tmp_path)


def test_a_bag_of_version_1_is_refused(tmp_path):
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V1.2\n")
    with pytest.raises(BadInput, match=r"a ROS bag of version 2\.0, got #ROSBAG V1\.2"):
        read_telemetry(path)


def test_without_rosbags_the_extra_is_named(tmp_path, monkeypatch):
    path = write_ros1(tmp_path / "flight.bag", odometry_flight("ros1", rows=2))
    ros_messages._definitions.cache_clear()
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)  # what Python remembers of a module it must not find
    with pytest.raises(MissingExtra, match=r"flightdepth\[ros\]"):
        read_ros(path)


@pytest.mark.parametrize(
    "imu", [{}, {"wxyz": (0.9, 0.1, 0.2, 0.3), "covariance": 0.1}], ids=["unset", "drifts"]
)
def test_an_imu_does_not_outvote_the_pose(tmp_path, imu):
    """It comes ten times as often; many drivers leave its orientation unset, others lose the heading."""
    path = recorded(
        tmp_path,
        ("/pose", MADE.pose_stamped(0.0, YAW_90)),
        *(("/imu", MADE.imu(0.05 + k / 100, **imu)) for k in range(10)),
        ("/velocity", MADE.twist_stamped(0.1, (4, 1, 0), "base_link")),
    )
    assert np.allclose(samples(path)[0].velocity, (4, -1, 0))


def test_the_velocitys_own_orientations_come_first(tmp_path):
    path = recorded(
        tmp_path,
        *(("/other", MADE.pose_stamped(k / 100, (1, 0, 0, 0))) for k in range(5)),
        ("/odom", MADE.odometry(0.1, (4, 1, 0), YAW_90)),
    )
    [body] = read_ros(path).body_attitudes
    assert np.allclose(rotation_from_quaternion(body.world_from_body), np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("parent", "body"), [("map", "base_link"), ("odom_ned", "imu"), ("map", "base_frd")])
def test_orientations_of_the_drone_are_turned_together_as_one_at_a_time(parent, body):
    given = np.random.default_rng(0).normal(size=(100, 4))
    given *= (1 + np.linspace(-0.009, 0.009, 100)[:, None]) / np.linalg.norm(given, axis=1, keepdims=True)
    told = [
        Orientation(7 + index, quaternion, parent, body) for index, quaternion in enumerate(given.tolist())
    ]
    for index, (quaternion, attitude) in enumerate(zip(given, body_attitudes(told, 7), strict=True)):
        expected = ned_from_map(parent) @ rotation_from_quaternion(quaternion) @ frd_from_body(body).T
        np.testing.assert_allclose(rotation_from_quaternion(attitude.world_from_body), expected, atol=1e-14)
        assert attitude.stamp_ns == index and attitude.world_from_body[0] >= 0


def test_orientations_of_cameras_are_those_of_their_own_axes():
    told = Orientation(7, YAW_90, "map", "camera_optical_frame")
    [attitude] = camera_attitudes([told])
    expected = ned_from_map("map") @ rotation_from_quaternion(YAW_90)
    np.testing.assert_allclose(rotation_from_quaternion(attitude.world_from_camera), expected, atol=1e-15)
    assert camera_attitudes([]) == body_attitudes([]) == []


def test_an_imu_alone_tells_how_the_body_is_turned(tmp_path):
    path = recorded(
        tmp_path,
        ("/imu", MADE.imu(0.0, YAW_90)),
        ("/velocity", MADE.twist_stamped(0.05, (4, 1, 0), "base_link")),
    )
    assert np.allclose(samples(path)[0].velocity, (4, -1, 0))


@pytest.mark.parametrize("frame", ["camera_optical_frame", "base_link"])
def test_the_pose_of_a_marker_that_the_drone_sees_does_not_turn_it(tmp_path, frame):
    """It comes before a mere gyroscope: the velocity was turned by how a landing pad lies."""
    path = recorded(
        tmp_path,
        ("/imu", MADE.imu(0.0, YAW_90)),
        *(("/tag_pose", MADE.pose_stamped(k / 100, (0, 1, 0, 0), frame)) for k in range(5)),
        ("/velocity", MADE.twist_stamped(0.05, (4, 1, 0), "base_link")),
    )
    assert np.allclose(samples(path)[0].velocity, (4, -1, 0))


def of_vehicle(name, velocity, count, *, pictures=0):
    """Odometry and pictures of one of several, 20 a second."""
    black = np.zeros((4, 4, 3), np.uint8)
    told = [
        (f"/{name}/odom", k / 20, MADE.odometry(k / 20, velocity, child="base_link")) for k in range(count)
    ]
    return told + [(f"/{name}/image_raw", k / 20, MADE.image(k / 20, black, "rgb8")) for k in range(pictures)]


def test_the_velocity_is_that_of_the_vehicle_whose_pictures_are_shown(tmp_path):
    """That of whoever told most was taken."""
    messages = of_vehicle("uav1", (4, 0, 0), 20, pictures=20) + of_vehicle("uav2", (0, 7, 0), 25)
    log = read_ros(write_mcap(tmp_path / "flight.mcap", messages))
    assert np.linalg.norm(log.velocities[0].velocity) == pytest.approx(4)
    assert (len(log.velocities), len(log.body_attitudes)) == (20, 20)
    assert log.counts == {"messages of other vehicles": 25}


def test_a_velocity_is_not_turned_by_another_vehicle(tmp_path):
    """A pose comes before a mere gyroscope's: the other vehicle's had turned it."""
    path = recorded(
        tmp_path,
        ("/uav1/imu", MADE.imu(0.0, YAW_90)),
        ("/uav1/velocity", MADE.twist_stamped(0.05, (4, 1, 0), "base_link")),
        *(("/uav2/pose", MADE.pose_stamped(k / 100, (1, 0, 0, 0))) for k in range(5)),
    )
    assert np.allclose(samples(path)[0].velocity, (4, -1, 0))


def test_of_two_cameras_one_may_tell_how_the_other_moves(tmp_path):
    messages = of_vehicle("camera2", (4, 0, 0), 20) + of_vehicle("camera1", (0, 0, 0), 0, pictures=20)
    log = read_ros(write_mcap(tmp_path / "flight.mcap", messages))
    assert (len(log.velocities), log.counts) == (20, {})
