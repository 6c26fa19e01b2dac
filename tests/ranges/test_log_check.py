"""A log is denied where its direction is another than the pictures', and not for what it usually gets wrong."""

from functools import partial

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import remainder
from flightdepth.ranges.log_check import DENIALS, EVERY_NS, LogCheck
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.tracks import Tracker
from flightdepth.stillbox import PairRule, Picture, TestSet
from flightdepth.stillbox.motion_noise import rotated, tilted
from tests_textures import few_textures

CAMERA = Camera.from_fov(256, 256, 90)
AXIS = np.array([0.3, 0.5, -0.8])


@pytest.fixture(scope="module")
def rooms():
    return list(TestSet(Picture(256, 256, 256), PairRule(), scenes=24, seed=3, textures=few_textures()))


def pair_of(room, way, *, turn_deg=0.0, previous=None):
    """The pair with the displacement that a log tells, `way`, and an earlier picture turned by what none does."""
    seen = room.previous if previous is None else previous
    seen = rotated(seen, CAMERA, np.radians(turn_deg) * AXIS / np.linalg.norm(AXIS)) if turn_deg else seen
    return Pair(Frame(0, 0, seen), way, float(np.linalg.norm(way)), 10.0, np.eye(3), 0.0)


def denied(room, way, *, checks=DENIALS, **wrong):
    """Whether it is after so many checks of the same pair."""
    check, pair = LogCheck(CAMERA, Tracker(CAMERA)), pair_of(room, way, **wrong)
    return [check.denies(lambda: pair, Frame(k + 1, k * EVERY_NS, room.current)) for k in range(checks)][-1]


@pytest.mark.parametrize("turn_deg", [0.0, 0.3, 1.0])
def test_a_right_log_is_believed(rooms, turn_deg):
    """Also one that misses a rotation of a degree, and one that is five degrees off."""
    for degrees in (0.0, 5.0):
        said = [tilted(room.displacement, AXIS, degrees) for room in rooms]
        assert not any(denied(room, way, turn_deg=turn_deg) for room, way in zip(rooms, said, strict=True))


@pytest.mark.parametrize(
    "wrong",
    [lambda d: -d, lambda d: d[[2, 0, 1]], lambda d: tilted(d, AXIS, 60.0)],
    ids=["back", "axes", "60"],
)
def test_a_log_of_another_direction_is_denied(rooms, wrong):
    """Nearly always; where it is not, too few corners moved, or they moved towards what the wrong axes tell too."""
    found = [denied(room, np.asarray(wrong(room.displacement))) for room in rooms]
    assert np.mean(found) > 0.7


def test_no_bend_of_a_rolling_shutter_excuses_a_wrong_log(rooms, monkeypatch):
    """However easily one would be believed."""
    before = [denied(room, room.displacement[[2, 0, 1]]) for room in rooms]
    for least in ("CLEAR_BEND", "LEAST_BEND_RAD", "LEAST_TURNED_RAD"):
        monkeypatch.setattr(remainder, least, 0.0)
    assert [denied(room, room.displacement[[2, 0, 1]]) for room in rooms] == before
    assert np.mean(before) > 0.7


def test_one_look_is_not_enough(rooms):
    backward = [room for room in rooms if denied(room, -room.displacement)]
    assert not any(denied(room, -room.displacement, checks=DENIALS - 1) for room in backward)


def test_a_log_that_is_right_again_is_believed_again(rooms):
    room = next(room for room in rooms if denied(room, -room.displacement))
    check = LogCheck(CAMERA, Tracker(CAMERA))
    told = [-1, -1, -1, 1, 1]
    found = [
        check.denies(
            partial(pair_of, room, sign * room.displacement), Frame(k + 1, k * EVERY_NS, room.current)
        )
        for k, sign in enumerate(told)
    ]
    assert found == [False, True, True, False, False]


def test_between_checks_the_last_one_holds(rooms):
    room = next(room for room in rooms if denied(room, -room.displacement))
    check, pair = LogCheck(CAMERA, Tracker(CAMERA)), pair_of(room, -room.displacement)
    stamps = [0, EVERY_NS - 1, EVERY_NS, EVERY_NS + 1, 2 * EVERY_NS - 1]
    found = [check.denies(lambda: pair, Frame(k + 1, stamp, room.current)) for k, stamp in enumerate(stamps)]
    assert found == [False, False, True, True, True]
    assert np.degrees(check.off_rad) == pytest.approx(180, abs=5)


def test_after_pictures_that_tell_nothing_the_next_are_asked_at_once(monkeypatch):
    check, told = LogCheck(CAMERA, Tracker(CAMERA)), [1.0, None, 2.0, 0.0, None, 0.0]
    monkeypatch.setattr(check, "_off_rad", lambda *_: told.pop(0))
    pair = Pair(Frame(0, 0, np.zeros((256, 256, 3), np.uint8)), np.ones(3), 1.0, 10.0, np.eye(3), 0.0)
    found = []
    for k, stamp in enumerate([0, EVERY_NS, EVERY_NS + 1, EVERY_NS + 2, 2 * EVERY_NS + 1]):
        found.append(
            (check.denies(lambda: pair, Frame(k + 1, stamp, pair.previous.image)), check.off_rad, len(told))
        )
    # The third look is the second that denies; the fourth frame is not looked at; the last is right.
    assert found == [(False, 1, 5), (False, 1, 4), (True, 2, 3), (True, 2, 3), (False, 2, 2)]


def test_pictures_that_tell_nothing_deny_nothing(rooms):
    blank = np.full((256, 256, 3), 128, np.uint8)
    room = rooms[0]
    assert not denied(room, -room.displacement, previous=blank)
    assert not denied(room, -room.displacement, previous=cv2.GaussianBlur(room.current, (0, 0), 0.5))
