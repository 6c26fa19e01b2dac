"""Recordings that tell where the drone is by satellite (NavSatFix), and DJI's velocities, which are bare vectors."""

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.ros import read_ros
from flightdepth.flight.telemetry import read_telemetry
from tests_recordings import ROS_CONTAINERS, Messages, place, write_mcap

NED_M_S = np.array([4.0, -3.0, -0.5])
GLOBAL = "/mavros/global_position/global"
DJI = "/dji_osdk_ros/gps_position"
APPROXIMATED = 1


def fix(made, time_s, ned, *, status=0, altitude=None, sigma_m=1.2):
    height = 150.0 - ned[2] if altitude is None else altitude
    return made_fix(made, time_s, place(ned[0], ned[1]), height, status=status, sigma_m=sigma_m)


def made_fix(made, time_s, place_deg, altitude, *, status=0, sigma_m=0.0):
    return "sensor_msgs/msg/NavSatFix", made.types["NavSatFix"](
        made.header(time_s, "gps"),
        made.types["NavSatStatus"](status, 1),
        *map(float, place_deg),
        float(altitude),
        np.diag([sigma_m**2] * 3).ravel(),
        APPROXIMATED if sigma_m else 0,
    )


def vector(made, time_s, values, frame):
    return "geometry_msgs/msg/Vector3Stamped", made.types["Vector3Stamped"](
        made.header(time_s, frame), made.vector(values)
    )


def at(times_s, topic, message):
    return [(topic, time_s, message(time_s)) for time_s in times_s]


MADE = Messages("cdr")
TIMES_S = np.arange(60) / 10


def flown(topic=GLOBAL, **told):
    return at(TIMES_S, topic, lambda time_s: fix(MADE, time_s, NED_M_S * time_s, **told))


@pytest.mark.parametrize("container", ROS_CONTAINERS)
def test_where_nothing_else_tells_it_the_receivers_positions_tell_the_velocity(tmp_path, container):
    """Such a recording was refused: MAVROS's of an ArduPilot without local positions, most of a receiver's own."""
    write, serial = ROS_CONTAINERS[container]
    made = Messages(serial)
    told = at(TIMES_S, GLOBAL, lambda time_s: fix(made, time_s, NED_M_S * time_s))
    log = read_telemetry(write(tmp_path / "flight.bag", told))
    assert f"of {GLOBAL}, by its positions" in log.name
    assert len(log.velocities) == len(TIMES_S)
    assert {sample.frame for sample in log.velocities} == {"world"}
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)
    assert log.counts == {}


def test_the_error_bar_is_what_the_positions_scatter_by_and_not_how_far_off_the_place_may_be(tmp_path):
    """1.2 m are told of each place; neighbours are off by the same, but for 5 cm."""
    rng = np.random.default_rng(0)
    off = np.array([1.0, -0.6, 2.0])
    told = at(
        TIMES_S, GLOBAL, lambda time_s: fix(MADE, time_s, off + NED_M_S * time_s + rng.normal(0, 0.05, 3))
    )
    found = read_ros(write_mcap(tmp_path / "flight.mcap", told)).velocities[5:-5]
    errors = np.array([sample.velocity - NED_M_S for sample in found])
    assert np.sqrt((errors**2).mean()) == pytest.approx(np.mean([s.sigma for s in found]), rel=0.5)


def test_a_pose_that_moves_is_better_and_what_stands_still_is_worse(tmp_path):
    home = at(TIMES_S, "/home_point", lambda time_s: fix(MADE, time_s, (9.0, 9.0, 0.0)))
    still = at(TIMES_S, "/odom", lambda time_s: MADE.odometry(time_s, (0, 0, 0)))
    log = read_ros(write_mcap(tmp_path / "a.mcap", [*home, *home, *still, *flown()]))
    assert f"of {GLOBAL}, by" in log.name
    pose = at(TIMES_S, "/pose", lambda time_s: MADE.pose_stamped(time_s, (1, 0, 0, 0), "map", (time_s, 0, 0)))
    assert "of /pose, by" in read_ros(write_mcap(tmp_path / "b.mcap", [*flown(), *pose])).name
    twist = at(TIMES_S[:3], "/twist", lambda time_s: MADE.twist_stamped(time_s, (7, 0, 0), "map"))
    assert "of /twist;" in read_ros(write_mcap(tmp_path / "c.mcap", [*flown(), *pose, *twist])).name


@pytest.mark.parametrize("status", [-1, 0])
def test_before_its_first_fix_a_receiver_tells_no_place(tmp_path, status):
    """By its status; DJI's driver tells none, and 0, 0 until then."""
    before = at(TIMES_S[:20] - 2.0, DJI, lambda time_s: made_fix(MADE, time_s, (0, 0), 0, status=status))
    lost = at([2.55], DJI, lambda time_s: fix(MADE, time_s, (40.0, 40.0, 9.0), status=-1))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*before, *flown(DJI), *lost]))
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)
    assert log.counts == {"positions without a fix": 21}
    assert log.velocities[0].stamp_ns == 0


def test_a_status_that_the_driver_left_unset_is_not_one_of_no_fix(tmp_path):
    log = read_ros(write_mcap(tmp_path / "flight.mcap", flown(status=-2)))
    assert (len(log.velocities), log.counts) == (60, {})


@pytest.mark.parametrize("wrong", [(np.nan, 2.2), (91.0, 2.2), (48.7, 181.0)])
def test_what_is_no_place_on_earth_is_no_fix(tmp_path, wrong):
    odd = at([2.55], GLOBAL, lambda time_s: made_fix(MADE, time_s, wrong, 150))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*flown(), *odd]))
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)
    assert log.counts == {"positions without a fix": 1}


def test_of_what_is_not_used_nothing_is_counted(tmp_path):
    twist = at(TIMES_S, "/twist", lambda time_s: MADE.twist_stamped(time_s, (7, 0, 0), "map"))
    lost = at(TIMES_S, GLOBAL, lambda time_s: fix(MADE, time_s, (0, 0, 0), status=-1))
    assert read_ros(write_mcap(tmp_path / "flight.mcap", [*twist, *lost])).counts == {}


def test_one_without_an_altitude_is_as_high_as_those_around_it(tmp_path):
    """NaN, as sensor_msgs says; some tell it of fixes in two dimensions."""
    flat = at([2.55, 2.65], GLOBAL, lambda time_s: fix(MADE, time_s, NED_M_S * time_s, altitude=np.nan))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*flown(), *flat]))
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)
    assert log.counts == {"positions without an altitude": 2}


def test_where_no_altitude_is_told_the_flight_is_taken_as_level(tmp_path):
    log = read_ros(write_mcap(tmp_path / "flight.mcap", flown(altitude=np.nan)))
    assert np.allclose([sample.velocity for sample in log.velocities], (4.0, -3.0, 0.0), atol=1e-3)
    assert log.counts == {"positions without an altitude": 60}


def test_a_position_that_jumps_is_counted(tmp_path):
    jump = at([2.55], GLOBAL, lambda time_s: fix(MADE, time_s, (900.0, 0.0, 0.0)))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*flown(), *jump]))
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)
    assert log.counts == {"positions that jump": 1}


def test_so_is_one_in_metres(tmp_path):
    """A pose of motion capture that lost its marker for a moment; it was left out without a word."""
    east_m_s = 2.0
    poses = [
        (t, MADE.pose_stamped(t, (1, 0, 0, 0), place=(5000.0 if k == 25 else east_m_s * t, 0, 0)))
        for k, t in enumerate(TIMES_S)
    ]
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [("/pose", t, pose) for t, pose in poses]))
    assert np.allclose([sample.velocity for sample in log.velocities], (0, east_m_s, 0), atol=1e-3)
    assert log.counts == {"positions that jump": 1}


YEARS_S = 50 * 365.25 * 86400


@pytest.mark.parametrize("kind", ["fixes", "poses"])
def test_a_clock_that_is_set_within_a_recording_costs_nothing(tmp_path, kind):
    """A computer without a clock of its own begins in 1970 and hears of the time later: numpy wanted 12 GiB."""

    def told(at_s):
        time_s, ned = at_s - YEARS_S * (at_s < 3), NED_M_S * at_s
        enu = ned[[1, 0, 2]] * [1, 1, -1]
        return (
            fix(MADE, time_s, ned) if kind == "fixes" else MADE.pose_stamped(time_s, (1, 0, 0, 0), place=enu)
        )

    log = read_ros(write_mcap(tmp_path / "flight.mcap", at(TIMES_S, GLOBAL, told)))
    assert len(log.velocities) == len(TIMES_S)
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)


def test_a_recording_of_fixes_that_stand_still_names_its_topics(tmp_path):
    still = at(TIMES_S, GLOBAL, lambda time_s: fix(MADE, time_s, (0.0, 0.0, 0.0)))
    with pytest.raises(BadInput, match=rf"got {GLOBAL} \(sensor_msgs/msg/NavSatFix\)"):
        read_ros(write_mcap(tmp_path / "flight.mcap", still))


@pytest.mark.parametrize(
    ("topic", "frame"),
    [("/dji_osdk_ros/velocity", "ground_ENU"), ("/wrapper/psdk_ros2/velocity_ground_fused", "psdk_map_enu")],
)
def test_djis_drivers_tell_velocities_as_vectors(tmp_path, topic, frame):
    told = at(TIMES_S, topic, lambda time_s: vector(MADE, time_s, (5.0, 1.0, -0.25), frame))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*flown(DJI), *told]))
    assert f"of {topic};" in log.name
    assert np.allclose([sample.velocity for sample in log.velocities], (1.0, 5.0, 0.25))


@pytest.mark.parametrize(
    ("topic", "frame"),
    [("/imu/mag", "ground_ENU"), ("/wrapper/psdk_ros2/angular_rate_ground_fused", "map_enu")],
)
def test_other_vectors_are_no_velocities(tmp_path, topic, frame):
    told = at(TIMES_S, topic, lambda time_s: vector(MADE, time_s, (5.0, 1.0, -0.25), frame))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*flown(DJI), *told]))
    assert f"of {DJI}, by" in log.name
    assert log.counts == {}


def test_a_vector_whose_axes_nobody_tells_is_counted_and_positions_tell_the_velocity(tmp_path):
    """DJI's first versions: north, east, up in a frame that they call "/map"."""
    told = at(TIMES_S, "/dji_sdk/velocity", lambda time_s: vector(MADE, time_s, (4.0, -3.0, 0.5), "/map"))
    log = read_ros(write_mcap(tmp_path / "flight.mcap", [*flown(DJI), *told]))
    assert f"of {DJI}, by" in log.name
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=1e-3)
    assert log.counts == {"velocities of unknown axes (frame '/map')": 60}
