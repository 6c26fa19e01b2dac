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


@pytest.fixture(autouse=True)
def few(few_fixed_textures, monkeypatch):
    monkeypatch.setattr(int8_ranges, "SHARES", FEW_SHARES)


@pytest.mark.parametrize("wider", [1, 10])
def test_a_range_that_one_value_made_too_wide_is_cut(monkeypatch, wider):
    """Ten times what is seen leaves a byte 25 steps for it; a quarter of that is the least that is tried."""
    stored = read_network("tiny-clamped-256")
    card, seen = stored.card, stored.card.int8_ranges
    wide = {name: (seen[name][0] * wider, seen[name][1] * wider) for name in NAMES}
    monkeypatch.setattr(RangeMeter, "ranges", wide)
    for limit in LIMITS:
        monkeypatch.setattr(int8_ranges, limit, np.inf)
    pairs = list(fixed_set(card, scenes=4))

    def depth_m(runtime):
        network = Network(card, runtime)
        return np.stack([Task.of(pair, card).ask(network, pair).depth_m[0] for pair in pairs])

    def change(ranges):
        found = depth_m(OpenVinoRuntime(stored.onnx, precision="int8", ranges=ranges))
        return np.abs(found / exact - 1).mean()

    exact = depth_m(OpenVinoRuntime(stored.onnx))
    fitted = fitted_int8_ranges(card, stored.onnx, list(calibration_set(card, scenes=4)))
    shares = [fitted[name][1] / wide[name][1] for name in NAMES]
    assert all(min(abs(share - each) for each in FEW_SHARES) < 1e-3 for share in shares)
    if wider == 1:
        assert min(shares) > 0.4
    else:
        assert shares == pytest.approx([0.25, 0.25], rel=1e-3)
        assert change(fitted) < 0.5 * change(wide)


@pytest.mark.parametrize("limit", sorted(LIMITS))
def test_what_bytes_would_change_too_much_stays_in_float(monkeypatch, limit):
    """A range a hundred times too wide leaves a byte ten steps at best: too few by itself, and beside another."""
    (other,) = LIMITS - {limit}
    monkeypatch.setattr(int8_ranges, other, np.inf)
    stored = read_network("tiny-clamped-256")
    seen = stored.card.int8_ranges
    wide, fine = NAMES
    ranges = {wide: (0.0, 100 * seen[wide][1]), fine: seen[fine]}
    monkeypatch.setattr(RangeMeter, "ranges", ranges)
    fitted = fitted_int8_ranges(stored.card, stored.onnx, list(calibration_set(stored.card, scenes=2)))
    assert list(fitted) == [fine]
