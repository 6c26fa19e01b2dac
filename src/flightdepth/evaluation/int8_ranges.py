"""Which values bytes stand for in each of a network's convolutions; written on its card at export."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.runtimes.int8 import RangeMeter, Ranges
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime, open_graph
from flightdepth.weights.card import NetworkCard

DIGITS = 4
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25)  # of all that enters a convolution: finer steps, and a few values cut
TRIED_PAIRS = 16
MOST_CHANGED = 0.004  # of depth, by one convolution on bytes
MOST_CHANGED_BY_ALL = 0.002
NEAREST_M = 0.1  # nearer depths change as this one does


def fitted_int8_ranges(
    card: NetworkCard, onnx: bytes, pairs: Sequence[TruePair]
) -> dict[str, tuple[float, float]]:
    """The card's `int8_ranges`, of pairs that no test uses.

    For each convolution, with all others in float, the share of what enters it that changes depth least. One that
    changes it by more than `MOST_CHANGED` even then has no range: it stays in float. So do those that change it most,
    one after the other, until all that are left together change it by no more than `MOST_CHANGED_BY_ALL`.
    """
    few = pairs[:TRIED_PAIRS]
    exact = _log_depths(card, onnx, few, {})

    def change(ranges: Ranges) -> float:
        return float(np.nanmean(np.abs(_log_depths(card, onnx, few, ranges) - exact)))

    chosen, changed = {}, {}
    for name, (least, largest) in _all_that_enters(card, onnx, pairs).items():
        tried = [(round(least * share, DIGITS), round(largest * share, DIGITS)) for share in SHARES]
        changes = [change({name: each}) for each in tried]
        if min(changes) <= MOST_CHANGED:
            chosen[name], changed[name] = tried[int(np.argmin(changes))], min(changes)
    while chosen and change(chosen) > MOST_CHANGED_BY_ALL:
        del chosen[max(chosen, key=changed.__getitem__)]
    return chosen


def _all_that_enters(card: NetworkCard, onnx: bytes, pairs: Sequence[TruePair]) -> Ranges:
    meter = RangeMeter(*open_graph(onnx))
    network = Network(card, meter, aligned=False)
    for pair in pairs:
        Task.of(pair, card).ask(network, pair)
    return meter.ranges


def _log_depths(
    card: NetworkCard, onnx: bytes, pairs: Sequence[TruePair], ranges: Ranges
) -> NDArray[np.float32]:
    """[pairs, h, w], by the network alone: what aligns depth with the pictures would hide what bytes cost."""
    network = Network(card, OpenVinoRuntime(onnx, precision="int8", ranges=ranges), aligned=False)
    depth_m = np.concatenate([Task.of(pair, card).ask(network, pair).depth_m for pair in pairs])
    return np.asarray(np.log(depth_m.clip(NEAREST_M)), np.float32)
