"""What enters a network's convolutions, for int8; written on its card at export."""

from __future__ import annotations

from collections.abc import Iterable

from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.runtimes.int8 import RangeMeter
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import open_graph
from flightdepth.weights.card import NetworkCard

DIGITS = 4


def fitted_int8_ranges(
    card: NetworkCard, onnx: bytes, pairs: Iterable[TruePair]
) -> dict[str, tuple[float, float]]:
    """The card's `int8_ranges`, of pairs that no test uses."""
    meter = RangeMeter(*open_graph(onnx))
    network = Network(card, meter)
    for pair in pairs:
        Task.of(pair, card).ask(network, pair)
    return {name: (round(a, DIGITS), round(b, DIGITS)) for name, (a, b) in meter.ranges.items()}
