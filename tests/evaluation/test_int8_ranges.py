"""What bytes stand for: chosen by what depth loses, on pairs that the choice did not see."""

import numpy as np
import pytest

from flightdepth.evaluation import int8_ranges
from flightdepth.evaluation.fixed_set import fixed_set
from flightdepth.evaluation.int8_ranges import SHARES, fitted_int8_ranges
from flightdepth.evaluation.pairs import Task
from flightdepth.evaluation.sigma_scale import calibration_set
from flightdepth.runtimes.int8 import RangeMeter
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.weights.store import read_network

LIMITS = {"MOST_CHANGED", "MOST_CHANGED_BY_ALL"}
NAMES = ("conv2.0.weight.half", "conv4.0.weight.half")
FEW_SHARES = (SHARES[0], SHARES[2], SHARES[-1])  # each is compiled for


STORED = read_network("tiny-clamped-256")
SEEN = STORED.card.int8_ranges


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(int8_ranges, "SHARES", FEW_SHARES)


@pytest.fixture(scope="module")
def pairs(few_fixed_textures):
    """That ranges are chosen on."""
    return list(calibration_set(STORED.card, scenes=4))


def fitted(monkeypatch, pairs, ranges, *without):
    """What is chosen where `ranges` enter convolutions, without these limits."""
    monkeypatch.setattr(RangeMeter, "ranges", ranges)
    for limit in without:
        monkeypatch.setattr(int8_ranges, limit, np.inf)
    return fitted_int8_ranges(STORED.card, STORED.onnx, pairs)


def test_a_range_that_is_no_wider_than_it_need_be_is_cut_little(monkeypatch, pairs):
    found = fitted(monkeypatch, pairs, {name: SEEN[name] for name in NAMES}, *LIMITS)
    shares = [found[name][1] / SEEN[name][1] for name in NAMES]
    assert all(min(abs(share - each) for each in FEW_SHARES) < 1e-3 for share in shares)
    assert min(shares) > 0.4


def test_a_range_that_one_value_made_too_wide_is_cut(monkeypatch, pairs):
    """Ten times what is seen leaves a byte 25 steps for it; a quarter of that is the least that is tried."""
    wide = {name: (10 * SEEN[name][0], 10 * SEEN[name][1]) for name in NAMES}
    found = fitted(monkeypatch, pairs, wide, *LIMITS)
    assert [found[name][1] / wide[name][1] for name in NAMES] == pytest.approx([0.25, 0.25], rel=1e-3)
    others = list(fixed_set(STORED.card, scenes=4))

    def depth_m(**options):
        network = Network(STORED.card, OpenVinoRuntime(STORED.onnx, **options))
        return np.stack([Task.of(pair, STORED.card).ask(network, pair).depth_m[0] for pair in others])

    def change(ranges):
        return np.abs(depth_m(precision="int8", ranges=ranges) / exact - 1).mean()

    exact = depth_m()
    assert change(found) < 0.5 * change(wide)


@pytest.mark.parametrize("limit", sorted(LIMITS))
def test_what_bytes_would_change_too_much_stays_in_float(monkeypatch, pairs, limit):
    """A range a hundred times too wide leaves a byte ten steps at best: too few by itself, and beside another."""
    (other,) = LIMITS - {limit}
    wide, fine = NAMES
    ranges = {wide: (0.0, 100 * SEEN[wide][1]), fine: SEEN[fine]}
    assert list(fitted(monkeypatch, pairs[:2], ranges, other)) == [fine]
