"""Milliseconds per inference call: every network, size, batch and runtime that this machine has.

    python benchmarks/infer.py [--networks NAME_OR_FILE ...] [--sizes 64 ... 512] [--batches 1 2 4] [--json FILE]

A call takes frame pairs that are on the network's grid already and gives depth at 1/4 of the size. "inputs" is what
comes before any runtime: to lay pairs side by side, or to sweep them along the motion. "predict" is all of
`Network.predict` in OpenVINO, inputs and alignment with the pictures too. All networks and runtimes
take turns, so that a busy machine slows all of them alike; compare ratios within one run.
PyTorch is timed too where it is installed. A second table holds each call against this machine's matrix peak: the
operations of the network's convolutions over the time of the call, as a share of what one large product of matrices
(MATRIX square, in OpenVINO too, in the same precision, in turns with the calls, its fastest) reaches.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.evaluation.network_tables import laid_out
from flightdepth.evaluation.provenance import source_commit
from flightdepth.files import write_json
from flightdepth.processor import cpu_name, cpu_runs_bf16, openvino_core
from flightdepth.runtimes.contract import Arrays, Runtime
from flightdepth.runtimes.inputs import paired_inputs, swept_inputs
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.runtimes.onnx_ort import OnnxRuntime
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import StoredNetwork, read_network, shipped_networks

Call = Callable[[], object]
SHIFT_PX = 3
MATRIX = 1536
PEAK = "matrix product"


@dataclass(frozen=True)
class Timing:
    network: str
    weights_sha256: str
    runtime: str
    size: int
    batch: int
    median_ms: float
    p95_ms: float
    calls: int
    operations: int  # two a multiplication and addition, of all pairs of the call
    peak_share: float | None  # None where no peak was measured for that runtime


def calls_of(stored: StoredNetwork, size: int, batch: int) -> dict[str, Call]:
    """What is timed for one network, by the name of its column."""
    noise = np.random.default_rng(0).integers(0, 256, (size, size, 3), dtype=np.uint8)
    current = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    earlier = [np.roll(current, SHIFT_PX, axis=1)] * batch  # nothing near: no second look
    moves = np.tile((1.0, 0.0, 0.0), (batch, 1))
    camera = Camera.from_fov(size, size, math.degrees(2 * math.atan(size / 2 / stored.card.focal_px)))

    def inputs() -> Arrays:
        if stored.card.knows_direction:
            return swept_inputs(earlier, current, moves, camera)
        return paired_inputs(earlier, current)

    made, found = inputs(), {"inputs": inputs}
    opened = {name: partial(runtime, made) for name, runtime in runtimes_of(stored).items()}
    if find_spec("torch"):
        opened["PyTorch f32"] = pytorch(stored.card, made)
    for precision in ("f32", "bf16"):
        if (runtime := runtimes_of(stored).get(f"OpenVINO {precision}")) is not None:
            network = Network(stored.card, runtime)
            opened[f"predict {precision}"] = partial(network.predict, earlier, current, moves, camera)
    return found | opened


def runtimes_of(stored: StoredNetwork) -> dict[str, Runtime]:
    return runtimes(stored.onnx, tuple(stored.card.int8_ranges.items()))


@lru_cache
def runtimes(onnx: bytes, ranges: tuple[tuple[str, tuple[float, float]], ...]) -> dict[str, Runtime]:
    found: dict[str, Runtime] = {"OpenVINO f32": OpenVinoRuntime(onnx)}
    if cpu_runs_bf16():
        found["OpenVINO bf16"] = OpenVinoRuntime(onnx, precision="bf16")
    if ranges:
        found["OpenVINO int8"] = OpenVinoRuntime(onnx, precision="int8", ranges=dict(ranges))
    if find_spec("onnxruntime"):
        found["ONNX Runtime f32"] = OnnxRuntime(onnx)
    return found


def pytorch(card: NetworkCard, made: Arrays) -> Call:
    """The same layers in PyTorch. Their weights are drawn anew: they do not change the time."""
    import torch

    from flightdepth.architectures import DepthNet, FlowNetS, MotionNet
    from flightdepth.training.inputs import motion_inputs, normalised

    network: torch.nn.Module
    if card.knows_direction:
        network = MotionNet(
            card.base_width,
            looks=card.looks,
            thorough_last_look=card.thorough_last_look,
            residual_blocks=card.residual_blocks,
        )
    else:
        plain = FlowNetS if card.architecture == "FlowNetS" else DepthNet
        network = plain(card.base_width, card.activation)
    network = network.eval().to(memory_format=torch.channels_last)
    arrays = [torch.from_numpy(array) for array in made.values()]

    def call() -> object:
        with torch.inference_mode():
            return network(*(motion_inputs(*arrays) if card.knows_direction else (normalised(*arrays),)))

    return call


def times_ms(calls: Mapping[tuple[str, str], Call], seconds: float) -> dict[tuple[str, str], np.ndarray]:
    """Let the calls take turns of 2 + 10 for about `seconds` each, the first 2 of a turn not counted.

    Turns of a single call would charge a runtime for the worker threads of the one before, which spin on for
    some milliseconds in wait of more.
    """
    taken: dict[tuple[str, str], list[float]] = {name: [] for name in calls}
    end = time.perf_counter() + seconds * len(calls)
    while not all(taken.values()) or time.perf_counter() < end:
        for name, call in calls.items():
            time.sleep(0.02)
            for number in range(12):
                start = time.perf_counter()
                call()
                if number >= 2:
                    taken[name].append((time.perf_counter() - start) * 1e3)
    return {name: np.array(values) for name, values in taken.items()}


def operations(onnx: bytes, made: Arrays) -> int:
    """Two for each multiplication and addition of the convolutions and products of matrices of one call."""
    model = openvino_core().read_model(onnx)
    model.reshape({name: list(array.shape) for name, array in made.items()})
    found = 0
    for node in model.get_ops():
        taken, given = [list(each.get_shape()) for each in node.input_values()[:2]], node.outputs()
        match node.get_type_name():
            case "Convolution" | "GroupConvolution":  # weights [(groups,) out, in, kernel]
                found += 2 * math.prod(given[0].get_shape()) * math.prod(taken[1][-3:])
            case "ConvolutionBackpropData":  # weights [in, out, kernel], once for each input
                found += 2 * math.prod(taken[0]) * math.prod(taken[1][-3:])
            case "MatMul":
                found += 2 * math.prod(given[0].get_shape()) * taken[0][-1]
    return found


@cache
def matrix_products() -> dict[str, Call]:
    """A product of two square matrices in each precision, by the runtime whose peak it tells."""
    import openvino as ov
    from openvino import opset13 as op

    draws = np.random.default_rng(0)
    left, right = (draws.uniform(-1, 1, (MATRIX, MATRIX)).astype(np.float32) for _ in range(2))

    def product(precision: str) -> Call:
        given = op.parameter([MATRIX, MATRIX], ov.Type.f32)
        factors = [given, op.constant(right)]
        if precision == "int8":
            ends = [op.constant(np.float32(end)) for end in (-1.0, 1.0)]
            factors = [
                op.fake_quantize(factor, *ends, *ends, levels)
                for factor, levels in zip(factors, (256, 255), strict=True)
            ]
        hints = {"INFERENCE_PRECISION_HINT": "bf16" if precision == "bf16" else "f32"}
        model = ov.Model([op.matmul(*factors, False, False)], [given])
        compiled = openvino_core().compile_model(model, "CPU", hints | {"PERFORMANCE_HINT": "LATENCY"})
        request = compiled.create_infer_request()
        return partial(request.infer, [left], share_inputs=True, share_outputs=True)

    precisions = ["f32", *(["bf16"] if cpu_runs_bf16() else []), "int8"]
    return {f"OpenVINO {precision}": product(precision) for precision in precisions}


def measure(networks: Sequence[StoredNetwork], size: int, batch: int, seconds: float) -> list[Timing]:
    """All networks and runtimes at one size and batch, side by side."""
    found = {stored.card.name: calls_of(stored, size, batch) for stored in networks}
    counts = {
        stored.card.name: operations(stored.onnx, found[stored.card.name]["inputs"]()) for stored in networks
    }
    calls = {(name, runtime): call for name, each in found.items() for runtime, call in each.items()}
    products = matrix_products()
    calls |= {(PEAK, runtime): call for runtime, call in products.items()}
    weights, timings = {stored.card.name: stored.card.sha256 for stored in networks}, []
    taken = times_ms(calls, seconds)
    peaks = {runtime: 2 * MATRIX**3 / taken.pop((PEAK, runtime)).min() for runtime in products}
    for (network, name), values in taken.items():
        median, p95 = np.percentile(values, [50, 95])
        per_ms = peaks.get(name)
        share = None if per_ms is None else round(float(counts[network] / median / per_ms), 3)
        row = (network, weights[network], name, size, batch)
        timing = Timing(
            *row, round(float(median), 3), round(float(p95), 3), len(values), counts[network], share
        )
        timings.append(timing)
    return timings


def table(timings: list[Timing], cpu: str) -> Table:
    cells = [
        (t.network, str(t.size), str(t.batch), t.runtime, f"{t.median_ms:.2f} ({t.p95_ms:.2f})")
        for t in timings
    ]
    return by_runtime(f"ms per call, median (p95), on {cpu}", ("network", "size", "batch"), cells)


def peak_table(timings: list[Timing]) -> Table:
    cells = [
        (t.network, str(t.size), str(t.batch), f"{t.operations / 1e9:.2f}", t.runtime, f"{t.peak_share:.0%}")
        for t in timings
        if t.peak_share is not None
    ]
    title = "share of the machine's matrix peak in the same precision"
    return by_runtime(title, ("network", "size", "batch", "GFLOP"), cells)


def by_runtime(title: str, keys: tuple[str, ...], cells: list[tuple[str, ...]]) -> Table:
    """A row for all cells (keys, runtime, text) of the same keys, and a column for each runtime."""
    texts: dict[tuple[str, ...], dict[str, str]] = defaultdict(dict)
    for *row, runtime, text in cells:
        texts[tuple(row)][runtime] = text
    columns = list(dict.fromkeys(runtime for *_, runtime, _ in cells))
    rows = ([*row, *(found.get(runtime, "") for runtime in columns)] for row, found in texts.items())
    return laid_out(title, (*keys, *columns), rows, names="network")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=list(shipped_networks()))
    parser.add_argument("--sizes", nargs="+", type=int, default=[64, 128, 256, 512])
    parser.add_argument("--batches", nargs="+", type=int, default=[1, 2, 4])
    parser.add_argument(
        "--seconds", type=float, default=1.0, help="of each network and runtime, per size and batch"
    )
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if not given.networks:
        parser.error("no network ships with this build; give --networks FILE.onnx")
    networks, timings = [read_network(name) for name in given.networks], []
    for size in given.sizes:
        for batch in given.batches:
            timings += measure(networks, size, batch, given.seconds)
    cpu = cpu_name()
    console = Console(width=max(Console().width, 150))
    console.print(table(timings, cpu))
    console.print(peak_table(timings))
    if given.json:
        facts = {"commit": source_commit(), "cpu": cpu, "python": platform.python_version()}
        write_json(given.json, facts | {"timings": [asdict(timing) for timing in timings]})


if __name__ == "__main__":
    main()
