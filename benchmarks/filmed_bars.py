"""Do error bars hold in filmed pictures? `python benchmarks/filmed_bars.py [--networks NAME ...] [--scenes N]`.

Pictures with two earlier ones, as far apart as flights choose them, of rooms and flights outdoors that nothing else
uses, drawn two or three times as fine as the network sees them. They go through H.264 of a constant rate factor (x264's
own is 23, more is worse) before they are scaled down, as a flight's do, or at the network's own size; or through camera
effects as training draws them. The motion is exact. Of what fusion believes: which share of the errors is inside one
sigma, as the network says it, and made wider by how much both ranges disagree (`ranges.disagreement`; each picture by
itself).
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from judging_pairs import outdoors, room
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.commands.terminal import counted
from flightdepth.evaluation.provenance import origin_of
from flightdepth.processor import cpu_name
from flightdepth.ranges.disagreement import FlownBars, disagreement
from flightdepth.ranges.fusion import best_beta, fuse
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.network import Network, load_network
from flightdepth.runtimes.prediction import Prediction
from flightdepth.scenes import chance
from flightdepth.stillbox.h264 import through_h264
from flightdepth.stillbox.pairs import Image, Pair
from flightdepth.stillbox.photometric import Photometric

SEED = 2018_1_2026
SIZES = ((256, 192), (320, 192), (384, 256), (448, 256))  # at 256 px of focal length
TIMES = (2, 3)  # as fine
ROOM_SHARE = 0.4
LOOKED_AT = (30, 75)  # quantiles of the depth, %
LEAST_RATIO = 1.4  # of both pairs' lengths
DRAWN, EFFECTS = "as drawn", "camera effects"
FINE = {
    "H.264, 18": 18.0,
    "H.264, 23": 23.0,
    "H.264, 28": 28.0,
}  # rate factors of pictures before they are scaled down
SMALL = {"H.264, 22, own size": 22.0}  # and after
WAYS = (DRAWN, *FINE, *SMALL, EFFECTS)
LEAST_PIXELS = 200
FARTHEST_M = 300.0  # what is farther is sky


@dataclass(frozen=True)
class Drawn:
    """Pictures uint8 RGB [H, W, 3] in the order of their times, what lies from the first two to the last, (2, 3) m."""

    pictures: list[Image]
    moved_m: np.ndarray
    depth_m: np.ndarray  # of the last one, the present
    camera: Camera  # as the network sees them
    is_room: bool


def drawn(network: Network, number: int) -> Drawn:
    """Frame `number` of the benchmark."""
    rng = chance.stream(SEED, number, 0)
    width, height = SIZES[rng.integers(len(SIZES))]
    shrunk, focal_px = round(256 / network.card.focal_px), network.card.focal_px
    width, height = (-(-side // (64 * shrunk)) * 64 for side in (width, height))
    fov_deg, times = 2 * np.degrees(np.arctan(width / 2 / focal_px)), int(rng.choice(TIMES))
    camera, fine = (Camera.from_fov(k * width, k * height, fov_deg) for k in (1, times))
    is_room = bool(rng.random() < ROOM_SHARE)
    scene, textures, (there, here) = (room if is_room else outdoors)(SEED, number, rng)
    depth_m = render(scene, textures, camera.resized(64, 48), frames=(here,)).depth_m
    near_m, far_m = np.percentile(depth_m[depth_m < FARTHEST_M], LOOKED_AT)
    per_depth = 1 / (network.card.at_focal(focal_px).alpha * best_beta(network.card))
    lengths_m = per_depth * np.array([max(far_m, LEAST_RATIO * near_m), near_m])
    step = scene.camera_position[there] - scene.camera_position[here]
    path = scene.camera_position[here] + step / np.linalg.norm(step) * np.r_[lengths_m, 0.0][:, None]
    turns = np.repeat(scene.world_from_camera[here : here + 1], 3, axis=0)
    scene = replace(scene, camera_position=path, world_from_camera=turns)
    seen = render(scene, textures, fine, frames=range(3))
    moved_m = np.stack([scene.displacement(k, 2) for k in range(2)])
    return Drawn(list(seen.images), moved_m, seen.depth_m[2], camera, is_room)


def filmed(frame: Drawn, way: str, seed: int) -> list[Image]:
    """Its pictures as the network sees them."""
    size = frame.camera.width, frame.camera.height

    def shrunk(pictures: list[Image]) -> list[Image]:
        return [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in pictures]  # type: ignore[misc]

    if way in FINE:
        return shrunk(through_h264(frame.pictures, FINE[way]))
    pictures = shrunk(frame.pictures)
    if way in SMALL:
        return through_h264(pictures, SMALL[way])
    if way == EFFECTS:
        *earlier, present = pictures
        pairs = [
            Photometric()(
                np.random.default_rng(seed),
                Pair(each, present, frame.depth_m, frame.moved_m[0], frame.camera),
            )
            for each in earlier
        ]
        return [*(pair.previous for pair in pairs), pairs[0].current]
    return pictures


def inside(
    network: Network, found: Prediction, frame: Drawn, truth_m: np.ndarray
) -> tuple[float, float] | None:
    """The share of the errors inside one sigma of the fused depth, and the mean relative error; None of too little."""
    lengths_m = np.linalg.norm(frame.moved_m, axis=1)
    card = network.card.at_focal(frame.camera.fx)
    fused = fuse(found.beta, lengths_m, card, sigma_m=found.sigma_m)
    known = np.isfinite(fused.depth_m) & (truth_m < FARTHEST_M)
    if known.sum() < LEAST_PIXELS or fused.sigma_m is None:
        return None
    error_m = np.abs(fused.depth_m - truth_m)[known]
    held, relative = error_m < fused.sigma_m[known], error_m / truth_m[known]
    return float(held.mean()), float(relative.clip(max=2).mean())


def rows(network: Network, count: int) -> Iterator[tuple[str, bool, list[float]]]:
    for number in counted(range(count), network.card.name, "scenes"):
        frame = drawn(network, number)
        size = frame.camera.width // 4, frame.camera.height // 4
        truth_m = cv2.resize(frame.depth_m.clip(0, 1e5), size, interpolation=cv2.INTER_AREA)
        for way in WAYS:
            *earlier, present = filmed(frame, way, number)
            found = network.predict(earlier, present, frame.moved_m, frame.camera)
            apart = disagreement(found, network.card)
            wider = FlownBars().widened(0, found, network.card)
            told = [inside(network, each, frame, truth_m) for each in (found, wider)]
            if apart is not None and told[0] is not None and told[1] is not None:
                yield way, frame.is_room, [told[0][1], apart, told[0][0], told[1][0]]


def measure(name: str, count: int) -> Table:
    network = load_network(name, threads=1)
    groups: dict[tuple[str, bool], list[list[float]]] = defaultdict(list)
    for way, is_room, values in rows(network, count):
        groups[way, is_room].append(values)
    columns = "pictures", "", "relative error", "ranges disagree", "inside one sigma", "widened"
    table = Table(*columns, title=name, caption=origin_of(network))
    for way in WAYS:
        for is_room in (each for each in (True, False) if groups[way, each]):
            error, apart, told, wider = np.array(groups[way, is_room]).T
            cells = (
                f"{error.mean():.3f}",
                f"{np.median(apart):.2f}",
                f"{told.mean():.1%}",
                f"{wider.mean():.1%}",
            )
            table.add_row(way, "rooms" if is_room else "outdoors", *cells)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=["motion", "motion-tiny"])
    parser.add_argument("--scenes", type=int, default=60)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    console = Console(width=140)
    console.print(cpu_name())
    for name in given.networks:
        console.print(measure(name, given.scenes))


if __name__ == "__main__":
    main()
