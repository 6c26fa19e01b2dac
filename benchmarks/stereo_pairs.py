"""Real pictures with ground truth: three pairs of Middlebury's stereo sets, as a camera that flew sideways saw them.

    python benchmarks/stereo_pairs.py MOTORCYCLE_DIR ALOE_DIR CONES_DIR [--networks NAME ...] [--detail TIMES ...]

MOTORCYCLE_DIR holds motorcycle_left.png, motorcycle_right.png and motorcycle_disp.npz, as skimage/data of scikit-image
0.14's source package does (Scharstein et al. 2014, a quarter of the size); ALOE_DIR holds aloeL.jpg, aloeR.jpg and
aloeGT.png, as the examples of Debian's opencv-doc do (Hirschmueller and Scharstein 2007); CONES_DIR holds left_rgb.tif,
right_rgb.tif and disp_left.tif, as tests/image of the source package of pandora-plugin-mccnn 1.3 does (Scharstein and
Szeliski 2003). None ships with this project, and no network has seen them. On the first two nothing was chosen but that
depth should be aligned with the pictures, how far its judge trusts flow and, on Aloe, how far a second look reaches; on
Cones nothing.

The left picture is the present one, the right one the earlier one; rows and principal points are made to agree.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.evaluation.peer import ClassicalPeer
from flightdepth.evaluation.provenance import origin_of
from flightdepth.ranges.fusion import WORST_SIGMA
from flightdepth.runtimes.network import load_network

# Of the pictures as they are: focal length and what the right principal point lies to the right of, px; baseline, m.
MOTORCYCLE = (994.978, 31.086, 0.193001)
ALOE = (3740.0, 270.0, 0.160)
CONES = (450.0, 0.0, 0.160)  # not published: any length says the same of a ratio; this one sees 53 degrees


@dataclass(frozen=True)
class RealPair:
    name: str
    previous: np.ndarray
    current: np.ndarray
    depth_m: np.ndarray
    displacement: np.ndarray
    camera: Camera


def read_rgb(path: Path) -> np.ndarray:
    return cv2.cvtColor(read_plain(path).astype(np.uint8), cv2.COLOR_BGR2RGB)


def read_plain(path: Path) -> np.ndarray:
    """Of the file's own type: OpenCV turns no floating-point picture into bytes by itself."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise SystemExit(f"{path}: expected a picture")
    return image


def real_pair(
    name: str,
    pictures: tuple[np.ndarray, np.ndarray],
    disparity_px: np.ndarray,
    calibration: tuple[float, ...],
) -> RealPair:
    focal_px, offset_px, baseline_m = calibration
    left, right = pictures
    height, width = left.shape[:2]
    shift = np.array([[1, 0, -offset_px], [0, 1, 0]])
    right = cv2.warpAffine(right, shift, (width, height), flags=cv2.INTER_CUBIC)
    depth_m = focal_px * baseline_m / (np.where(disparity_px > 0, disparity_px, np.nan) + offset_px)
    camera = Camera(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)
    return RealPair(name, right, left, depth_m, np.array([-baseline_m, 0.0, 0.0]), camera)


def real_pairs(motorcycle: Path, aloe: Path, cones: Path) -> Iterator[RealPair]:
    sides = read_rgb(motorcycle / "motorcycle_left.png"), read_rgb(motorcycle / "motorcycle_right.png")
    with np.load(motorcycle / "motorcycle_disp.npz") as stored:
        disparity_px = np.where(np.isfinite(stored["arr_0"]), stored["arr_0"], 0)
    yield real_pair("Motorcycle", sides, disparity_px, MOTORCYCLE)
    sides = read_rgb(aloe / "aloeL.jpg"), read_rgb(aloe / "aloeR.jpg")
    yield real_pair("Aloe", sides, read_plain(aloe / "aloeGT.png").astype(float), ALOE)
    sides = read_rgb(cones / "left_rgb.tif"), read_rgb(cones / "right_rgb.tif")
    yield real_pair("Cones", sides, read_plain(cones / "disp_left.tif").astype(float), CONES)


def answers(
    pair: RealPair, names: list[str], details: list[float]
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Name, depth and what is known of it, a method each."""
    for name, times in product(names, details):
        for aligned in (False, True):
            network = load_network(name, "openvino", precision="f32", aligned=aligned).finer(times)
            found = network.predict([pair.previous], pair.current, pair.displacement[None], pair.camera)
            assert found.sigma_m is not None
            grid = network.grid(pair.camera)
            at_source = grid.along_edges(found.depth_m[0], grid.image(pair.current))
            depth_m, sigma_m = at_source.depth_m, at_source(found.sigma_m[0])
            width = grid.camera.width
            label = f"{name}, {width} px, {'aligned' if aligned else 'not'}"
            yield label, depth_m, sigma_m < WORST_SIGMA * depth_m
    peer: Callable[..., np.ndarray] = ClassicalPeer(0.1, 100).depth
    for width in (256, pair.camera.width):
        camera = pair.camera.resized(width, round(pair.camera.height * width / pair.camera.width))
        size = camera.width, camera.height
        small = [
            cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (pair.previous, pair.current)
        ]
        depth_m = cv2.resize(peer(*small, pair.displacement, camera), pair.current.shape[1::-1])
        yield f"DIS flow, {width} px", depth_m, np.ones(depth_m.shape, bool)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("motorcycle", type=Path)
    parser.add_argument("aloe", type=Path)
    parser.add_argument("cones", type=Path)
    parser.add_argument("--networks", nargs="+", default=["motion", "motion-tiny"])
    parser.add_argument("--detail", nargs="+", type=float, default=[1.0, 2.0], help="as of `run --detail`")
    given = parser.parse_args()
    for name in given.networks:
        print(f"{name}: {origin_of(load_network(name, 'openvino', precision='f32'))}")
    for pair in real_pairs(given.motorcycle, given.aloe, given.cones):
        title = f"{pair.name}, {pair.camera.width}x{pair.camera.height}: relative error at the pictures' own pixels"
        table = Table("", "mean", "median", "over 5 %", "over 25 %", "known", "mean of these", title=title)
        truth = np.isfinite(pair.depth_m)
        for name, depth_m, known in answers(pair, given.networks, given.detail):
            error = np.abs(depth_m / pair.depth_m - 1)
            sure = truth & known
            cells = [
                error[truth].mean(),
                np.median(error[truth]),
                *((error[truth] > e).mean() for e in (0.05, 0.25)),
            ]
            table.add_row(name, *(f"{c:.3f}" for c in (*cells, sure.sum() / truth.sum(), error[sure].mean())))
        Console(width=140).print(table)


if __name__ == "__main__":
    main()
