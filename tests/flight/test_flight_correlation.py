"""How well a log fits a video at each offset: signals of few numbers, and laws."""

import numpy as np
import pytest

from flightdepth.flight.correlation import correlations
from flightdepth.flight.signals import STEP_S, Signal
from flightdepth.motion import rotation_from_euler


def noise(seconds, columns=1, seed=0):
    """Values at STEP_S [n, columns]."""
    return np.random.default_rng(seed).normal(size=(round(seconds / STEP_S), columns))


def signal(values, first=0, *, axes=True):
    """Values [n, c] at the steps from `first` on."""
    return Signal((first + np.arange(len(values))) * STEP_S, values, axes)


def at(curve, lag):
    """Correlation and samples at a lag in steps."""
    (place,) = np.flatnonzero(curve.lags == lag)
    return curve.values[place], curve.samples[place]


def best(curve):
    return curve.lags[np.nanargmax(curve.values)]


@pytest.mark.parametrize(("video_first", "log_first"), [(0, 0), (100, 30), (-50, 25)])
def test_a_log_fits_where_it_says_what_is_seen_with_nothing_left(video_first, log_first):
    values = noise(20)
    curve = correlations((video_first, values), signal(values, log_first), None)
    assert best(curve) == video_first - log_first
    assert at(curve, video_first - log_first) == (pytest.approx(1), 500)


@pytest.mark.parametrize(
    ("video_s", "log_s", "least"), [(10, 20, 150), (20, 30, 250), (30, 20, 250)], ids=str
)
def test_six_seconds_and_half_of_the_shorter_signal_must_be_in_common(video_s, log_s, least):
    video, log = noise(video_s), noise(log_s, seed=1)
    curve = correlations((0, video), signal(log), None)
    assert curve.lags.tolist() == list(range(least - len(log), len(video) - least + 1))
    assert np.isfinite(curve.values).all()
    assert (curve.samples[0], curve.samples[-1], curve.samples.max()) == (
        least,
        least,
        min(len(video), len(log)),
    )


def test_what_is_in_common_is_counted_without_what_is_not_known():
    """Of 250 steps the pictures tell 190, and of the first 170 of them 110: less than 150 is too little."""
    video, log = noise(10), noise(10)
    video[:60] = np.nan
    assert at(correlations((0, video), signal(log), None), 0) == (pytest.approx(1), 190)
    gap = np.r_[:100, 160:250]  # of 2.4 s in the log
    known, samples = at(correlations((0, noise(10)), Signal(gap * STEP_S, log[gap]), None), 0)
    assert known > 0.8 and 188 <= samples <= 190
    too_little, samples = at(correlations((0, video), signal(log[:170]), None), 0)
    assert np.isnan(too_little) and samples == 0


def test_offsets_up_to_a_limit_are_tried():
    curve = correlations((0, noise(20)), signal(noise(20)), 1.0)
    assert curve.lags.tolist() == list(range(-25, 26))


def test_a_fit_with_a_part_of_what_is_seen_is_worth_that_part():
    """The log tells the second of two like waves, in 10 of 20 s: the root of half the squares."""
    wave = np.sin(2 * np.pi * np.arange(250) / 50)[:, None]
    video = np.concatenate([wave, wave])
    assert at(correlations((0, video), signal(wave), None), 250) == (pytest.approx(np.sqrt(0.5)), 250)


def test_a_fit_with_all_that_changes_is_worth_all_of_it():
    """Of 20 s the pictures show something in 10, and the log tells of these; both count from their means."""
    wave = np.sin(2 * np.pi * np.arange(250) / 50)[:, None]
    video = 5 + np.concatenate([0 * wave, wave])
    assert at(correlations((0, video), signal(wave), None), 250) == (pytest.approx(1), 250)


def test_what_both_are_on_the_mean_and_how_large_does_not_matter():
    values = noise(20)
    curve = correlations((0, values), signal(5 + 3 * values), None)
    assert at(curve, 0)[0] == pytest.approx(1)


def test_the_opposite_fits_not_at_all():
    values = noise(20)
    assert at(correlations((0, values), signal(-values), None), 0)[0] == pytest.approx(-1)


@pytest.mark.parametrize(("axes", "fits"), [(True, False), (False, True)])
def test_axes_of_a_log_may_be_any_where_it_does_not_say(axes, fits):
    """A body whose first axis points another way turns about other axes."""
    values = noise(20, columns=3)
    turned = values @ rotation_from_euler(1.0, 0.5, 2.0)
    assert (at(correlations((0, values), signal(turned, axes=axes), None), 0)[0] > 0.99) == fits


def test_what_does_not_change_fits_nothing():
    assert at(correlations((0, noise(20)), signal(np.ones((500, 1))), None), 0)[0] == 0


def test_between_two_parts_of_a_log_nothing_is_known():
    """It was silent for longer than the video lasts; the later part fits."""
    video = noise(10)
    log = np.concatenate([noise(10, seed=1), video])
    steps = np.concatenate([np.arange(250), 1000 + np.arange(250)])
    curve = correlations((0, video), Signal(steps * STEP_S, log), None)
    assert (np.diff(curve.lags) > 0).all()
    assert best(curve) == -1000
    (unknown,) = np.flatnonzero(~np.isfinite(curve.values))
    assert curve.samples[unknown] == 0
    assert curve.lags[unknown] == curve.lags[unknown + 1] - 1


@pytest.mark.parametrize("other_first", [0, 2000])
def test_a_part_of_a_log_beyond_the_limit_is_left_out(other_first):
    """What it told, a minute before or after the video, adds nothing to the curve."""
    video, parts = noise(10), sorted([(1000, 0), (other_first, 1)])
    steps = np.concatenate([begin + np.arange(250) for begin, _ in parts])
    log = Signal(steps * STEP_S, np.concatenate([noise(10, seed=seed) for _, seed in parts]))
    curve = correlations((1000, video), log, 1.0)
    assert curve.lags.tolist() == list(range(-25, 26))
    assert len(curve.values) == len(curve.samples) == 51
    assert best(curve) == 0


@pytest.mark.parametrize(("steps", "told"), [(149, False), (150, True)])
def test_a_part_of_six_seconds_is_tried(steps, told):
    video = noise(10)
    curve = correlations((0, video), signal(video[:steps]), None)
    assert bool(len(curve.lags)) == told
