"""MAVLink messages by hand into the feed: what counts, on which clock, and what a reboot does."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from flightdepth.flight.mavlink_messages import GIMBAL
from flightdepth.live.autopilot_feed import AutopilotFeed, AutopilotListener
from flightdepth.live.motion_store import MotionStore
from flightdepth.motion import NED_FROM_CAMERA, rotation_from_quaternion

S, MS = 10**9, 10**6
LEVEL = (1.0, 0.0, 0.0, 0.0)


class Vehicle:
    """Messages of one sender whose power-up was at `zero_s` of our clock, each `delay_ms` on its way."""

    def __init__(self, feed, *, system=1, component=1, zero_s=50.0, delay_ms=20):
        self.feed, self.zero_ns, self.delay_ns = feed, round(zero_s * S), delay_ms * MS
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def send(self, message, at_s):
        """As received: packed and parsed again."""
        parser = mavlink.MAVLink(None)
        (received,) = parser.parse_buffer(bytes(message.pack(self.mav)))
        self.feed.take(received, round(at_s * S) + self.delay_ns)

    def boot_ms(self, at_s):
        return round((at_s * S - self.zero_ns) / MS)

    def heartbeat(self, at_s, autopilot=12, kind=2):
        self.send(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3), at_s)

    def velocity(self, at_s, ned=(3.0, 0.0, 0.0)):
        self.send(mavlink.MAVLink_local_position_ned_message(self.boot_ms(at_s), 0, 0, 0, *ned), at_s)

    def attitude(self, at_s, q=LEVEL):
        self.send(mavlink.MAVLink_attitude_quaternion_message(self.boot_ms(at_s), *q, 0, 0, 0), at_s)

    def gimbal(self, at_s, q=LEVEL, flags=64, device=0):
        message = mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, self.boot_ms(at_s), flags, q, 0, 0, 0, 0, gimbal_device_id=device
        )
        assert message.get_type() == GIMBAL
        self.send(message, at_s)

    def odometry(self, at_s, ned=(9.0, 0.0, 0.0)):
        nothing = [math.nan] * 21
        usec = self.boot_ms(at_s) * 1000
        self.send(
            mavlink.MAVLink_odometry_message(usec, 1, 1, 0, 0, 0, LEVEL, *ned, 0, 0, 0, nothing, nothing),
            at_s,
        )

    def global_position(self, at_s, ned_m_s=(5.0, 0.0, 0.0), place=(481_000_000, 115_000_000)):
        velocity = (round(metres * 100) for metres in ned_m_s)
        self.send(
            mavlink.MAVLink_global_position_int_message(
                self.boot_ms(at_s), *place, 520_000, 12_000, *velocity, 65535
            ),
            at_s,
        )


@pytest.fixture
def store():
    return MotionStore()


@pytest.fixture
def heard():
    return {"velocities": [], "reboots": []}


@pytest.fixture
def feed(store, heard):
    return AutopilotFeed(store, AutopilotListener(heard["velocities"].append, heard["reboots"].append))


@pytest.fixture
def vehicle(feed):
    vehicle = Vehicle(feed)
    vehicle.heartbeat(99.9)
    return vehicle


def test_a_velocity_stands_at_its_time_less_nothing_but_the_way(vehicle, store, heard):
    for i in range(20):
        vehicle.velocity(100 + i / 20, (i, 0.0, 1.0))
    found = store.at(round(100.475 * S) + vehicle.delay_ns)
    np.testing.assert_allclose(found.velocity_ned, [9.5, 0, 1], atol=0.02)
    assert len(heard["velocities"]) == 20


def test_an_answered_question_takes_the_way_out(vehicle, store, feed):
    vehicle.velocity(100)
    at_s = 100.02
    boot_ns = round((at_s + 0.01 - 50) * S)
    vehicle.send(mavlink.MAVLink_timesync_message(boot_ns, round(at_s * S)), at_s)
    vehicle.velocity(101, (7.0, 0.0, 0.0))
    assert store.at(101 * S).velocity_ned[0] == 7.0
    assert feed.boot_ns(101 * S) == 51 * S


def test_the_vehicle_that_is_asked_for_counts(store):
    """Of several on one link the first heard did, whichever was meant."""
    feed = AutopilotFeed(store, AutopilotListener(lambda now_ns: None, lambda now_ns: None), system=7)
    first, wanted = Vehicle(feed), Vehicle(feed, system=7)
    first.heartbeat(100)
    first.velocity(100.1, (1.0, 0.0, 0.0))
    assert feed.instead(101 * S) == "no autopilot's heartbeat of vehicle 7 comes"
    wanted.heartbeat(101)
    wanted.velocity(101.1, (2.0, 0.0, 0.0))
    assert [sample.velocity[0] for sample in store.take_new()] == [2.0]


@pytest.mark.parametrize("moved", [True, False])
def test_an_even_speed_hangs_only_where_the_place_does_too(feed, store, moved):
    """Of centimetres a second, or of a simulator without noise, each is the same: no depth after two seconds."""
    vehicle = Vehicle(feed)
    vehicle.heartbeat(100)
    for i in range(40):
        vehicle.global_position(100.1 + i / 10, place=(481_000_000 + 45 * i * moved, 115_000_000))
    assert feed.counts["stuck velocities"] == (0 if moved else 19)


def test_what_comes_in_place_of_velocities_is_told(feed):
    vehicle = Vehicle(feed)
    now_ns = round(103.5 * S)
    vehicle.heartbeat(100, autopilot=mavlink.MAV_AUTOPILOT_INVALID)  # a ground station's
    assert feed.instead(now_ns) == "no autopilot's heartbeat comes"
    vehicle.heartbeat(100)
    assert feed.instead(now_ns).startswith("the autopilot of vehicle 1 tells none (LOCAL_POSITION_NED, ")
    for i in range(70):
        vehicle.velocity(100 + i / 20)
    assert feed.instead(now_ns) == "stuck velocities are left out"
    vehicle.velocity(103.5, (math.nan, 0.0, 0.0))
    assert feed.instead(now_ns) == "velocities that are not numbers are left out"
    assert feed.instead(now_ns + 2 * S).startswith("the autopilot of vehicle 1 tells none")


def test_of_an_autopilot_that_falls_silent_no_velocity_is_said_to_be_left_out(vehicle, feed):
    """Half a second after one that came twice it was told that such are left out."""
    vehicle.velocity(100)
    vehicle.velocity(100)
    assert feed.instead(round(100.1 * S)) == "velocities not later than the one before are left out"
    vehicle.velocity(100.1)
    assert feed.instead(round(100.7 * S)).startswith("the autopilot of vehicle 1 tells none")


def test_another_vehicle_whose_velocities_come_instead_is_named(vehicle, feed):
    """An autopilot with a new number, or a second drone's, was not to be told from one that says nothing."""
    other = Vehicle(feed, system=9)
    other.velocity(101)
    told = feed.instead(round(101.5 * S))
    assert told.startswith("the autopilot of vehicle 1 tells none (")
    assert told.endswith("); those of vehicle 9 are left out")
    assert "vehicle 9" not in feed.instead(103 * S)


def test_what_a_vehicle_told_before_its_heartbeat_is_not_another_s(feed):
    vehicle = Vehicle(feed)
    vehicle.velocity(100)
    vehicle.heartbeat(100.1)
    assert "left out" not in feed.instead(round(100.5 * S))


def test_nothing_counts_before_an_autopilot_is_known(feed, store, heard):
    vehicle = Vehicle(feed)
    vehicle.velocity(100)
    vehicle.heartbeat(100.1, autopilot=mavlink.MAV_AUTOPILOT_INVALID)
    vehicle.velocity(100.2)
    assert heard["velocities"] == []
    assert store.take_new() == []


def test_an_antenna_tracker_is_no_vehicle(feed):
    """Its autopilot beats as well, often first, and tells that it stands."""
    Vehicle(feed, system=2).heartbeat(100, kind=mavlink.MAV_TYPE_ANTENNA_TRACKER)
    assert feed.vehicle is None
    Vehicle(feed, system=1).heartbeat(100.1)
    assert feed.vehicle.system == 1


def test_another_vehicle_is_counted_and_left_out(vehicle, feed, heard):
    other = Vehicle(feed, system=2)
    other.heartbeat(100)
    other.velocity(100.1)
    vehicle.velocity(100.2)
    assert len(heard["velocities"]) == 1
    assert feed.counts["messages of other vehicles"] == 1


def test_odometry_counts_only_while_nothing_better_comes(vehicle, store):
    vehicle.velocity(100)
    vehicle.odometry(100.1)
    assert [s.velocity[0] for s in store.take_new()] == [3.0]
    vehicle.odometry(101.5)
    assert [s.velocity[0] for s in store.take_new()] == [9.0]


def test_a_global_position_tells_the_velocity_where_nothing_better_comes(vehicle, store, feed):
    """It was not read: an autopilot without local positions flew without a velocity."""
    vehicle.velocity(100)
    vehicle.global_position(100.1)
    assert [s.velocity[0] for s in store.take_new()] == [3.0]
    vehicle.global_position(101.5)
    assert [s.velocity[0] for s in store.take_new()] == [5.0]
    vehicle.global_position(101.6, place=(0, 0))  # before the first fix
    assert store.take_new() == []
    assert feed.counts["positions without a fix"] == 1


def test_a_gimbal_tells_the_camera_on_its_own_clock(vehicle, feed, store):
    gimbal = Vehicle(feed, component=154, zero_s=99.0)
    for i in range(4):
        gimbal.gimbal(100 + i / 10)
    camera = store.at(round(100.3 * S)).world_from_camera
    np.testing.assert_allclose(rotation_from_quaternion(camera), NED_FROM_CAMERA, atol=1e-6)


def test_a_gimbal_whose_time_stays_0_tells_the_camera_when_it_is_heard(feed, store):
    """All but one of its attitudes were left out: not later than the one before."""
    Vehicle(feed).heartbeat(99.9)
    for i in range(5):
        Vehicle(feed, component=154, zero_s=100 + i / 10).gimbal(100 + i / 10)
    stamps, _ = store.cameras_after(0)
    assert np.allclose(np.diff(stamps), 100 * MS) and stamps[-1] == round(100.42 * S)
    assert len(stamps) == 5 and not feed.counts.total()


def test_a_second_gimbal_does_not_mix_in(vehicle, feed):
    Vehicle(feed, component=154).gimbal(100)
    Vehicle(feed, component=171).gimbal(100.1)
    Vehicle(feed, component=154).gimbal(100.2, device=2)
    assert feed.counts["attitudes of other gimbals"] == 2


def test_a_fixed_camera_follows_the_body(heard):
    store = MotionStore(NED_FROM_CAMERA)
    feed = AutopilotFeed(store, AutopilotListener(heard["velocities"].append, heard["reboots"].append))
    vehicle = Vehicle(feed)
    vehicle.heartbeat(99)
    east = (math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4))
    for i in range(3):
        vehicle.attitude(100 + i / 50, east)
    found = store.at(round(100.04 * S)).world_from_camera
    forward = rotation_from_quaternion(found)[:, 2]
    np.testing.assert_allclose(forward, [0, 1, 0], atol=1e-6)


def test_a_reboot_is_told_and_not_integrated_across(vehicle, feed, store, heard):
    for i in range(20):
        vehicle.velocity(100 + i / 10)
    store.take_new()
    vehicle.zero_ns = 102 * S
    for i in range(40):
        vehicle.velocity(102.1 + i / 10)
    stamps = [sample.stamp_ns for sample in store.take_new()]
    assert len(heard["reboots"]) == 1
    assert stamps[0] - 101.9 * S >= 2 * S
    assert stamps == sorted(stamps)
    assert feed.counts["records just after a reboot"] > 10


def test_a_stall_of_the_link_is_no_reboot(vehicle, heard):
    vehicle.velocity(100)
    vehicle.delay_ns = 3 * S
    vehicle.velocity(101)
    vehicle.delay_ns = 20 * MS
    vehicle.velocity(105)
    assert heard["reboots"] == []


JUMPS = "jumps of the autopilot's clock"


def flying(vehicle, first_s, last_s, *, asked):
    """Velocities at 20 Hz and, if `asked`, each second an answer to a question; at the true time the speed north."""
    for tick in range(round(first_s * 20), round(last_s * 20)):
        at_s = tick / 20
        vehicle.velocity(at_s, (at_s % 10, 0.0, 0.0))
        if asked and tick % 20 == 0:
            boot_ns = round(at_s * S) + vehicle.delay_ns // 2 - vehicle.zero_ns
            vehicle.send(mavlink.MAVLink_timesync_message(boot_ns, round(at_s * S)), at_s)


@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize("jump_s", [0.5, 0.9, 10.0, 3600.0])
def test_a_jump_of_the_clock_is_followed(vehicle, feed, store, jump_s, asked):
    """Ten seconds long answers from before it counted: half a second ahead, or all left out as damage."""
    flying(vehicle, 100, 105, asked=asked)
    store.take_new()
    vehicle.zero_ns -= round(jump_s * S)
    flying(vehicle, 105, 110, asked=asked)
    samples = store.take_new()
    assert len(samples) >= 100 - 2 - 1  # two to be sure; after the next answer one stands earlier by the way
    off_s = [sample.stamp_ns / S % 10 - sample.velocity[0] for sample in samples]
    assert max(np.abs(off_s)) < 0.03
    assert feed.counts[JUMPS] == (asked or jump_s > 2)
    assert feed.counts["records with a damaged time"] == 2 * feed.counts[JUMPS]


@pytest.mark.parametrize("asked", [True, False])
def test_one_damaged_time_is_neither_a_jump_nor_a_reboot(vehicle, feed, store, heard, asked):
    """The next good one looked like a reboot."""
    flying(vehicle, 100, 103, asked=asked)
    vehicle.zero_ns -= 100 * S
    vehicle.velocity(103)
    vehicle.zero_ns += 100 * S
    flying(vehicle, 103.05, 104, asked=asked)
    assert heard["reboots"] == []
    assert feed.counts[JUMPS] == 0
    assert feed.counts["records with a damaged time"] == 1
    assert len(store.take_new()) >= 78


def test_a_stall_of_the_link_is_no_jump(vehicle, feed):
    flying(vehicle, 100, 103, asked=True)
    vehicle.delay_ns = 3 * S
    vehicle.velocity(103)
    vehicle.delay_ns = 20 * MS
    flying(vehicle, 106.05, 108, asked=True)
    assert feed.counts[JUMPS] == feed.counts["records with a damaged time"] == 0


@pytest.mark.parametrize(("orientation", "height"), [(25, 12.34), (0, None)])
def test_only_a_range_finder_that_looks_down_tells_the_height(vehicle, store, orientation, height):
    vehicle.send(mavlink.MAVLink_distance_sensor_message(0, 20, 4000, 1234, 0, 0, orientation, 0), 100)
    assert store.at(100 * S).height_above_ground_m == height


def test_a_range_finder_at_its_end_tells_nothing(vehicle, store):
    vehicle.send(mavlink.MAVLink_distance_sensor_message(0, 20, 4000, 4001, 0, 0, 25, 0), 100)
    assert store.at(100 * S).height_above_ground_m is None


@pytest.mark.parametrize(("quality", "height"), [(0, 0.3), (100, 0.3), (1, None)])
def test_a_range_finder_without_an_echo_tells_no_height(vehicle, feed, store, quality, height):
    """`signal_quality` 1: 0.3 m at 30 m over ground, and the corridor ended there."""
    message = mavlink.MAVLink_distance_sensor_message(0, 20, 4000, 30, 0, 0, 25, 0, signal_quality=quality)
    vehicle.send(message, 100)
    assert store.at(100 * S).height_above_ground_m == height
    assert feed.counts["heights of a range finder without an echo"] == (height is None)


def test_old_motion_is_not_given_for_new(vehicle, store):
    vehicle.velocity(100)
    vehicle.attitude(100)
    late = store.at(102 * S)
    assert late.velocity_ned is None
    assert late.world_from_body is None


def test_an_hour_takes_no_more_memory_than_a_minute(vehicle, feed, store):
    for i in range(1500):
        vehicle.velocity(100 + i / 50, (i % 7, 0.0, 0.0))
        if i % 50 == 0:
            store.take_new()
    assert len(feed._gate.velocities) == 1
    assert len(store._velocities) <= 4 * 50 + 2
