"""What turns say of a lens: limits by hand, and which part of a video is watched."""

import math
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight import turn_verdict
from flightdepth.flight.records import GyroscopeTrack, Telemetry, VelocitySample
from flightdepth.flight.turn_verdict import TurnVerdict, described_turns, focal_share, turns_deny, turns_of
from flightdepth.flight.turned_focal import TurnedFocal

S = 10**9
GIVEN = Camera.from_fov(640, 360, 70.0)
SMALL = GIVEN.resized(160, 90)
UNKNOWN = TurnedFocal(None, reason="the camera hardly turns")


def found(times, share=0.02, *, camera=SMALL):
    """Turns tell a focal length so many times as long as the one given, through the small pictures' lens."""
    return TurnedFocal(camera.zoomed(times), share, turned_deg=90.0)


@pytest.mark.parametrize("size", [(160, 90), (640, 360), (1280, 720)])
def test_a_focal_length_is_compared_at_the_same_size(size):
    assert focal_share(SMALL.zoomed(0.8).resized(*size), GIVEN) == pytest.approx(1.25)


@pytest.mark.parametrize(
    ("times", "share", "denied"),
    [(1.1, 0.02, False), (1.11, 0.02, True), (1.34, 0.1, False), (1.36, 0.1, True)],
)
@pytest.mark.parametrize("power", [1, -1], ids=["longer", "shorter"])
def test_a_lens_is_denied_beyond_a_tenth_and_three_deviations(times, share, denied, power):
    """exp(0.1) = 1.105, exp(3 * 0.1) = 1.35."""
    assert (turns_deny(found(times**power, share), GIVEN) is not None) == denied


def test_turns_that_tell_nothing_deny_nothing():
    assert turns_deny(UNKNOWN, GIVEN) is None


def test_a_denial_tells_both_focal_lengths_and_what_becomes_of_depth():
    """457 px were given; at 80 % of it depths are 1.25 times."""
    line = turns_deny(found(0.8), GIVEN)
    assert "focal length 457 px, where the turns tell 366 (field of view of 82.4 degrees" in line
    assert "depths flying sideways are 1.25 times those of the latter" in line


@pytest.mark.parametrize(
    ("lens", "said"),
    [
        (SMALL, "field of view of 70.0 degrees through an ideal lens, within 2%, as its pictures moved"),
        (Camera.from_fov(160, 90, 110.0, model="fisheye"), "110.0 degrees through a fisheye, within 2%"),
    ],
    ids=["pinhole", "fisheye"],
)
def test_turns_describe_the_lens_they_tell(lens, said):
    described = described_turns(found(1, camera=lens))
    assert said in described
    assert described.endswith("when it turned by 90 degrees")


def test_turns_that_tell_no_lens_say_why():
    assert described_turns(UNKNOWN) == "the camera hardly turns"


@pytest.mark.parametrize(
    ("verdict", "agrees", "decided"),
    [
        (TurnVerdict(found(1, 0.05), off=0.09), True, True),
        (TurnVerdict(found(1, 0.051), off=0.09), False, False),
        (TurnVerdict(found(1, 0.05), off=0.11), False, False),
        (TurnVerdict(UNKNOWN), False, False),
        (TurnVerdict(found(1, 0.02), doubt="focal length 500 px"), False, True),
    ],
    ids=["sure and near", "unsure", "far", "unknown", "denied"],
)
def test_turns_agree_where_they_are_sure_and_near(verdict, agrees, decided):
    assert (verdict.agrees, verdict.decided) == (agrees, decided)


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        (TurnVerdict(found(1, 0.02), off=0.04), "agrees with its turns within 4%"),
        (TurnVerdict(found(1, 0.03), off=0.01), "agrees with its turns within 3%"),
        (TurnVerdict(UNKNOWN), "its turns do not settle it: the camera hardly turns"),
        (TurnVerdict(found(1), doubt="focal length 500 px"), "focal length 500 px"),
    ],
    ids=["off", "within the error", "unknown", "denied"],
)
def test_a_verdict_is_a_line(verdict, said):
    assert str(verdict) == said


class Points:
    """Of these cameras, what turns tell of each; `asked` is what was tried."""

    camera = SMALL

    def __init__(self, own, best):
        self.own, self.best, self.asked = own, best, []

    def focal(self, told, cameras=()):
        self.asked.append(cameras)
        return self.best if cameras else self.own


@pytest.mark.parametrize("times", [1.04, 1 / 1.04])
def test_a_lens_near_what_its_own_turns_tell_is_not_compared_with_others(times):
    points = Points(found(times), found(2.0))
    verdict = turn_verdict.judged_by_turns(points, None, GIVEN)
    assert (verdict.doubt, verdict.off) == (None, pytest.approx(math.log(1.04)))
    assert points.asked == [()]


def test_a_lens_of_which_turns_tell_nothing_is_off_by_nobody_knows_what():
    verdict = turn_verdict.judged_by_turns(Points(UNKNOWN, found(2.0)), None, GIVEN)
    assert verdict.doubt is None and math.isnan(verdict.off)


@pytest.mark.parametrize(("times", "denied"), [(1.02, False), (1.5, True)])
def test_a_lens_is_denied_where_the_one_that_fits_best_denies_it_too(times, denied):
    points = Points(found(1.5), found(times))
    verdict = turn_verdict.judged_by_turns(points, None, GIVEN)
    assert (verdict.doubt is not None) == denied
    assert verdict.found == points.best
    assert [len(cameras) for cameras in points.asked] == [0, 3]


def turning(first_s, last_s):
    """A log that turns by 10 degrees a second for a while."""
    at_s = np.arange(0, 200, 0.05)
    rates = np.radians(10) * ((at_s >= first_s) & (at_s <= last_s))[:, None] * [0.0, 1, 0]
    track = GyroscopeTrack((at_s * S).astype(np.int64), rates)
    return Telemetry("log", (VelocitySample(0, [1.0, 0, 0]),), gyroscope=track)


class Film:
    """A video of pictures every second; `asked` is the part that was watched."""

    mask = None

    def __init__(self, lasts_s=None, ends_s=math.inf):
        self.duration_ns, self.ends_s = 0 if lasts_s is None else lasts_s * S, ends_s

    def again(self, *, start_s, end_s):
        self.asked = start_s, end_s
        if start_s > self.ends_s:
            raise BadInput("--start", expected="a time in the video", got=str(start_s))
        frames = [SimpleNamespace(stamp_ns=at_s * S) for at_s in range(200) if start_s <= at_s <= end_s]
        watched = nullcontext()
        watched.frames = lambda: iter(frames)
        return watched


@pytest.mark.parametrize(
    ("film", "log", "watched_s"),
    [
        (Film(100), turning(10, 14), (9.3, 69.3)),
        (Film(100), turning(80, 84), (79.3, 100)),
        (Film(), turning(80, 84), (79.3, 139.3)),
        (Film(50), turning(80, 84), (0, 50)),
        (Film(100), replace(turning(0, 0), gyroscope=None), (0, 60)),
    ],
    ids=["a minute", "up to the end", "of a length that is not told", "turns after the end", "no turns"],
)
def test_the_minute_in_which_it_turns_most_is_watched(monkeypatch, film, log, watched_s):
    monkeypatch.setattr(turn_verdict, "followed", lambda frames, camera, mask: iter([]))
    turns_of(film, log, GIVEN)
    assert film.asked == pytest.approx(watched_s, abs=0.1)


def test_pictures_of_turns_only_are_followed(monkeypatch):
    """The camera turns for 4 s, of which pictures are 0.7 s before and after, too."""
    seen_s = []

    def noted(frames, camera, mask):
        seen_s.extend(frame.stamp_ns // S for frame in frames)
        return iter([])

    monkeypatch.setattr(turn_verdict, "followed", noted)
    turns_of(Film(100), turning(10.5, 14.5), GIVEN)
    assert seen_s == [10, 11, 12, 13, 14, 15]


def test_a_video_that_ends_before_the_turns_tells_nothing():
    watch = turns_of(Film(ends_s=20), turning(80, 84), GIVEN)
    assert len(watch.points) == 0
