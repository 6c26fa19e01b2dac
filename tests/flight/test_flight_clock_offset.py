"""The offset between video and log: made-up signals, a log moved by known times, and flights that tell none."""

from dataclasses import replace

import numpy as np
import pytest

from flightdepth.flight import GyroscopeTrack, Telemetry, VelocitySample
from flightdepth.flight.apparent_motion import ApparentMotion
from flightdepth.flight.correlation import correlations
from flightdepth.flight.offset import ClockOffset, estimate_offset
from flightdepth.flight.records import NS_PER_S, AttitudeSample, BodyAttitudeSample, by_time
from flightdepth.flight.signals import STEP_S, Signal, turn_signal
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler

VIDEO_S = 30.0


def wandering(seed, *, rate_hz=50.0, span_s=60.0, cut_hz=1.0, columns=3):
    """Smooth random functions of time, deviation 1: times [n] from -10 s on and values [n, columns]."""
    rng = np.random.default_rng(seed)
    at_s = np.arange(0, span_s, 1 / rate_hz) - 10
    phases, amplitudes = rng.uniform(0, 2 * np.pi, (40, columns)), rng.normal(size=(40, columns))
    hertz = np.linspace(0.03, cut_hz, 40)
    waves = np.sin(2 * np.pi * hertz[:, None, None] * at_s[:, None] + phases[:, None])
    values = (amplitudes[:, None] * waves).sum(axis=0)
    return at_s, values / values.std()


def pictures(turn, flow, noise=0.0, course=None, lasts_s=VIDEO_S):
    """What the pictures show, 30 a second: `turn` rad/s [n, 3] and `flow` [n] as functions of time.

    `course`: the direction of flight to the right of where the camera looks, radians; unseen where None.
    """
    at_s = np.arange(0, lasts_s, 1 / 30)
    rng = np.random.default_rng(1)
    turns = np.stack([np.interp(at_s, turn[0], column) for column in turn[1].T], axis=1)
    flows = np.interp(at_s, flow[0], flow[1])
    return ApparentMotion(
        (at_s * NS_PER_S).astype(np.int64),
        turns + noise * rng.normal(size=turns.shape),
        flows * (1 + noise * rng.normal(size=len(flows))),
        np.full(turns.shape, np.nan) if course is None else directions(np.interp(at_s, *course), rng),
    )


def directions(course, rng):
    """Right, down, forward [n, 3], off by some degrees as pictures show them."""
    ways = np.stack([np.sin(course), 0 * course, np.cos(course)], axis=1) + rng.normal(
        0, 0.05, (len(course), 3)
    )
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


def stamps_of(at_s):
    return [round(float(each) * NS_PER_S) for each in at_s]


def even_speed(speed=lambda t: 5.0 + 0 * t):
    at_s = np.arange(-5.0, 45.0, 0.2)
    return tuple(VelocitySample(s, [speed(t), 0, 0]) for s, t in zip(stamps_of(at_s), at_s, strict=True))


def yawing(turn):
    """Attitudes of a body that yaws at the rates `turn`, 50 a second."""
    at_s, rates = turn
    angles = np.cumsum(rates, axis=0) / 50
    yaw_only = [rotation_from_euler(0, 0, angle) for angle in angles[:, 2]]
    return tuple(
        BodyAttitudeSample(s, quaternion_from_rotation(each))
        for s, each in zip(stamps_of(at_s), yaw_only, strict=True)
    )


@pytest.mark.parametrize("offset_s", [-3.0, -1.234, 0.0, 0.51, 3.0])
@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.slow), 0.03])
def test_turn_rates_of_a_gyroscope_with_its_own_axes(offset_s, noise):
    at_s, turn = wandering(1)
    turn = 0.1 * turn
    track = GyroscopeTrack(np.array(stamps_of(at_s)), turn[:, [2, 0, 1]] * [1, -1, -1])
    log = Telemetry("t", even_speed(), gyroscope=track).later_by(round(-offset_s * NS_PER_S))
    found = estimate_offset(pictures((at_s, turn), (at_s, 0 * at_s + 0.3), noise), log)
    assert found.witness == "turn rate"
    assert found.offset_s == pytest.approx(offset_s, abs=0.03)
    assert found.sigma_s < 0.05


@pytest.mark.parametrize("offset_s", [-3.0, 0.7, 3.0])
def test_the_drone_s_attitude(offset_s):
    """Yaw is a turn about the y axis, down, of a level camera that is screwed to it."""
    at_s, turn = wandering(2)
    log = Telemetry("t", even_speed(), body_attitudes=yawing((at_s, 0.1 * turn)))
    seen = np.stack([0 * at_s, 0.1 * turn[:, 2], 0 * at_s], axis=1)
    found = estimate_offset(
        pictures((at_s, seen), (at_s, 0 * at_s + 0.3), 0.02), log.later_by(stamps_of([-offset_s])[0])
    )
    assert found.offset_s == pytest.approx(offset_s, abs=0.04)


@pytest.mark.parametrize("offset_s", [-2.5, 0.0, 1.1])
def test_speed_alone(offset_s):
    """A steady camera, a log of 5 Hz, unknown distance."""
    at_s, change = wandering(3, cut_hz=0.3)
    speed = np.abs(6 + 2 * change[:, 0])
    samples = even_speed(speed=lambda t: np.interp(t, at_s, speed))
    log = Telemetry("t", samples).later_by(round(-offset_s * NS_PER_S))
    found = estimate_offset(pictures((at_s, 0 * change), (at_s, speed / 20), 0.05), log)
    assert found.witness == "speed"
    assert found.offset_s == pytest.approx(offset_s, abs=0.1)


def test_two_witnesses_that_contradict_each_other_tell_nothing():
    """Both fit well, but a second apart."""
    (at_s, turn), (_, change) = wandering(1), wandering(3, cut_hz=0.3)
    speed = np.abs(6 + 2 * change[:, 0])
    late = [
        replace(each, stamp_ns=each.stamp_ns + NS_PER_S)
        for each in even_speed(speed=lambda t: np.interp(t, at_s, speed))
    ]
    track = GyroscopeTrack(np.array(stamps_of(at_s)), 0.1 * turn)
    seen = pictures((at_s, 0.1 * turn), (at_s, speed / 20), 0.03)
    found = estimate_offset(seen, Telemetry("t", tuple(late), gyroscope=track))
    assert found.offset_s is None
    assert found.reason == "turn rate and speed disagree"


YEARS_S = 50 * 365.25 * 86400


@pytest.mark.parametrize("jump_s", [25.0, pytest.param(100.0, marks=pytest.mark.slow), YEARS_S])
@pytest.mark.parametrize("after", [False, True])
def test_a_log_whose_clock_jumps_costs_what_it_tells(jump_s, after):
    """Found in review: a clock set by years inside a log ended in an _ArrayMemoryError; by days, in minutes of CPU."""
    (at_s, turn), (_, other) = wandering(1), wandering(2)
    times = np.concatenate([at_s, at_s + 60 + jump_s])
    track = GyroscopeTrack(
        np.array(stamps_of(times)), 0.1 * np.concatenate([other, turn] if after else [turn, other])
    )
    found = estimate_offset(
        pictures((at_s, 0.1 * turn), (at_s, 0 * at_s + 0.3)), Telemetry("t", even_speed(), gyroscope=track)
    )
    assert found.witness == "turn rate"
    assert found.offset_s == pytest.approx(-(60 + jump_s) if after else 0.0, abs=0.03)


def test_a_log_in_the_wrong_unit_costs_nothing():
    """Milliseconds that are called seconds: 100 s between two."""
    samples = tuple(VelocitySample(round(100e9 * k), [5.0 + k % 3, 0, 0]) for k in range(2000))
    at_s, turn = wandering(1)
    found = estimate_offset(pictures((at_s, turn), (at_s, 1 + 0.1 * turn[:, 0])), Telemetry("t", samples))
    assert "speed: less than 6 s in common" in found.reason


@pytest.mark.parametrize("silence_s", [11.0, 13.0])
def test_parts_of_a_log_are_laid_to_the_video_as_the_whole_would_be(monkeypatch, silence_s):
    (at_s, turn), (_, other) = wandering(1, span_s=20), wandering(2, span_s=20)
    video = Signal(np.arange(0, 12, 1 / 30), turn[:360]).on_grid()  # of 12 s
    log = Signal(np.concatenate([at_s, at_s + 20.01 + silence_s]), np.concatenate([other, turn]))
    split = correlations(video, log, None)
    monkeypatch.setattr(Signal, "parts", lambda signal, silence_s: [signal])
    whole = correlations(video, log, None)
    known, same = np.isfinite(whole.values), np.isin(whole.lags, split.lags)
    assert (np.diff(split.lags) > 0).all()
    assert same[known].all()
    np.testing.assert_array_equal(split.values, whole.values[same])
    np.testing.assert_array_equal(split.samples, whole.samples[same])


def test_nothing_is_told_within_a_gap_but_up_to_its_ends():
    at_s = np.array([0.0, 1.0, 2.01, 4.01, 5.0])
    first, values = Signal(at_s, 3 * at_s[:, None]).on_grid()
    step_s = (first + np.arange(len(values))) * STEP_S
    told = (step_s < 2.01) | (step_s > 4.01)
    np.testing.assert_allclose(values[:, 0], np.where(told, 3 * step_s, np.nan))


def test_the_camera_tells_its_turns_before_its_gyroscope_does_and_that_before_the_drone():
    stamps_ns = np.arange(5) * NS_PER_S // 10
    camera, body = (
        [quaternion_from_rotation(rotation_from_euler(0, 0, rate * k / 10)) for k in range(5)]
        for rate in (0.1, 0.3)
    )
    rates = np.tile([0.2, 0.0, 0.0], (5, 1))
    log = Telemetry(
        "t",
        by_time([VelocitySample(0, [1, 0, 0])], list(map(AttitudeSample, stamps_ns.tolist(), camera))),
        gyroscope=GyroscopeTrack(stamps_ns, rates),
        body_attitudes=tuple(map(BodyAttitudeSample, stamps_ns.tolist(), body)),
    )
    without_camera = replace(log, samples=log.samples[:1])
    logs = {0.1: log, 0.2: without_camera, 0.3: replace(without_camera, gyroscope=None)}
    for rate, each in logs.items():
        signal = turn_signal(each)
        assert signal.axes == (rate == 0.1)
        np.testing.assert_allclose(np.linalg.norm(signal.values, axis=1), rate, rtol=1e-3)
    assert turn_signal(replace(without_camera, gyroscope=None, body_attitudes=())) is None


def aside(at_s, times=(15.0,)):
    """Ahead, then 80 degrees to the right, and back, within a second each."""
    return sum((-1) ** k * np.radians(80) / (1 + np.exp(-(at_s - at) / 0.2)) for k, at in enumerate(times))


def flown(course, *, from_north=0.0, frame="world", attitudes=False, speed_m_s=5.0):
    """A log of 5 Hz at an even speed of a camera that looks `from_north` radians to the east all the time."""
    at_s = np.arange(-5.0, 45.0, 0.2)
    way = np.interp(at_s, *course) + from_north
    ned = speed_m_s * np.stack([np.cos(way), np.sin(way), 0 * way], axis=1)
    values = ned if frame == "world" else ned[:, [1, 2, 0]]
    samples = [VelocitySample(s, v, frame) for s, v in zip(stamps_of(at_s), values, strict=True)]
    look = quaternion_from_rotation(rotation_from_euler(0, 0, from_north) @ NED_FROM_CAMERA)
    told = [AttitudeSample(s, look) for s in stamps_of(at_s[::3] - 0.05)] if attitudes else []
    return Telemetry("t", by_time(samples, told))


STEADY = np.arange(-10, 50, 0.02), np.zeros((3000, 3))
EVEN = np.arange(-10, 50, 0.02), np.full(3000, 0.3)
COURSE = STEADY[0], aside(STEADY[0])
TO_AND_FRO = STEADY[0], aside(STEADY[0], range(-8, 50, 4))


@pytest.mark.parametrize("offset_s", [-3.0, 0.0, 1.37])
@pytest.mark.parametrize(
    "told", [{"from_north": 2.0, "attitudes": True}, {"from_north": 2.0}, {"frame": "camera"}], ids=str
)
def test_a_flight_that_goes_aside_and_does_not_turn(offset_s, told):
    """It told nothing: the camera did not turn, and the speed was even."""
    log = flown(COURSE, **told).later_by(round(-offset_s * NS_PER_S))
    found = estimate_offset(pictures(STEADY, EVEN, 0.01, COURSE), log)
    assert found.witness == "direction"
    assert found.offset_s == pytest.approx(offset_s, abs=0.05)


def test_where_turns_tell_the_offset_the_direction_is_not_asked():
    at_s, turn = wandering(1)
    log = flown(COURSE, frame="camera").later_by(2 * NS_PER_S)
    log = replace(log, gyroscope=GyroscopeTrack(np.array(stamps_of(at_s)), 0.1 * turn))
    found = estimate_offset(pictures((at_s, 0.1 * turn), EVEN, 0.01, COURSE), log)
    assert (found.witness, found.offset_s) == ("turn rate", pytest.approx(0, abs=0.03))


def test_a_direction_in_the_world_says_nothing_of_a_camera_that_turns():
    at_s, turn = wandering(1)
    found = estimate_offset(pictures((at_s, 0.1 * turn), EVEN, 0.01, COURSE), flown(COURSE))
    assert found.offset_s is None
    assert "direction: the camera turns, and the log does not tell how" in found.reason


@pytest.mark.parametrize(
    ("log", "reason"),
    [
        (flown(TO_AND_FRO), "direction: another offset fits nearly as well"),
        (flown((STEADY[0], 0 * STEADY[0])), "direction: even within 0 degrees"),
        (flown(COURSE, speed_m_s=0.5), "direction: the log tells too few"),
        (replace(flown(COURSE), any_direction=True), "direction: the log has none"),
    ],
    ids=["to and fro", "straight", "hovering", "speeds alone"],
)
def test_directions_that_tell_nothing(log, reason):
    found = estimate_offset(pictures(STEADY, EVEN, 0.01, TO_AND_FRO), log)
    assert found.offset_s is None
    assert reason in found.reason


def test_directions_of_another_flight_fit_nowhere():
    for seed in range(5):
        (at_s, course), (_, other) = wandering(10 + seed, cut_hz=0.3), wandering(20 + seed, cut_hz=0.3)
        found = estimate_offset(
            pictures(STEADY, EVEN, 0.01, (at_s, course[:, 0])), flown((at_s, other[:, 0]), frame="camera")
        )
        assert found.offset_s is None


def test_a_straight_even_flight_tells_nothing():
    at_s, change = wandering(4)
    found = estimate_offset(
        pictures((at_s, 0 * change), (at_s, 0 * at_s + 0.3), 0.02), Telemetry("t", even_speed())
    )
    assert found.offset_s is None
    assert "even" in found.reason and str(found).startswith("unknown")
    assert not found.contradicts(5.0)


def test_turning_to_and_fro_is_ambiguous():
    at_s = np.arange(-10, 50, 0.02)
    turn = 0.2 * np.sin(2 * np.pi * at_s / 4)[:, None] * [0, 1, 0]
    track = GyroscopeTrack(np.array(stamps_of(at_s)), turn)
    found = estimate_offset(
        pictures((at_s, turn), (at_s, 0 * at_s + 0.3), 0.005), Telemetry("t", even_speed(), gyroscope=track)
    )
    assert found.offset_s is None
    assert "another offset fits nearly" in found.reason


@pytest.mark.parametrize(("seen_until_s", "right"), [(15.1, None), (30.0, True)])
def test_a_single_turn_is_believed_if_all_of_it_is_seen(seen_until_s, right):
    """Found in review: a turn, half of which passed for sideways flight, told an offset 0.3 s off, within 0.07."""
    at_s = np.arange(-10, 50, 0.02)
    turn = (0.2 / np.cosh(1.5 * (at_s - 15)) ** 2)[:, None] * [0, 1, 0]
    seen = np.where(at_s[:, None] < seen_until_s, turn, 0)
    log = Telemetry("t", even_speed(), gyroscope=GyroscopeTrack(np.array(stamps_of(at_s)), turn))
    found = estimate_offset(pictures((at_s, seen), (at_s, 0 * at_s + 0.3), 0.001), log)
    assert (found.offset_s is None) == (right is None)
    assert found.offset_s == (right and pytest.approx(0, abs=2 * found.sigma_s))


def test_a_log_that_tells_turns_too_seldom_is_not_laid_to_the_pictures():
    at_s, turn = wandering(1)
    seldom = at_s[::200], turn[::200]  # every 4 s
    log = Telemetry("t", even_speed(), body_attitudes=yawing(seldom))
    found = estimate_offset(pictures((at_s, 0.1 * turn), (at_s, 0 * at_s + 0.3)), log)
    assert "turn rate: the log tells too few" in found.reason


def test_a_video_of_one_picture_tells_nothing():
    none = ApparentMotion(np.empty(0, np.int64), np.empty((0, 3)), np.empty(0), np.empty((0, 3)))
    found = estimate_offset(none, Telemetry("t", even_speed()))
    assert found.offset_s is None
    assert "fewer than two pictures" in found.reason


def test_logs_of_another_flight_fit_nowhere():
    for seed in range(5):
        (at_s, turn), (_, other) = wandering(10 + seed), wandering(20 + seed)
        track = GyroscopeTrack(np.array(stamps_of(at_s)), 0.1 * other)
        found = estimate_offset(
            pictures((at_s, 0.1 * turn), (at_s, 0 * at_s + 0.3)),
            Telemetry("t", even_speed(), gyroscope=track),
        )
        assert found.offset_s is None


def test_an_offset_that_contradicts_what_was_told():
    at_s, turn = wandering(1)
    track = GyroscopeTrack(np.array(stamps_of(at_s - 1)), 0.1 * turn)
    found = estimate_offset(
        pictures((at_s, 0.1 * turn), (at_s, 0 * at_s + 0.3)), Telemetry("t", even_speed(), gyroscope=track)
    )
    assert found.contradicts(0.0) and not found.contradicts(1.05)


@pytest.mark.parametrize("count", [3, 12, 100])
def test_a_gyroscope_that_turns_evenly_does_so_to_both_ends(count):
    """Its first and last rates were halved; one too short for a mean ended in a traceback."""
    stamps_ns = np.arange(count) * (NS_PER_S // 400)
    track = GyroscopeTrack(stamps_ns, np.full((count, 3), 0.1))
    told = turn_signal(Telemetry("log", (VelocitySample(0, np.ones(3)),), gyroscope=track))
    np.testing.assert_allclose(told.values, track.rates_rad_s)


@pytest.mark.parametrize(
    ("sigma_s", "told_s", "contradicts"),
    [(0.01, 1.19, False), (0.01, 1.21, True), (0.01, 0.79, True), (0.1, 1.39, False), (0.1, 1.41, True)],
)
def test_two_offsets_contradict_each_other_beyond_0_2_s_and_four_deviations(sigma_s, told_s, contradicts):
    assert ClockOffset(1.0, sigma_s, 0.9, 1e-9, "speed").contradicts(told_s) == contradicts


def test_an_offset_is_a_line():
    found = ClockOffset(-1.2345, 0.0214, 0.876, 3.2e-5, "turn rate")
    assert str(found) == (
        "-1.234 s, give or take 0.021 s, by the turn rate (correlation 0.88, odds of another offset 3e-05)"
    )
    assert str(replace(found, offset_s=None, reason="no fit")) == "unknown: no fit"


def gyroscope(at_s, turn, late_s=0.0):
    """A log of even speed whose gyroscope tells turns, rad/s."""
    return Telemetry("t", even_speed(), gyroscope=GyroscopeTrack(np.array(stamps_of(at_s + late_s)), turn))


@pytest.mark.parametrize(("within_s", "found"), [(1.4, False), (1.7, True)])
def test_no_offset_larger_than_what_may_be_is_looked_at(within_s, found):
    at_s, turn = wandering(1, rate_hz=75)
    clock = estimate_offset(pictures((at_s, 0.1 * turn), EVEN), gyroscope(at_s, 0.1 * turn, -1.5), within_s)
    assert (clock.offset_s == pytest.approx(1.5, abs=0.01)) == found


@pytest.mark.parametrize(("within_s", "found"), [(1.2, False), (1.8, True)])
@pytest.mark.parametrize("witness", ["speed", "direction"])
def test_by_no_witness_is_a_larger_offset_looked_at(witness, within_s, found):
    at_s, change = wandering(3, cut_hz=0.3)
    speed = np.abs(6 + 2 * change[:, 0])
    if witness == "speed":
        log = Telemetry("t", even_speed(speed=lambda t: np.interp(t, at_s, speed)))
        seen = pictures((at_s, 0 * change), (at_s, speed / 20))
    else:
        log, seen = flown(COURSE, frame="camera"), pictures(STEADY, EVEN, 0.01, COURSE)
    clock = estimate_offset(seen, log.later_by(-3 * NS_PER_S // 2), within_s)
    assert (clock.witness == witness and clock.offset_s == pytest.approx(1.5, abs=0.1)) == found


@pytest.mark.parametrize("offset_s", [-0.01, 0.01, 0.02, 0.03])
def test_the_offset_lies_between_the_steps_of_the_curve(offset_s):
    """Steps of 0.04 s."""
    at_s, turn = wandering(1, rate_hz=75)
    found = estimate_offset(pictures((at_s, 0.1 * turn), EVEN), gyroscope(at_s, 0.1 * turn, -offset_s), 0.5)
    assert found.offset_s == pytest.approx(offset_s, abs=0.004)


def test_the_deviation_is_the_error_really_made():
    at_s, turn = wandering(1, rate_hz=75)
    log, errors, sigmas = gyroscope(at_s, 0.1 * turn), [], []
    for seed in range(12):
        noise = np.random.default_rng(seed).normal(0, 1, (len(at_s) // 10, 3)).repeat(10, axis=0)
        found = estimate_offset(pictures((at_s, 0.1 * (turn + noise)), EVEN), log, 1.0)
        errors.append(found.offset_s)
        sigmas.append(found.sigma_s)
    ratio = np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(sigmas)))
    assert 0.3 < ratio < 1.5


@pytest.mark.parametrize(("deviation", "tells"), [(0.019, False), (0.021, True)])
@pytest.mark.parametrize("of", ["pictures", "log"])
def test_turns_below_a_degree_a_second_may_be_what_tracking_makes_of_a_steady_camera(deviation, tells, of):
    """On a grid of 0.04 s, over all axes; the other of the two turns more."""
    at_s, turn = wandering(1, cut_hz=0.5)
    shown = (at_s >= 0) & (at_s <= VIDEO_S)
    even = deviation * turn / np.sqrt(turn[shown if of == "pictures" else slice(None)].var(axis=0).sum())
    seen, told = (even, 0.2 * turn) if of == "pictures" else (0.2 * turn, even)
    found = estimate_offset(pictures((at_s, seen), EVEN), gyroscope(at_s, told), 0.5)
    assert (found.offset_s is not None) == tells
    assert ("turn rate: even within 1.1 degrees/s" in found.reason) != tells


@pytest.mark.parametrize(("share", "tells"), [(0.095, False), (0.105, True)])
def test_a_speed_that_changes_by_less_than_a_tenth_tells_nothing(share, tells):
    at_s, change = wandering(3, cut_hz=0.3)
    shown = (at_s >= 0) & (at_s <= VIDEO_S)
    wave = change[:, 0] - change[shown, 0].mean()
    speed = 6 * (1 + share * wave / wave[shown].std())
    log = Telemetry("t", even_speed(speed=lambda t: np.interp(t, at_s, 6 + 2 * wave)))
    found = estimate_offset(pictures((at_s, 0 * change), (at_s, speed / 20)), log, 1.0)
    assert (found.offset_s is not None) == tells
    assert ("speed: even within" in found.reason) != tells


@pytest.mark.parametrize(
    ("aside_rad", "said"),
    [(0.4, "even within 11 degrees"), (0.44, "another offset"), (0.6, "the peak is too wide (0.")],
)
def test_a_way_that_hardly_goes_aside_tells_nothing(aside_rad, said):
    """In 20 of 50 s it goes one way, in 30 another: 0.49 of the angle between them; 0.2 and more is compared."""
    told = flown((STEADY[0], aside_rad / np.radians(80) * COURSE[1]), frame="camera")
    found = estimate_offset(pictures(STEADY, EVEN, 0.01, COURSE), told, 2.0)
    assert found.offset_s is None
    assert f"direction: {said}" in found.reason


def test_why_nothing_is_known_is_told_of_each_witness():
    found = estimate_offset(pictures(STEADY, EVEN), Telemetry("t", even_speed()))
    assert found.reason == (
        "turn rate: the log has none; speed: even within 0%; direction: too few points in the pictures"
    )


@pytest.mark.parametrize(("alike", "fits"), [(0.5, False), (0.75, True)])
def test_a_fit_is_believed_from_a_correlation_of_0_6_on(alike, fits):
    """Half of a signal and more of another one."""
    (at_s, turn), (_, other) = wandering(1, cut_hz=3), wandering(2, cut_hz=3)
    mixed = 0.1 * (alike * turn + np.sqrt(1 - alike**2) * other)
    found = estimate_offset(pictures((at_s, mixed), EVEN), gyroscope(at_s, 0.1 * turn), 0.5)
    assert (found.offset_s is not None) == fits
    if not fits:
        assert "turn rate: no fit (correlation 0." in found.reason


@pytest.mark.parametrize("clearer", ["the first", "the second"])
def test_what_the_log_tells_twice_is_ambiguous_whichever_fits_better(clearer):
    """The same turns, after a silence that is longer than the video, one of them with a little of something else."""
    (at_s, turn), (_, other) = wandering(1, span_s=24), wandering(2, span_s=24)
    blurred = turn + 0.05 * other
    twice = [turn, blurred] if clearer == "the first" else [blurred, turn]
    log = gyroscope(np.concatenate([at_s, at_s + 37]), 0.1 * np.concatenate(twice))
    found = estimate_offset(pictures((at_s, 0.1 * turn), EVEN, lasts_s=12), log)
    assert found.offset_s is None
    assert "turn rate: another offset fits nearly as well (odds 1)" in found.reason


def test_a_peak_at_the_end_of_what_was_tried_is_no_peak():
    """The best offset of all lies beyond."""
    at_s, turn = wandering(1, cut_hz=0.2)
    clock = estimate_offset(pictures((at_s, 0.1 * turn), EVEN), gyroscope(at_s, 0.1 * turn, -0.5), 0.3)
    assert clock.offset_s is None
    assert "turn rate: no fit" in clock.reason


@pytest.mark.parametrize("narrower", ["turn rate", "speed"])
def test_of_two_witnesses_the_one_with_the_narrower_peak_decides(narrower):
    """Both fit, 0.1 s apart, which is no contradiction: the one that changes more quickly is surer."""
    quick, slow = wandering(1, cut_hz=0.8), wandering(3, cut_hz=0.2)
    (at_s, turn), (_, change) = (quick, slow) if narrower == "turn rate" else (slow, quick)
    speed = np.abs(6 + 1.5 * change[:, 0])
    samples = even_speed(speed=lambda t: np.interp(t - 0.1, at_s, speed))
    log = replace(gyroscope(at_s, 0.1 * turn), samples=samples)
    found = estimate_offset(pictures((at_s, 0.1 * turn), (at_s, speed / 20), 0.03), log, 1.0)
    assert found.witness == narrower
    assert found.offset_s == pytest.approx(0 if narrower == "turn rate" else -0.1, abs=0.03)


def test_a_fit_that_still_rises_where_nothing_more_is_known_is_none():
    """Between two parts of a log; the unknown counted for a deep valley, so that the fit was sure within 0.01 s."""
    (at_s, turn), (_, other) = wandering(1, cut_hz=0.3), wandering(2, cut_hz=0.3)
    late = at_s > VIDEO_S / 2 + 0.2  # the other half of the video is what it has in common at least
    told = np.concatenate([other, turn[late]])
    log = gyroscope(np.concatenate([at_s - 160, at_s[late]]), 0.1 * told)
    assert estimate_offset(pictures((at_s, 0.1 * turn), EVEN), log).offset_s is None
