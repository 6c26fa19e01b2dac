"""The judge between two depths: what it says beside plain numpy and another runtime, and what it learns."""

from __future__ import annotations

import importlib
import sys
import threading
from functools import cache
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx import numpy_helper

from flightdepth.runtimes.judge import JUDGE, Judge, judge
from flightdepth.runtimes.network import load_network
from tests_textures import few_textures

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
judging = importlib.import_module("judging")
Told, bar_loss = judging.Told, judging.bar_loss
fitted_judge, told_of = judging.fitted_judge, judging.told_of
judging_pairs = importlib.import_module("judging_pairs")

pytestmark = pytest.mark.usefixtures("quick_exports")

CLUES = 7


def drawn(seed, *shape):
    clues = np.random.default_rng(seed).normal(size=(CLUES, *shape)).astype(np.float32)
    clues[:2] *= 0.3
    clues[-1] = clues[-1] > -0.5  # held or not
    return clues


def convolved(maps, kernels, offsets):
    """[i, h, w] by [o, i, 3, 3] or [o, i, 1, 1], zeros around."""
    reach = kernels.shape[-1] // 2
    around = np.pad(maps, ((0, 0), (reach, reach), (reach, reach)))
    windows = np.lib.stride_tricks.sliding_window_view(around, kernels.shape[2:], axis=(1, 2))
    return np.einsum("ihwrc,oirc->ohw", windows, kernels) + offsets[:, None, None]


def test_it_says_what_plain_numpy_says():
    weights = {w.name: numpy_helper.to_array(w) for w in onnx.load(JUDGE).graph.initializer}
    clues = drawn(0, 16, 12)
    mean, deviation = (weights[name].reshape(-1, 1, 1) for name in ("mean", "deviation"))
    values = (clues - mean) / deviation
    for layer in (0, 2, 4, 6):
        values = convolved(values, weights[f"layers.{layer}.weight"], weights[f"layers.{layer}.bias"]).clip(0)
    trust, other, spread = convolved(values, weights["head.weight"], weights["head.bias"])
    change, error_bar = judge()(clues)
    np.testing.assert_allclose(
        change,
        clues[-1] * (0.5 * np.tanh(other) - clues[0] / (1 + np.exp(-trust))),
        rtol=1e-3,
        atol=1e-4,
    )
    np.testing.assert_allclose(error_bar, np.log1p(np.exp(spread)) * np.exp(clues[1]), rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("shape", [(64, 64), (48, 64), (24, 32), (80, 144)])
def test_onnx_runtime_says_the_same(shape):
    clues = drawn(1, *shape)
    expected = onnxruntime.InferenceSession(JUDGE.read_bytes()).run(None, {"clues": clues[None]})[0][0]
    np.testing.assert_allclose(np.stack(judge()(clues)), expected, rtol=1e-3, atol=1e-4)


def test_threads_and_sizes_do_not_disturb_each_other():
    shared, shapes = Judge(JUDGE.read_bytes()), [(16, 16), (24, 16), (32, 40)]
    alone = [np.stack(Judge(JUDGE.read_bytes())(drawn(i, *shape))) for i, shape in enumerate(shapes)]
    found = [[] for _ in shapes]

    def ask(i):
        found[i] = [np.stack(shared(drawn(i, *shapes[i]))) for _ in range(20)]

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i, each in enumerate(alone):
        assert all(np.array_equal(one, each) for one in found[i])
        np.testing.assert_array_equal(np.stack(shared(drawn(i, *shapes[i]))), each)  # sizes in turn


def told(seed, agrees):
    """A network's depth of a fifth of its range; the flow is right, or the network."""
    clues, depth = drawn(seed, 16, 16), np.full((16, 16), 0.2, np.float32)
    return Told(clues, depth, depth * np.exp(-clues[0] * clues[-1] * agrees).astype(np.float32))


@pytest.fixture(scope="module")
def small_batches():
    """48 maps a step, as good for the 24 here as 192, and four times as fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judging, "BLOCKS", 48 * 16 * 16)
        yield


@cache
def fitted(agrees):
    return fitted_judge([told(seed, agrees) for seed in range(24)], steps=150)


@pytest.mark.usefixtures("small_batches")
@pytest.mark.parametrize("agrees", [0.0, 1.0])
def test_it_learns_whom_to_trust_and_how_far(agrees):
    found = Judge(fitted(agrees))
    clues = drawn(99, 16, 16)
    change, error_bar = found(clues)
    off = np.abs(change + agrees * clues[0])[clues[-1] > 0]
    untaught = np.abs(clues[0]).mean()
    assert off.mean() < 0.4 * untaught
    assert np.median(error_bar) < 0.4 * untaught
    assert (off < error_bar[clues[-1] > 0]).mean() > 0.5


def test_the_bar_with_the_least_loss_holds_two_errors_in_three_small_or_large():
    errors = torch.from_numpy(np.abs(np.random.default_rng(0).laplace(size=4001)) * 0.01)
    bars = torch.logspace(-3, -1, 2001, dtype=torch.float64)
    losses = torch.stack([bar_loss(errors, bar.expand_as(errors)) for bar in bars])
    best = bars[losses.argmin()]
    assert float(best) == pytest.approx(float(np.quantile(errors.numpy(), 0.68)), rel=0.01)
    for factor in (5.0, 100.0):
        larger = bar_loss(factor * errors, factor * bars[500].expand_as(errors))
        assert float(larger) == pytest.approx(float(losses[500]), rel=0.01)


@pytest.mark.usefixtures("small_batches")
def test_one_that_goes_on_learns_its_error_bar_alone():
    pairs = [told(seed, 1.0) for seed in range(24)]
    wrong = [Told(each.clues, each.depth, 3 * each.truth) for each in pairs]
    start = fitted(1.0)
    clues = drawn(99, 16, 16)
    (change, error_bar), (change_after, error_bar_after) = (
        Judge(onnx_file)(clues)
        for onnx_file in (start, fitted_judge(wrong, steps=150, rate=4e-3, start=start))
    )
    assert np.abs(change_after - change).mean() < 0.1 * np.log(3)  # where the truth went
    assert np.median(error_bar_after) > 3 * np.median(error_bar)  # truth is three times as far away now


def test_what_the_earlier_picture_does_not_hold_stays():
    clues = drawn(7, 32, 32)
    change, _ = judge()(clues)
    assert not change[clues[-1] == 0].any()
    assert np.abs(change[clues[-1] == 1]).mean() > 0.02


def test_unknown_truth_teaches_nothing():
    blind = [Told(each.clues, each.depth, each.truth.copy()) for each in (told(s, 1.0) for s in range(4))]
    for each in blind:
        each.truth[:8] = np.nan
    answers = Judge(fitted_judge(blind, steps=3))(drawn(5, 16, 16))
    assert all(np.isfinite(each).all() for each in answers)


def test_what_is_told_of_drawn_pairs(monkeypatch):
    monkeypatch.setattr(judging_pairs, "_room_textures", few_textures)
    shipped = load_network("motion-tiny", "openvino", precision="f32", aligned=False)
    first, again = (list(judging_pairs.fitting_pairs(2, shrunk=2, seed=5)) for _ in range(2))
    for pair, same in zip(first, again, strict=True):
        np.testing.assert_array_equal(pair.current, same.current)
        found = told_of(shipped, pair)
        assert found.clues.shape == (CLUES, *found.depth.shape)
        assert np.isfinite(found.clues).all()
        known = found.truth[np.isfinite(found.truth)]
        assert known.size and known.max() <= 1.0001  # no truth beyond the network's range
        assert known.min() > 0
