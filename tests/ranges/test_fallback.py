"""Frames whose displacement has a length but no direction: a second network that needs none, or nothing."""

import numpy as np
import pytest
from sideways_flight import CAMERA, FRAME_NS, picture

from flightdepth.errors import BadInput
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.choice import NO_DIRECTION
from flightdepth.ranges.direction import SeenDirections
from flightdepth.ranges.fallback import OnGridOf
from flightdepth.runtimes.network import Network
from tests_networks import BestHypothesis, difference_card, swept_card

HIDDEN = {5, 6, 9}


class Same:
    """A DepthNet without weights: half of its 100 m everywhere, whatever it sees."""

    description = "numpy"
    architecture = "DepthNet"

    def __call__(self, inputs):
        n, height, width, _ = inputs["pairs"].shape
        return {"depth_m": np.full((n, height // 4, width // 4), 50.0, np.float32)}


def spare(focal_px=64.0):
    return Network(difference_card(name="spare", focal_px=focal_px), Same())


@pytest.fixture
def fly(monkeypatch):
    """Results of twelve frames at 1 m/s, whose direction the pictures do not tell in HIDDEN ones."""
    see = SeenDirections.of

    def of(self, served, current):
        unseen = tuple(pair for _, pairs in served for pair in pairs)
        return unseen if current.index - 1 in HIDDEN else see(self, served, current)

    monkeypatch.setattr(SeenDirections, "of", of)

    def flown(fallback=None, frame="world"):
        network = Network(swept_card(), BestHypothesis())
        estimator = MultiRangeEstimator(network, CAMERA, ranges=1, fallback=fallback)
        results = []
        for number in range(12):
            estimator.add_velocity(number * FRAME_NS, [1.0, 0.0, 0.0], frame=frame)
            results.append(estimator.add_frame(number * FRAME_NS, picture(number)))
        return results

    return flown


def test_without_a_fallback_such_frames_stay_unknown(fly):
    results = fly()
    assert {k for k, result in enumerate(results) if result.reason == NO_DIRECTION} == HIDDEN
    assert {result.network for k, result in enumerate(results[1:], 1) if k not in HIDDEN} == {
        "best-hypothesis"
    }
    assert {results[k].network for k in HIDDEN} == {""}


def test_such_frames_have_the_fallback_s_depth(fly):
    """Half of alpha D, alpha = 100 m / 0.3 m."""
    results = fly(spare)
    for k in HIDDEN:
        assert results[k].network == "spare"
        assert results[k].moved_m is None
        assert results[k].sigma_m is None
        told = results[k].depth_m[np.isfinite(results[k].depth_m)]
        assert told.size > 0
        assert told == pytest.approx(0.5 * 100 / 0.3 * results[k].displacements_m[0], rel=1e-4)
        assert "spare" in results[k].notes[-1]


def test_all_other_frames_are_the_same_with_and_without_it(fly):
    for k, (one, other) in enumerate(zip(fly(), fly(spare), strict=True)):
        if k not in HIDDEN:
            assert (one.reason, one.network, one.notes) == (other.reason, other.network, other.notes)
            assert np.array_equal(one.depth_m, other.depth_m, equal_nan=True)
            assert np.array_equal(one.confidence, other.confidence)


def test_it_is_opened_once_and_when_the_first_such_frame_comes(fly, monkeypatch):
    opened = []

    def open_it():
        opened.append(True)
        return spare()

    fly(open_it)
    assert len(opened) == 1
    opened.clear()
    fly(open_it, frame="camera")
    assert not opened


def test_a_network_of_another_focal_length_answers_on_the_same_grid():
    """Pictures of 96 px of focal length, a network for 192: its maps are twice as large."""
    other = spare(focal_px=192.0)
    given = [picture(0)], picture(1), np.array([[0.3, 0.0, 0.0]])
    assert other.predict(*given, CAMERA).depth_m.shape == (1, 64, 96)
    found = OnGridOf(other).predict(*given, CAMERA)
    assert found.depth_m.shape == (1, 32, 48)
    assert np.allclose(found.depth_m[0][found.valid], 50.0)
    assert found.valid.mean() > 0.9


def test_a_mask_is_told_to_a_network_on_the_same_grid():
    shown = np.ones((32, 48), np.bool_)
    shown[:8] = False
    found = OnGridOf(spare(focal_px=96.0)).predict(
        [picture(0)], picture(1), np.array([[0.3, 0.0, 0.0]]), CAMERA, shown
    )
    np.testing.assert_array_equal(found.valid, shown)


class Columns(Same):
    """As deep as the pixel's number in its row."""

    def __call__(self, inputs):
        n, height, width, _ = inputs["pairs"].shape
        row = np.arange(width // 4, dtype=np.float32) + 10
        return {"depth_m": np.broadcast_to(row, (n, height // 4, width // 4)).copy()}


def test_a_grid_of_the_same_size_may_be_of_another_focal_length():
    """Pictures of 96 px of focal length, scaled to 84 and padded to as many pixels: columns are 7/8 as far apart."""
    other = Network(difference_card(name="spare", focal_px=84.0), Columns())
    given = [picture(0)], picture(1), np.array([[0.3, 0.0, 0.0]])
    own = other.predict(*given, CAMERA)
    assert own.depth_m.shape == (1, 32, 48)
    found = OnGridOf(other).predict(*given, CAMERA)
    apart = np.diff(found.depth_m[0, 16, [4, 44]])
    assert apart == pytest.approx(40 * 84 / 96, abs=1.0)
    # The middle of column k, (4 k + 1.5 - cx) / 96 off the axis, is so much of 84 px off it there; 10 is its first.
    there = (np.arange(4, 44) * 4 + 1.5 - CAMERA.cx) * 84 / 96 + CAMERA.cx
    assert np.mean(found.depth_m[0, 16, 4:44] - (there - 1.5) / 4) == pytest.approx(10, abs=0.2)


def test_one_that_needs_a_direction_is_refused(fly):
    with pytest.raises(BadInput, match="needs no direction"):
        fly(lambda: Network(swept_card(), BestHypothesis()))
