"""The health state machine: what happened when, and what it says at which time. Times are seconds."""

import pytest

from flightdepth.live.health import (
    LATE,
    LENS,
    NO_TELEMETRY,
    OLD,
    PREPARING,
    REBOOTED,
    SILENT,
    SLOW,
    STARTING,
    STUCK,
    HealthMonitor,
)
from flightdepth.live.status import State
from flightdepth.ranges.repeats import FROZEN

FRAME_S = 1 / 30


class Flight:
    """A flight at 30 frames/s whose parts can be switched off."""

    def __init__(self, start_s=100.0):
        self.now_s = start_s
        self.monitor = HealthMonitor(ns(start_s), faster="--no-align")

    def fly(
        self,
        seconds,
        *,
        pictures=True,
        results=True,
        no_depth=None,
        doubt=None,
        velocity=True,
        age=30,
    ):
        """The health after each frame's time; what is off does not happen meanwhile."""
        healths = []
        for _ in range(round(seconds / FRAME_S)):
            self.now_s += FRAME_S
            now = ns(self.now_s)
            if velocity:
                self.monitor.velocity(now)
            if pictures:
                self.monitor.picture(now)
            if pictures and results:
                self.monitor.result(now, no_depth=no_depth, age_ms=age, doubt=doubt)
            healths.append(self.monitor.judge(now))
        return healths

    def noticed_s(self, state, reason, **off):
        """Seconds until `state` for `reason` is told."""
        began = self.now_s
        for _ in range(300):
            health = self.fly(FRAME_S, **off)[-1]
            if health.state is state and health.reason.startswith(reason):
                return self.now_s - began
        raise AssertionError(f"still {health}")


def ns(seconds):
    return round(seconds * 1e9)


@pytest.fixture
def flight():
    well = Flight()
    well.fly(3)
    return well


def test_a_lens_that_its_turns_deny_is_told_until_they_no_longer_do_and_after_what_passes(flight):
    flight.monitor.lens_doubt = "focal length 390 px, where the turns tell 300"
    health = flight.fly(0.1)[-1]
    assert health.state is State.DEGRADED
    assert health.reason == f"{LENS}: focal length 390 px, where the turns tell 300"
    assert flight.fly(1, velocity=False)[-1].reason.startswith(LATE)
    assert flight.fly(1)[-1].reason.startswith(LENS)
    flight.monitor.lens_doubt = None
    assert flight.fly(1)[-1].state is State.OK


def test_before_anything_it_is_lost():
    monitor = HealthMonitor(ns(5))
    health = monitor.judge(ns(6))
    assert (health.state, health.reason, health.since_ns) == (State.LOST, STARTING, ns(5))


def test_a_camera_that_does_not_answer_is_told_with_its_error():
    monitor = HealthMonitor(0)
    monitor.stream_failed("Connection refused")
    assert monitor.judge(ns(1)).reason == f"{STARTING}: Connection refused"


def test_what_comes_instead_of_pictures_stands_in_the_reason(flight):
    flight.monitor.instead = "90 packets of another kind"
    flight.monitor.stream_failed("nothing came in time")
    assert flight.fly(3, pictures=False)[-1].reason == f"{SILENT}: 90 packets of another kind came"
    flight.monitor.instead = None
    assert flight.fly(1, pictures=False)[-1].reason == f"{SILENT}: nothing came in time"


def test_pictures_without_a_first_result_are_the_networks_preparation():
    assert Flight().fly(4, results=False)[-1].reason == PREPARING


def test_all_well_is_ok_and_stays_so(flight):
    assert {health.state for health in flight.fly(5)} == {State.OK}
    assert flight.fly(1)[-1].reason is None


@pytest.mark.parametrize(
    ("off", "state", "reason", "within_s"),
    [
        ({"pictures": False}, State.LOST, SILENT, 2.0),
        ({"results": False}, State.LOST, STUCK, 2.2),
        ({"no_depth": f"{FROZEN}: the same for 0.31 s"}, State.DEGRADED, FROZEN, 0.4),
        ({"velocity": False}, State.DEGRADED, LATE, 0.6),
        ({"no_depth": "hovering: flown 0.01 m"}, State.DEGRADED, "hovering", 0.4),
        ({"no_depth": "turns 3.0 degrees in 0.10 s"}, State.DEGRADED, "turns", 0.4),
        ({"age": 400}, State.DEGRADED, OLD, 0.1),
    ],
)
def test_each_trouble_is_told_in_time_and_ends(flight, off, state, reason, within_s):
    assert flight.noticed_s(state, reason, **off) <= within_s
    assert flight.fly(2, **off)[-1].reason.startswith(reason)
    after = flight.fly(1.5)
    assert after[-1].state is State.OK
    assert sum(health.state is not State.OK for health in after) * FRAME_S < 0.7


def test_what_a_sink_lacks_is_told_until_it_has_it(flight):
    flight.monitor.lacking = "obstacles are unknown: nobody tells the drone's heading"
    assert flight.fly(1)[-1].state is State.DEGRADED
    assert flight.noticed_s(State.DEGRADED, FROZEN, no_depth=FROZEN) < 2  # worse things first
    flight.monitor.lacking = None
    assert flight.fly(2)[-1].state is State.OK


def test_no_telemetry_since_the_start():
    assert Flight().fly(1, velocity=False)[-1].reason == NO_TELEMETRY


def test_why_the_link_is_down_stands_in_the_reason_until_a_velocity_comes(flight):
    flight.monitor.link_failed("MAVLink /dev/ttyACM0: no such port")
    assert flight.fly(0.1)[-1].state is State.OK
    flight.monitor.link_failed("MAVLink /dev/ttyACM0: no such port")
    assert flight.fly(1, velocity=False)[-1].reason.endswith(" s; MAVLink /dev/ttyACM0: no such port")
    flight.fly(1)
    assert "MAVLink" not in flight.fly(1, velocity=False)[-1].reason


def test_a_link_that_never_came_up_is_told_too():
    flight = Flight()
    flight.monitor.link_failed("MAVLink tcp:x:1: refused")
    assert flight.fly(1, velocity=False)[-1].reason == f"{NO_TELEMETRY}: MAVLink tcp:x:1: refused"


def test_what_telemetry_tells_instead_of_velocities_stands_in_the_reason(flight):
    """A link that works and brings none of use looked like one that is down, or whose last error stands."""
    flight.monitor.link_failed("MAVLink tcp:x:1: refused")
    flight.monitor.untold = "stuck velocities are left out"
    assert flight.fly(1, velocity=False)[-1].reason.endswith(" s; stuck velocities are left out")
    silent = Flight()
    silent.monitor.untold = "nothing comes over udpin:0.0.0.0:14550"
    assert silent.fly(1, velocity=False)[-1].reason == f"{NO_TELEMETRY}: {silent.monitor.untold}"
    assert flight.fly(2)[-1].state is State.OK


def test_a_reboot_is_told_for_five_seconds(flight):
    flight.monitor.rebooted(ns(flight.now_s))
    told = [health.reason for health in flight.fly(4.9)]
    assert set(told) == {REBOOTED}
    assert flight.fly(1)[-1].state is State.OK


def test_one_frame_without_depth_is_no_trouble(flight):
    for _ in range(5):
        assert flight.fly(2 * FRAME_S, no_depth="hovering: 0 m")[-1].state is State.OK
        assert flight.fly(0.3)[-1].state is State.OK


def test_telemetry_that_the_pictures_deny_is_told_at_once(flight):
    denied = "the pictures deny the log's direction: 90 degrees off"
    assert flight.noticed_s(State.DEGRADED, denied, doubt=denied) < 2 * FRAME_S
    assert flight.fly(1)[-1].state is State.OK


def test_flickering_trouble_does_not_flicker_in_the_state(flight):
    flight.fly(1, velocity=False)
    states = [flight.fly(FRAME_S, velocity=i % 10 != 0)[-1].state for i in range(10)]
    assert set(states) == {State.DEGRADED}


def test_ages_that_swing_about_their_limit_do_not_flicker_in_the_reason(flight):
    """It said `recovering from results are old` after each result that was in time."""
    told = {health.kind for i in range(60) for health in flight.fly(FRAME_S, age=(260, 240, 230, 251)[i % 4])}
    assert told == {(State.DEGRADED, OLD)}
    assert flight.fly(1, age=240)[-1].state is State.OK


def test_a_rate_that_swings_about_its_limit_does_not_flicker_in_the_reason(flight):
    told, flight.monitor.pictures_hz = set(), 30.0
    for i in range(60):
        flight.monitor.taken_hz = 7.9 + 0.2 * (i % 2)
        told.add(flight.fly(FRAME_S)[-1].kind)
    assert told == {(State.DEGRADED, SLOW)}
    assert flight.fly(1)[-1].state is State.OK


def test_since_holds_while_only_figures_change(flight):
    healths = flight.fly(3, velocity=False)
    late = [health for health in healths if health.reason and health.reason.startswith(LATE)]
    assert len({health.since_ns for health in late}) == 1
    assert len({health.reason for health in late}) > 5  # the figure counts on


def test_a_source_that_died_is_not_a_frozen_picture(flight):
    """For half a second, before no picture had come for long enough."""
    told = {health.kind[1] for health in flight.fly(3, pictures=False) if health.reason}
    assert told == {SILENT}


def test_a_slow_machine(flight):
    flight.monitor.pictures_hz, flight.monitor.taken_hz = 30.0, 3.0
    told = flight.fly(FRAME_S)[-1].reason
    assert told == f"{SLOW}: 3.0 results a second of 30 pictures; --no-align take less time"
    flight.monitor.pictures_hz, flight.monitor.taken_hz = 4.0, 4.0  # a slow camera is none
    assert flight.fly(1)[-1].state is State.OK


def test_the_worst_is_told_first(flight):
    assert flight.fly(3, pictures=False, velocity=False)[-1].reason == SILENT


def test_after_silence_the_estimator_gets_its_time(flight):
    flight.fly(5, pictures=False)
    assert flight.fly(1, results=False)[-1].state is not State.LOST


def test_pictures_that_never_could_be_used_are_no_preparation():
    flight = Flight()
    flight.monitor.refused("camera: expected its shape, got 100x100")
    assert flight.fly(1, results=False)[-1].reason == f"{STUCK}: camera: expected its shape, got 100x100"


def test_a_network_that_is_prepared_for_another_size_is_not_stuck(flight):
    """It was told that there are no results, as of an estimator that hangs."""
    flight.monitor.preparing = True
    assert flight.fly(3, results=False)[-1].reason == PREPARING
    flight.monitor.preparing = False
    assert flight.fly(1, results=False)[-1].reason == STUCK


def test_why_pictures_cannot_be_used_is_told(flight):
    flight.monitor.refused("camera: expected its shape, got 100x100")
    assert flight.fly(3, results=False)[-1].reason.startswith(f"{STUCK}: camera")


@pytest.mark.parametrize(
    ("lacks", "limit_s", "reason"),
    [("picture", 1.5, SILENT), ("result", 2.0, STUCK), ("velocity", 0.5, LATE), ("depth", 0.3, "hovering")],
)
def test_each_thing_may_lack_for_so_long_and_no_longer(lacks, limit_s, reason):
    monitor = HealthMonitor(0)
    for hundredth in range(round(100 * limit_s) + 2):
        now = ns(10 + hundredth / 100)
        if lacks != "picture" or not hundredth:
            monitor.picture(now)
        if lacks != "velocity" or not hundredth:
            monitor.velocity(now)
        if lacks != "result" or not hundredth:
            monitor.result(now, no_depth="hovering" if lacks == "depth" and hundredth else None, age_ms=30)
        told = monitor.judge(now).reason
        assert (told or "").startswith(reason) == (hundredth > round(100 * limit_s))


def test_all_is_well_half_a_second_after_the_last_trouble():
    monitor, told = HealthMonitor(0), []
    for hundredth in range(120):
        now = ns(10 + hundredth / 100)
        monitor.picture(now)
        monitor.velocity(now)
        monitor.result(now, no_depth=None, age_ms=30, doubt="denied" if hundredth == 20 else None)
        told.append(monitor.judge(now).reason)
    assert told == [None] * 20 + ["denied"] + ["recovering from denied"] * 49 + [None] * 50


@pytest.mark.parametrize(
    ("pictures_hz", "taken_hz", "slow"),
    [(30, 7.9, True), (30, 8.1, False), (5, 2.4, True), (5, 2.6, False), (30, 0, False)],
)
def test_a_machine_is_slow_below_8_results_a_second_or_half_of_the_pictures(
    flight, pictures_hz, taken_hz, slow
):
    """None at all is nothing to judge by: a session begins so."""
    flight.monitor.pictures_hz, flight.monitor.taken_hz = float(pictures_hz), float(taken_hz)
    assert (flight.fly(FRAME_S)[-1].state is State.DEGRADED) == slow


def test_what_fails_again_after_all_went_well_is_news():
    monitor = HealthMonitor(0)
    assert [monitor.stream_failed(why) for why in ("refused", "refused", "timed out")] == [True, False, True]
    monitor.picture(1)
    assert monitor.stream_failed("timed out")
    assert [monitor.link_failed(why) for why in ("no port", "no port")] == [True, False]
    monitor.velocity(1)
    assert monitor.link_failed("no port")


def test_a_refused_picture_is_forgotten_with_the_next_result(flight):
    flight.monitor.refused("camera: expected its shape, got 100x100")
    flight.fly(1)
    assert flight.fly(3, results=False)[-1].reason == STUCK
