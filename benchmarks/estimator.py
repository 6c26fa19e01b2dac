"""Time of each stage of the estimator, ms a frame: python benchmarks/estimator.py [--network NAME].

Without --network a stand-in answers at once with the depth of flat ground under a sky, so that everything
but the network is timed. With one, its outputs on noise choose the pairs; only the times mean something.
Times are the process's processor time on one thread: what else runs on the machine counts little.

The flight is told its attitude, and goes sideways past noise. With --wobble every second picture is turned by
that many degrees and no log says so: then each pair is turned back. Without --attitude the direction of motion is
seen in the pictures.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.provenance import network_facts, origin_of, source_commit
from flightdepth.files import write_json
from flightdepth.processor import cpu_name
from flightdepth.ranges import MultiRangeEstimator, derotation, view
from flightdepth.ranges.seen import Seen
from flightdepth.ranges.turning import turned
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.network import load_network
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

FRAME_NS = 33_366_667
SPEED_M_S = (5.0, 0.0, 0.0)
NORTH = (1.0, 0.0, 0.0, 0.0)  # an attitude that leaves world axes the camera's
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
        self,
        previous_n: Sequence[Any],
        current: Any,
        displacements_n3: np.ndarray,
        camera: Camera,
        valid: np.ndarray | None = None,
    ) -> Prediction:
        shape = camera.height // 4, camera.width // 4
        middle = (64 - shape[0]) // 2
        depth_m = self._depth_m[middle : middle + shape[0], : shape[1]]
        reach_m = (self.card.alpha * np.linalg.norm(displacements_n3, axis=1)).astype(np.float32)[
            :, None, None
        ]
        beta = np.clip(depth_m / reach_m, self.card.beta_min, 1)
        return Prediction(beta, beta * reach_m, None, np.ones(shape, np.bool_) if valid is None else valid)


class Stages:
    """Milliseconds by stage, summed over the calls of each frame."""

    def __init__(self) -> None:
        self.frames: list[dict[str, float]] = []

    def watch(self, owner: object, method: str, stage: str) -> None:
        """Time every call of `owner.method`."""
        call: Callable[..., Any] = getattr(owner, method)

        def timed(*args: Any, **kwargs: Any) -> Any:
            started = time.process_time()
            result = call(*args, **kwargs)
            self.frames[-1][stage] += (time.process_time() - started) * 1e3
            return result

        setattr(owner, method, timed)


def measure(network: Any, camera: Camera, ranges: int, options: argparse.Namespace) -> dict[str, np.ndarray]:
    """Fly past noise and return ms by stage, one entry a frame; the first WARM_UP are left out."""
    flight = MultiRangeEstimator(network, camera, ranges=ranges, derotate=options.derotate)
    stages = Stages()
    with ExitStack() as undo:
        for owner, method, stage in (
            (flight, "add_frame", "all"),
            (flight._view.grid, "image", "resample"),
            (flight, "_pairs", "integrate, pairs"),
            (flight._choice._directions, "of", "  direction seen"),
            (flight._view.derotation, "of", "derotation"),
            (flight._view.tracker, "rays_turned", "  corners, tracks"),
            (derotation, "remainder", "  solution"),
            (view, "turned", "turned pictures"),
            (flight._view, "predict", "predict"),
            (flight._view, "fuse", "fusion"),
            (flight._choice._first.planner, "learn", "k-means, plan"),
            (flight._held_still, "add", "temporal average"),
            (Seen, "result", "maps at the source"),
            (flight._view.grid, "along_edges", "  depth along edges"),
        ):
            undo.callback(setattr, owner, method, getattr(owner, method))
            stages.watch(owner, method, stage)
        fly(flight, camera, WARM_UP + options.frames, options, stages)
    measured = [frame for frame in stages.frames[WARM_UP:] if "predict" in frame]
    names = dict.fromkeys(name for frame in measured for name in frame)
    ms = {name: np.array([frame.get(name, 0.0) for frame in measured]) for name in names}
    return ms | {"all but predict": ms["all"] - ms["predict"]}


def fly(
    flight: MultiRangeEstimator, camera: Camera, frames: int, options: argparse.Namespace, stages: Stages
) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (camera.height, camera.width, 3), dtype=np.uint8)
    noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5 * camera.width / 256), dtype=np.uint8)
    wobble = np.asarray(cv2.Rodrigues(np.radians([0.0, options.wobble, 0.0]))[0])
    for index in range(frames):
        stamp_ns = index * FRAME_NS
        for part in range(VELOCITIES_PER_FRAME):
            flight.add_velocity(stamp_ns + part * FRAME_NS // VELOCITIES_PER_FRAME, SPEED_M_S)
        if options.attitude:
            flight.add_attitude(stamp_ns, NORTH)
        image = np.roll(noise, index, axis=1)
        stages.frames.append(defaultdict(float))
        flight.add_frame(stamp_ns, turned(image, wobble, camera) if index % 2 and options.wobble else image)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--network", help="a shipped name or an ONNX file; without it a stand-in")
    parser.add_argument("--size", type=int, nargs=2, default=[854, 480], help="source size, px")
    parser.add_argument("--ranges", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    parser.add_argument("--derotate", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--attitude", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--wobble", type=float, default=0.0, help="degrees")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    network = load_network(arguments.network) if arguments.network else StandIn()
    # The field of view that fills a 256 px wide grid at the network's focal length.
    fov_deg = 2 * float(np.degrees(np.arctan(128 / network.card.focal_px)))
    camera = Camera.from_fov(*arguments.size, fov_deg)
    grid = network.grid(camera).camera
    origin = "nothing runs" if isinstance(network, StandIn) else origin_of(network)
    print(f"{network.card.name} on {cpu_name()}: {origin}")
    print(f"source {camera.width}x{camera.height}, grid {grid.width}x{grid.height}")
    figures = {}
    for ranges in arguments.ranges:
        ms = measure(network, camera, ranges, arguments)
        figures[ranges] = {s: [float(np.median(t)), float(np.percentile(t, 95))] for s, t in ms.items()}
        print(f"ranges {ranges}: ms a frame, median and p95 of {len(ms['all'])} with depth")
        for stage, (median, p95) in figures[ranges].items():
            print(f"  {stage:18}{median:8.2f}{p95:8.2f}")
    if arguments.json:
        settings = {name: value for name, value in vars(arguments).items() if name != "json"}
        told = None if isinstance(network, StandIn) else network_facts(network)
        facts = {"commit": source_commit(), "cpu": cpu_name(), "network": told}
        write_json(arguments.json, facts | {"settings": settings, "ms": figures})


if __name__ == "__main__":
    main()
