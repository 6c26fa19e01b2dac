"""Time of each stage of the estimator, ms a frame: python benchmarks/estimator.py [--network NAME].

Without --network a stand-in answers at once with the depth of flat ground under a sky, so that everything
but the network is timed. With one, its outputs on noise choose the pairs; only the times mean something.
Times are the process's processor time, all its threads summed up: what else runs on the machine does not count.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.network import load_network
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

FRAME_NS = 33_366_667
SPEED_M_S = (5.0, 0.0, 0.0)
VELOCITIES_PER_FRAME = 2
WARM_UP = 150


class StandIn:
    """Flat ground 10 m below, sky above, for a 256x256 grid; takes no time beyond looking it up."""

    def __init__(self) -> None:
        self.card = NetworkCard(
            name="stand-in",
            architecture="DepthNet",
            base_width=16,
            activation="none",
            nominal_shift=5,
            D0_m=0.5,
            depth_min_m=10,
            depth_max_m=60,
            focal_px=128,
            width=256,
            height=256,
            samples=0,
        )
        down = np.maximum(np.linspace(-1, 1, 64), 1e-3)
        self._depth_m = np.repeat((10 / down).astype(np.float32)[:, None], 64, axis=1)

    def grid(self, camera: Camera) -> NetworkGrid:
        return NetworkGrid(camera, self.card.focal_px)

    def predict(
        self, previous_n: Sequence[Any], current: Any, displacements_n3: np.ndarray, camera: Camera
    ) -> Prediction:
        shape = camera.height // 4, camera.width // 4
        middle = (64 - shape[0]) // 2
        depth_m = self._depth_m[middle : middle + shape[0], : shape[1]]
        reach_m = (self.card.alpha * np.linalg.norm(displacements_n3, axis=1)).astype(np.float32)[
            :, None, None
        ]
        beta = np.clip(depth_m / reach_m, self.card.beta_min, 1)
        return Prediction(beta, beta * reach_m, None, np.ones(shape, dtype=np.bool_))


class Stages:
    """Milliseconds by stage, one entry a frame."""

    def __init__(self) -> None:
        self.ms: dict[str, list[float]] = defaultdict(list)

    def watch(self, owner: object, method: str, stage: str) -> None:
        """Time every call of `owner.method`."""
        call: Callable[..., Any] = getattr(owner, method)

        def timed(*args: Any, **kwargs: Any) -> Any:
            started = time.process_time()
            result = call(*args, **kwargs)
            self.ms[stage].append((time.process_time() - started) * 1e3)
            return result

        setattr(owner, method, timed)


def measure(network: Any, camera: Camera, ranges: int, frames: int) -> dict[str, list[float]]:
    """Fly `frames` frames of noise sideways and return ms by stage; the first WARM_UP are left out."""
    estimator = MultiRangeEstimator(network, camera, ranges=ranges)
    stages = Stages()
    stages.watch(estimator, "add_frame", "all")
    stages.watch(estimator._grid, "image", "resample")
    stages.watch(estimator, "_pairs", "integrate, pairs")
    stages.watch(estimator, "_predict", "predict")
    stages.watch(estimator, "_fuse", "fusion")
    stages.watch(estimator._planner, "learn", "k-means, plan")
    stages.watch(estimator, "_result", "upsample")
    noise = np.random.default_rng(0).integers(0, 256, (camera.height, camera.width, 3), dtype=np.uint8)
    for index in range(WARM_UP + frames):
        stamp_ns = index * FRAME_NS
        for part in range(VELOCITIES_PER_FRAME):
            estimator.add_velocity(stamp_ns + part * FRAME_NS // VELOCITIES_PER_FRAME, SPEED_M_S)
        estimator.add_frame(stamp_ns, np.roll(noise, index, axis=1))
    ms = {stage: taken[-frames:] for stage, taken in stages.ms.items()}
    predict = np.array(ms["predict"])
    return ms | {"all but predict": list(np.array(ms["all"]) - predict)}


def cpu() -> str:
    """The processor's name and how many cores there are."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(names) or '?'} threads"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--network", help="a shipped name or an ONNX file; without it a stand-in")
    parser.add_argument("--size", type=int, nargs=2, default=[854, 480], help="source size, px")
    parser.add_argument("--ranges", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    arguments = parser.parse_args()
    network = load_network(arguments.network) if arguments.network else StandIn()
    # The field of view that fills a 256 px wide grid at the network's focal length.
    fov_deg = 2 * float(np.degrees(np.arctan(128 / network.card.focal_px)))
    camera = Camera.from_fov(*arguments.size, fov_deg)
    grid = network.grid(camera).camera
    print(f"{network.card.name} on {cpu()}")
    print(f"source {camera.width}x{camera.height}, grid {grid.width}x{grid.height}")
    figures = {}
    for ranges in arguments.ranges:
        ms = measure(network, camera, ranges, arguments.frames)
        figures[ranges] = {s: [float(np.median(t)), float(np.percentile(t, 95))] for s, t in ms.items()}
        print(f"ranges {ranges}: ms a frame, median and p95 of {arguments.frames}")
        for stage, (median, p95) in figures[ranges].items():
            print(f"  {stage:18}{median:8.2f}{p95:8.2f}")
    if arguments.json:
        arguments.json.write_text(
            json.dumps({"cpu": cpu(), "network": network.card.name, "ms": figures}, indent=2)
        )


if __name__ == "__main__":
    main()
