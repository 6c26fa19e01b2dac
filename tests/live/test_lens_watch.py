"""Whether a live camera's turns deny its lens: points of benchmarks/turned_focal.py, attitudes that stream in late."""

from __future__ import annotations

import importlib
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightdepth.flight.mask import PictureMask
from flightdepth.flight.records import AttitudeSample, BodyAttitudeSample
from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.flight.turned_focal import TurnedFocal
from flightdepth.live import lens_watch
from flightdepth.live.health import LENS, HealthMonitor
from flightdepth.live.lens_watch import LEAST_NEW, MOST_PAIRS, MOST_WAITING, LensWatch
from flightdepth.live.motion_store import MotionStore
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.ranges.repeats import FROZEN

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
simulated = importlib.import_module("turned_focal")
Case = simulated.Case

EPOCH_NS = 5_000 * 10**9
LATE_S = 0.15  # of the attitudes, after the pictures
HOVERING = Case(lasts_s=26.0)
FLYING = Case(lasts_s=32.0, speed_m_s=5.0)
GIVEN = simulated.PINHOLE.resized(640, 360)
IMAGE = np.zeros((360, 640, 3), np.uint8)
DENIED = TurnVerdict(TurnedFocal(None), doubt="focal length 594 px, where the turns tell 457")
UNKNOWN = TurnVerdict(TurnedFocal(None, reason="the camera hardly turns"))
WRONG = replace(GIVEN, fx=1.3 * GIVEN.fx, fy=1.3 * GIVEN.fy)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


class Flight:
    """Pictures of a case, ten a second, in which points are followed, and attitudes of the drone, or of its gimbal."""

    def __init__(self, monkeypatch, case, *, attitude_hz=50.0, gimbal=False, verdict=None):
        self.case, self.rng, self.gimbal = case, np.random.default_rng(0), gimbal
        turned = simulated.angles(case, self.rng)
        self.seen, self.judged = simulated.pictured(case, turned), []
        every = round(simulated.GRID_HZ / attitude_hz)
        times = (np.arange(len(turned)) / simulated.GRID_HZ - simulated.EDGE_S)[::every]
        self.told = list(zip(times, simulated.rotations(turned)[::every], strict=True))
        monkeypatch.setattr(lens_watch, "small_grey", lambda image, small: image)
        monkeypatch.setattr(lens_watch, "follow", self.follow)
        judge = lens_watch.judged_by_turns

        def noted(*arguments):
            self.judged.append(self.now_s)
            return verdict or judge(*arguments)

        monkeypatch.setattr(lens_watch, "judged_by_turns", noted)

    def follow(self, before_s, after_s, shown):
        self.shown = shown
        assert after_s - before_s == pytest.approx(simulated.PAIR_S)
        return *simulated.followed(self.case, self.seen, after_s, self.rng), 60

    def fly(self, watch, store, camera=GIVEN, reason=None):
        depth = SimpleNamespace(reason=reason)
        for now_s in np.arange(0.1, self.case.lasts_s, 0.1):
            while self.told and self.told[0][0] <= now_s - LATE_S:
                store.add(self.attitude(*self.told.pop(0)), 0)
            self.now_s, stamp_ns = now_s, EPOCH_NS + round(now_s * 1e9)
            watch.take(SimpleNamespace(stamp_ns=stamp_ns, image=now_s, camera=camera, depth=depth))

    def attitude(self, at_s, world_from_camera):
        stamp_ns = EPOCH_NS + round(1000 * at_s) * 10**6  # an autopilot tells whole milliseconds
        if self.gimbal:
            return AttitudeSample(stamp_ns, quaternion_from_rotation(world_from_camera))
        return BodyAttitudeSample(stamp_ns, quaternion_from_rotation(world_from_camera @ NED_FROM_CAMERA.T))


def flown(monkeypatch, case=HOVERING, camera=GIVEN, *, mount=NED_FROM_CAMERA, **keywords):
    """A watch after a flight, and when it judged."""
    flight, store = Flight(monkeypatch, case, **keywords), MotionStore(mount)
    watch = LensWatch(store)
    flight.fly(watch, store, camera)
    return watch, flight.judged


def focals(doubt):
    """Focal lengths given and told, px."""
    return [
        float(each) for each in re.match(r"focal length (\d+) px, where the turns tell (\d+)", doubt).groups()
    ]


@pytest.mark.parametrize(
    ("case", "attitude_hz"),
    [slow(HOVERING, 5.0), (FLYING, 5.0), slow(FLYING, 50.0), (replace(FLYING, shake_deg=0.5), 10.0)],
)
def test_the_right_lens_agrees(monkeypatch, case, attitude_hz):
    watch, _ = flown(monkeypatch, case, attitude_hz=attitude_hz)
    assert watch.verdict.agrees and watch.verdict.doubt is None
    assert re.fullmatch(r"agrees with its turns within [2-5]%", str(watch.verdict))


@pytest.mark.parametrize(
    ("case", "factor", "attitude_hz"),
    [slow(HOVERING, 1.3, 50.0), slow(FLYING, 1.3, 10.0), (FLYING, 1.3, 5.0), (FLYING, 1 / 1.3, 50.0)],
)
def test_a_wrong_lens_is_denied_with_both_focal_lengths(monkeypatch, case, factor, attitude_hz):
    wrong = replace(GIVEN, fx=factor * GIVEN.fx, fy=factor * GIVEN.fy)
    watch, _ = flown(monkeypatch, case, wrong, attitude_hz=attitude_hz)
    assert focals(watch.verdict.doubt) == pytest.approx([wrong.fx, GIVEN.fx], rel=0.05)
    assert "depths flying sideways are" in watch.verdict.doubt and "calibrate" in watch.verdict.doubt


def test_points_of_what_is_masked_are_not_followed(monkeypatch):
    shown = np.ones((72, 128), np.bool_)
    shown[:, 64:] = False
    flight, store = Flight(monkeypatch, replace(HOVERING, lasts_s=4.0)), MotionStore(NED_FROM_CAMERA)
    flight.fly(LensWatch(store, mask=PictureMask(Path("mask.png"), shown)), store)
    assert flight.shown[:, :80].all()
    assert not flight.shown[:, 80:].any()


def test_attitudes_of_the_drone_alone_tell_nothing(monkeypatch):
    """A gimbal may be in between."""
    watch, judged = flown(monkeypatch, camera=WRONG, mount=None)
    assert (watch.verdict, judged) == (None, [])


def test_attitudes_of_a_gimbal_do(monkeypatch):
    watch, _ = flown(monkeypatch, camera=WRONG, mount=None, gimbal=True, attitude_hz=10.0)
    assert focals(watch.verdict.doubt) == pytest.approx([WRONG.fx, GIVEN.fx], rel=0.05)


@pytest.mark.parametrize(
    ("case", "attitude_hz"),
    [(replace(HOVERING, turn_deg=0.0, shake_deg=0.0), 50.0), (HOVERING, 2.0)],
    ids=["no turns", "told twice a second"],
)
def test_without_turns_that_are_told_nothing_is_said_of_the_lens(monkeypatch, case, attitude_hz):
    watch, _ = flown(monkeypatch, case, WRONG, attitude_hz=attitude_hz)
    assert watch.verdict is None or not watch.verdict.decided


def test_pictures_that_turn_more_smoothly_say_nothing(monkeypatch):
    watch, _ = flown(monkeypatch, replace(HOVERING, smoothed_s=0.3), WRONG)
    assert not watch.verdict.decided
    assert "do not settle it" in str(watch.verdict)


def test_pictures_that_stand_still_are_left_out(monkeypatch):
    flight, store = Flight(monkeypatch, HOVERING), MotionStore(NED_FROM_CAMERA)
    flight.fly(LensWatch(store), store, reason=f"{FROZEN}: the same for 0.31 s")
    assert flight.judged == []


def test_it_judges_now_and_then_and_no_more_once_it_said_the_same_twice(monkeypatch):
    monkeypatch.setattr(lens_watch, "APART_NS", 10**9)
    watch, judged = flown(monkeypatch, replace(HOVERING, lasts_s=50.0), verdict=DENIED)
    assert len(judged) == 2 and judged[1] - judged[0] >= LEAST_NEW / 10
    assert watch.settled and watch.verdict.doubt
    assert len(watch._points) == 0


def test_a_denial_that_more_turns_do_not_bear_out_is_withdrawn():
    watch = LensWatch(MotionStore())
    watch.take(SimpleNamespace(stamp_ns=1, image=IMAGE, camera=GIVEN, depth=SimpleNamespace(reason=None)))
    for verdict, settled in ((DENIED, False), (UNKNOWN, False), (DENIED, False), (DENIED, True)):
        watch._note(verdict)
        assert (watch.verdict, watch.settled) == (verdict, settled)


def test_between_two_judgements_is_half_a_minute(monkeypatch):
    _, judged = flown(monkeypatch, replace(HOVERING, lasts_s=65.0), verdict=UNKNOWN)
    assert len(judged) == 2 and judged[1] - judged[0] >= 30.0


def test_without_new_turns_it_does_not_judge_again(monkeypatch):
    monkeypatch.setattr(lens_watch, "APART_NS", 10**9)
    case = replace(HOVERING, lasts_s=60.0)
    flight, store = Flight(monkeypatch, case, verdict=UNKNOWN), MotionStore(NED_FROM_CAMERA)
    for k, (at_s, _) in enumerate(flight.told):
        if at_s > 24:
            flight.told[k] = at_s, flight.told[k - 1][1]
    flight.fly(LensWatch(store), store, WRONG)
    assert flight.judged and max(flight.judged) < 27


def test_pictures_of_another_size_are_of_the_same_lens_and_those_of_another_crop_are_not(monkeypatch):
    watch, _ = flown(monkeypatch, camera=WRONG, verdict=DENIED)
    assert watch.verdict is DENIED
    said = SimpleNamespace(stamp_ns=EPOCH_NS + 10**12, image=0.0, depth=SimpleNamespace(reason=None))
    said.camera = WRONG.resized(1280, 720)
    watch.take(said)
    said.camera = WRONG.resized(854, 480)
    watch.take(said)
    assert watch.verdict.doubt
    said.camera = replace(WRONG, width=480, cx=239.5)
    watch.take(said)
    assert watch.verdict is None and not watch.settled


def shaken(monkeypatch, store):
    """A watch to which every picture is of a turn, and how many pairs each judgement had; none settles anything."""
    watch, pairs = LensWatch(store), []
    monkeypatch.setattr(lens_watch, "small_grey", lambda image, small: image)
    monkeypatch.setattr(lens_watch, "follow", lambda *given: (np.zeros((20, 2)), np.ones((20, 2)), 20))
    monkeypatch.setattr(lens_watch, "judged_by_turns", lambda *given: pairs.append(len(given[0])) or UNKNOWN)
    monkeypatch.setattr(watch, "_turned", lambda stamp_ns: True)
    return watch, pairs


def test_it_judges_by_150_pairs_and_by_45_new_ones(monkeypatch):
    """Pictures without depth too: a fast turn is why there is none, and tells most."""
    monkeypatch.setattr(lens_watch, "APART_NS", 0)
    watch, pairs = shaken(monkeypatch, MotionStore())
    depth = SimpleNamespace(reason="turning too fast")
    for k in range(260):
        watch.take(SimpleNamespace(stamp_ns=EPOCH_NS + k * 10**8, image=0.0, camera=GIVEN, depth=depth))
    assert pairs == [150, 195, 240]


def test_pictures_that_come_faster_are_compared_at_a_tenth_of_a_second(monkeypatch):
    watch, _ = shaken(monkeypatch, MotionStore())
    depth = SimpleNamespace(reason=None)
    for k in range(30):
        watch.take(SimpleNamespace(stamp_ns=EPOCH_NS + k * 33_366_667, image=k, camera=GIVEN, depth=depth))
    assert [k for _, k in watch._waiting] == list(range(0, 30, 3))


def test_one_picture_from_the_future_does_not_blind_it_until_then(monkeypatch):
    """No later one was looked at for an hour, nor did it judge, having done so at that time."""
    watch, pairs = shaken(monkeypatch, MotionStore())
    depth, waiting = SimpleNamespace(reason=None), []
    for k in range(320):
        at_ns = EPOCH_NS + k * 10**8 + (3600 * 10**9 if k == 210 else 0)
        watch.take(SimpleNamespace(stamp_ns=at_ns, image=k, camera=GIVEN, depth=depth))
        waiting.append([picture for _, picture in watch._waiting])
    assert waiting[230] == [picture + 80 for picture in waiting[150]]
    assert len(pairs) == 3 and watch._waiting[-1][1] == 319


def test_what_is_kept_is_bounded(monkeypatch):
    """Minutes of shaking, of which nothing is settled."""
    store = MotionStore()
    watch, _ = shaken(monkeypatch, store)
    monkeypatch.setattr(lens_watch, "MOST_ATTITUDES", 500)
    depth = SimpleNamespace(reason=None)
    for k in range(3_000):
        at_ns = EPOCH_NS + k * 10**8
        store.add(AttitudeSample(at_ns, np.array([1.0, 0, 0, 0])), at_ns)
        watch.take(SimpleNamespace(stamp_ns=at_ns, image=0.0, camera=GIVEN, depth=depth))
    assert len(watch._points) == MOST_PAIRS
    assert len(watch._attitudes) == 500 and len(watch._waiting) <= MOST_WAITING


def test_the_state_names_both_focal_lengths(monkeypatch):
    watch, _ = flown(monkeypatch, camera=WRONG)
    monitor = HealthMonitor(0)
    for happened in (monitor.picture, monitor.velocity):
        happened(1)
    monitor.result(1, no_depth=None, age_ms=20.0)
    monitor.lens_doubt = watch.verdict.doubt
    health = monitor.judge(2)
    assert health.state.value == "degraded"
    assert health.reason.startswith(f"{LENS}: focal length {WRONG.fx:.0f} px, where the turns tell ")
