"""Milliseconds per inference call: every network, size, batch and runtime that this machine has.

    python benchmarks/infer.py [--networks NAME_OR_FILE ...] [--sizes 64 ... 512] [--batches 1 2 4] [--json FILE]

A call takes frame pairs that are on the network's grid already and gives depth at 1/4 of the size. The runtimes
take turns, so that a busy machine slows all of them alike; compare ratios within one run.
PyTorch is timed too where it is installed.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.evaluation.provenance import source_commit
from flightdepth.files import write_json
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime, cpu_name, cpu_runs_bf16
from flightdepth.runtimes.onnx_ort import OnnxRuntime
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import StoredNetwork, read_network, shipped_networks

Call = Callable[[np.ndarray], np.ndarray]


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


def runtimes(stored: StoredNetwork) -> dict[str, Call]:
    found: dict[str, Call] = {"OpenVINO f32": OpenVinoRuntime(stored.onnx)}
    if cpu_runs_bf16():
        found["OpenVINO bf16"] = OpenVinoRuntime(stored.onnx, precision="bf16")
    if find_spec("onnxruntime"):
        found["ONNX Runtime f32"] = OnnxRuntime(stored.onnx)
    if find_spec("torch"):
        found["PyTorch f32"] = pytorch(stored.card)
    return found


def pytorch(card: NetworkCard) -> Call:
    """The same layers in PyTorch. Their weights are drawn anew: they do not change the time."""
    import torch

    from flightdepth.architectures.depthnet import DepthNet

    network = DepthNet(card.base_width, card.activation).eval().to(memory_format=torch.channels_last)

    def call(pairs: np.ndarray) -> np.ndarray:
        with torch.inference_mode():
            images = torch.from_numpy(pairs).permute(0, 3, 1, 2).float()
            return network((images / 255 - 0.5) / 0.2)[0].numpy()

    return call


def times_ms(calls: dict[str, Call], pairs: np.ndarray, seconds: float) -> dict[str, np.ndarray]:
    """Let the runtimes take turns of 2 + 10 calls for about `seconds`, the first 2 of a turn not counted.

    Turns of a single call would charge a runtime for the worker threads of the one before, which spin on for
    some milliseconds in wait of more.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    end = time.perf_counter() + seconds
    while not all(taken.values()) or time.perf_counter() < end:
        for name, call in calls.items():
            time.sleep(0.02)
            for number in range(12):
                start = time.perf_counter()
                call(pairs)
                if number >= 2:
                    taken[name].append((time.perf_counter() - start) * 1e3)
    return {name: np.array(values) for name, values in taken.items()}


def measure(stored: StoredNetwork, sizes: list[int], batches: list[int], seconds: float) -> list[Timing]:
    calls, rng, timings = runtimes(stored), np.random.default_rng(0), []
    for size in sizes:
        for batch in batches:
            pairs = rng.integers(0, 256, (batch, size, size, 6), dtype=np.uint8)
            for name, taken in times_ms(calls, pairs, seconds).items():
                median, p95 = np.percentile(taken, [50, 95])
                row = (stored.card.name, stored.card.sha256, name, size, batch)
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
    parser.add_argument("--seconds", type=float, default=1.0, help="of turns per size and batch")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if not given.networks:
        parser.error("no network ships with this build; give --networks FILE.onnx")
    timings = []
    for name in given.networks:
        timings += measure(read_network(name), given.sizes, given.batches, given.seconds)
    cpu = cpu_name()
    Console().print(table(timings, cpu))
    if given.json:
        facts = {"commit": source_commit(), "cpu": cpu, "python": platform.python_version()}
        write_json(given.json, facts | {"timings": [asdict(timing) for timing in timings]})


if __name__ == "__main__":
    main()
