"""What depth at a picture's own pixels gains by the picture's edges, beside plain interpolation; and what it takes.

    python benchmarks/edges.py [--networks NAME ...] [--scenes 16]

Rendered rooms and flights outdoors that nothing else uses, pictures twice as fine as a network of 256 px sees them,
true depth at every pixel of theirs. One core; compare within a run.

at edges  within 4 px of where true depths are 1.3 times apart
hanging   of pixels with true depths 1.5 times apart within 6 px: those whose depth is no one's there, by over 12 %
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.commands.terminal import counted
from flightdepth.evaluation.provenance import origin_of
from flightdepth.processor import cpu_name
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.network import Network, load_network
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.outdoor import draw_outdoor
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox.pairs import Pair
from flightdepth.stillbox.sets import ANY_FLIGHT

SEED = 771
FOV_DEG = (50.0, 70.0, 90.0, 100.0)
ONE_LENS_DEG = 90.0
LARGEST_ERROR = 2.0  # relative; more counts as this
EDGE_PX, HANGING_PX = 4, 6
HEADINGS = ("mean", "median", "at edges: mean", "median", "hanging", "ms")


def rooms(count: int, network: Network) -> Iterator[Pair]:
    textures = Textures.procedural(64, SEED)
    for number in range(count):
        camera = lens(number, 512, 384, network)
        scene = draw_scene(StillBoxConfig(), len(textures), SEED, number)
        seen = render(scene, textures, camera, frames=(0, 3))
        yield Pair(seen.images[0], seen.images[1], seen.depth_m[1], scene.displacement(0, 3), camera)


def outdoors(count: int, network: Network) -> Iterator[Pair]:
    textures = outdoor_textures(SEED)
    for number in range(count):
        camera, scene = lens(number, 640, 384, network), draw_outdoor(ANY_FLIGHT, SEED, number)
        seen = render(scene, textures, camera, frames=(20, 22))
        yield Pair(seen.images[0], seen.images[1], seen.depth_m[1], scene.displacement(20, 22), camera)


def lens(number: int, width: int, height: int, network: Network) -> Camera:
    fov_deg = FOV_DEG[number % len(FOV_DEG)] if network.card.any_lens else ONE_LENS_DEG
    return Camera.from_fov(width, height, fov_deg)


def extremes(truth_m: np.ndarray, within_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Nearest and farthest true depth of those around each pixel."""
    around, known = np.ones((2 * within_px + 1,) * 2), np.isfinite(truth_m)
    nearest = cv2.erode(np.where(known, truth_m, 1e9).astype(np.float32), around)
    return nearest, cv2.dilate(np.where(known, truth_m, 0).astype(np.float32), around)


def hangs(depth_m: np.ndarray, truth_m: np.ndarray) -> float:
    nearest, farthest = extremes(truth_m, HANGING_PX)
    off = np.full(truth_m.shape, np.inf, np.float32)
    steps = range(-HANGING_PX, HANGING_PX + 1, 2)
    for shift in ((down, right) for down in steps for right in steps):
        ratio = np.abs(np.log(depth_m / np.roll(truth_m, shift, (0, 1))))
        off = np.fmin(off, ratio)
    asked = np.isfinite(truth_m) & np.isfinite(depth_m) & (farthest > 1.5 * nearest)
    return float((off[asked] > 0.12).mean()) if asked.any() else np.nan


def measured(sample: Callable[[], np.ndarray], truth_m: np.ndarray) -> tuple[float, ...]:
    """Figures under HEADINGS: relative errors of a map, and what it took from the network's output."""
    began = time.perf_counter()
    depth_m = sample()
    took_ms = (time.perf_counter() - began) * 1000
    known = np.isfinite(truth_m) & np.isfinite(depth_m)
    off = np.minimum(np.abs(depth_m / truth_m - 1), LARGEST_ERROR)
    nearest, farthest = extremes(truth_m, EDGE_PX)
    edge = known & (farthest > 1.3 * nearest)
    at_edges = off[edge] if edge.any() else np.array([np.nan])
    errors = off[known].mean(), np.median(off[known]), at_edges.mean(), np.median(at_edges)
    return (*errors, hangs(depth_m, truth_m), took_ms)


def table(name: str, scenes: int) -> Table:
    network, rows = load_network(name, threads=1), defaultdict(list)
    for kind, pairs in (("rooms", rooms), ("outdoors", outdoors)):
        for pair in counted(list(pairs(scenes, network)), f"{name}, {kind}", "pairs"):
            grid, length_m = network.grid(pair.camera), float(np.linalg.norm(pair.displacement))
            found = network.predict([pair.previous], pair.current, pair.displacement[None], pair.camera)
            picture, depth_m = grid.image(pair.current), found.depth_m[0]
            range_m = network.card.at_focal(grid.camera.fx).alpha * length_m
            truth_m = np.where(pair.target_m < range_m, pair.target_m, np.nan)
            ways = {
                "interpolated": lambda grid=grid, depth_m=depth_m: grid.to_source(depth_m),
                "along edges": lambda grid=grid, depth_m=depth_m, picture=picture: (
                    grid.along_edges(depth_m, picture).depth_m
                ),
            }
            for way, sample in ways.items():
                rows[f"{kind}, {way}"].append(measured(sample, truth_m))
    shown = Table(
        "", *HEADINGS, title=f"{name}: relative error at the pictures' own pixels", caption=origin_of(network)
    )
    for row, figures in rows.items():
        *errors, ms = np.array(figures).T
        shown.add_row(row, *(f"{np.nanmean(each):.3f}" for each in errors), f"{np.median(ms):.1f}")
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=["motion"])
    parser.add_argument("--scenes", type=int, default=16, help="of each kind")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    console = Console(width=120)
    console.print(cpu_name())
    for name in given.networks:
        console.print(table(name, given.scenes))


if __name__ == "__main__":
    main()
