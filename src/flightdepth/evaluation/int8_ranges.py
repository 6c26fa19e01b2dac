"""What enters a network's convolutions, for int8; written on its card at export."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import openvino as ov
from numpy.typing import NDArray

from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.runtimes.contract import Arrays, Runtime
from flightdepth.runtimes.int8 import measured_ranges
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime, open_graph
from flightdepth.weights.card import NetworkCard

DIGITS = 4


class Overheard:
    """A runtime that keeps what it was last asked."""

    def __init__(self, runtime: Runtime) -> None:
        self.runtime = runtime
        self.inputs: Arrays = {}
        self.description, self.architecture = runtime.description, runtime.architecture

    def __call__(self, inputs: Arrays) -> dict[str, NDArray[np.float32]]:
        """The runtime's answer."""
        self.inputs = inputs
        return self.runtime(inputs)


def fitted_int8_ranges(
    card: NetworkCard, onnx: bytes, pairs: Iterable[TruePair]
) -> dict[str, tuple[float, float]]:
    """The card's `int8_ranges`, of pairs that no test uses."""
    runtime = Overheard(OpenVinoRuntime(onnx))
    graph, _ = open_graph(ov.Core(), onnx)
    ranges = measured_ranges(graph, _batches(Network(card, runtime), runtime, pairs))
    return {name: (round(least, DIGITS), round(largest, DIGITS)) for name, (least, largest) in ranges.items()}


def _batches(network: Network, runtime: Overheard, pairs: Iterable[TruePair]) -> Iterator[Arrays]:
    for pair in pairs:
        Task.of(pair, network.card).ask(network, pair)
        yield runtime.inputs
