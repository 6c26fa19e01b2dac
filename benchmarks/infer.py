"""Milliseconds per inference call: every network, size, batch and runtime that this machine has.

    python benchmarks/infer.py [--networks NAME_OR_FILE ...] [--sizes 64 ... 512] [--batches 1 2 4] [--json FILE]

A call takes frame pairs that are on the network's grid already and gives depth at 1/4 of the size. "inputs" is what
comes before any runtime: to lay pairs side by side, or to sweep them along the motion. "predict" is all of
`Network.predict` in OpenVINO, inputs and alignment with the pictures too. All networks and runtimes
take turns, so that a busy machine slows all of them alike; compare ratios within one run.
PyTorch is timed too where it is installed.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.evaluation.provenance import source_commit
from flightdepth.files import write_json
from flightdepth.processor import cpu_name, cpu_runs_bf16
from flightdepth.runtimes.contract import Arrays, Runtime
from flightdepth.runtimes.inputs import paired_inputs, swept_inputs
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.runtimes.onnx_ort import OnnxRuntime
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import StoredNetwork, read_network, shipped_networks

Call = Callable[[], object]
SHIFT_PX = 3


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


def measure(networks: Sequence[StoredNetwork], size: int, batch: int, seconds: float) -> list[Timing]:
    """All networks and runtimes at one size and batch, side by side."""
    calls = {
        (stored.card.name, name): call
        for stored in networks
        for name, call in calls_of(stored, size, batch).items()
    }
    weights, timings = {stored.card.name: stored.card.sha256 for stored in networks}, []
    for (network, name), taken in times_ms(calls, seconds).items():
        median, p95 = np.percentile(taken, [50, 95])
        row = (network, weights[network], name, size, batch)
        timings.append(Timing(*row, round(float(median), 3), round(float(p95), 3), len(taken)))
    return timings


def table(timings: list[Timing], cpu: str) -> Table:
    shown = Table(title=f"ms per call, median (p95), on {cpu}", box=None)
    names = list(dict.fromkeys(timing.runtime for timing in timings))
    for heading in ("network", "size", "batch", *names):
        shown.add_column(heading, justify="left" if heading == "network" else "right")
    cells: dict[tuple[str, int, int], dict[str, str]] = {}
    for timing in timings:
        row = cells.setdefault((timing.network, timing.size, timing.batch), {})
        row[timing.runtime] = f"{timing.median_ms:.2f} ({timing.p95_ms:.2f})"
    for (network, size, batch), row in cells.items():
        shown.add_row(network, str(size), str(batch), *(row[name] for name in names))
    return shown


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
    Console(width=max(Console().width, 150)).print(table(timings, cpu))
    if given.json:
        facts = {"commit": source_commit(), "cpu": cpu, "python": platform.python_version()}
        write_json(given.json, facts | {"timings": [asdict(timing) for timing in timings]})


if __name__ == "__main__":
    main()
