"""What the drawn sets look like: depth percentiles beside the original's, and the pictures of docs/stillbox.md.

python benchmarks/stillbox.py [--scenes 300] [--width 128] [--json FILE]
python benchmarks/stillbox.py --sheet docs/images/stillbox-scenes.jpg --outdoor docs/images/outdoor-scenes.jpg \
    --histogram docs/images/stillbox-depth.png
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from contact_sheet import GAP, contact_sheet

from flightdepth.evaluation.metrics import PERCENTILES
from flightdepth.evaluation.provenance import source_commit
from flightdepth.evaluation.table import ORIGINAL_M
from flightdepth.files import write_atomic, write_json
from flightdepth.levels import jpeg
from flightdepth.outputs.encoding import rgb_png
from flightdepth.renderers.raycast import VERSION, render
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox.sets import SceneSet, named_set
from flightdepth.stillbox.testset import SEED, test_textures

ORIGINAL = np.array(ORIGINAL_M)
JPEG_QUALITY = 84
# Width of the pictures, scenes in the row, first scene: every row is as wide as the others.
SHEET_ROWS = ((64, 8, 0), (128, 4, 8), (256, 2, 12), (512, 1, 14))
OUTDOOR_SCENES, OUTDOOR_SCALE = 4, 0.5
TITLE = 26  # px above a row

BLUE, ORANGE, GREY, BLACK = (180, 110, 40), (30, 110, 230), (150, 150, 150), (40, 40, 40)  # BGR
PLOT_WIDTH, PLOT_HEIGHT, SCALE = 900, 520, 2  # drawn at twice the size, for smooth edges
LEFT, RIGHT, TOP, BASE = 180, 20, 30, 270  # of the plot, px; bars stand on BASE
NEAR_M, FAR_M = 1.0, 150.0


def middle_depths(scene_set: SceneSet, scenes: int) -> np.ndarray:
    """Depth in the middle frame of scenes 0 .., float32 [S, H, W]; textures play no part."""
    textures = scene_set.own_textures() or Textures.from_images([])
    found = []
    for number in range(scenes):
        scene = scene_set.scene(number, len(textures))
        found.append(render(scene, textures, scene_set.camera, frames=[scene.frames // 2]).depth_m[0])
    return np.stack(found)


def table(depth_m: np.ndarray) -> dict[str, np.ndarray]:
    """Percentiles of each kind, m."""
    each = np.percentile(depth_m, PERCENTILES, axis=(1, 2)).T
    return {
        "all pixels together": np.percentile(depth_m, PERCENTILES),
        "median of the scenes": np.median(each, axis=0),
        "10 % of the scenes are nearer than": np.percentile(each, 10, axis=0),
        "10 % of the scenes are farther than": np.percentile(each, 90, axis=0),
        "original: nearest of five scenes": ORIGINAL.min(axis=0),
        "original: median of five scenes": np.median(ORIGINAL, axis=0),
        "original: farthest of five scenes": ORIGINAL.max(axis=0),
    }


def line(name: str, values: np.ndarray) -> str:
    return f"{name:42s}" + "".join(f"{value:8.1f}" for value in values)


# Contact sheets


def titled(picture: np.ndarray, text: str) -> np.ndarray:
    """A picture under a line of text, RGB."""
    strip = np.full((TITLE, picture.shape[1], 3), 255, np.uint8)
    cv2.putText(strip, text, (2, TITLE - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, BLACK, 1, cv2.LINE_AA)
    return np.concatenate([strip, picture])


def resolutions_sheet() -> np.ndarray:
    """A row of the test scenes at each resolution, in its own pixels, each beside its depth; RGB."""
    rows = []
    for width, count, first in SHEET_ROWS:
        scenes = SceneSet(StillBoxConfig(), width, width, SEED)
        row = contact_sheet(scenes, test_textures(), scenes=count, columns=count, first=first)
        rows.append(titled(row, f"{width} px"))
    whole = max(row.shape[1] for row in rows)
    return np.concatenate(
        [np.pad(r, ((0, GAP), (0, whole - r.shape[1]), (0, 0)), constant_values=255) for r in rows]
    )


def outdoor_sheet() -> np.ndarray:
    """Scenes of the outdoor set at a part of their size, RGB."""
    scenes, _ = named_set("outdoor")
    sheet = contact_sheet(scenes, scenes.own_textures(), scenes=OUTDOOR_SCENES, columns=2)
    return cv2.resize(sheet, None, fx=OUTDOOR_SCALE, fy=OUTDOOR_SCALE, interpolation=cv2.INTER_AREA)


# The histogram


def column(depth_m: float) -> int:
    """Where a depth stands in the plot, px at the size it is drawn in."""
    share = np.log(depth_m / NEAR_M) / np.log(FAR_M / NEAR_M)
    return round(SCALE * (LEFT + share * (PLOT_WIDTH - LEFT - RIGHT)))


def write(plot: np.ndarray, text: str, x: int, y: int, colour: tuple[int, int, int] = BLACK) -> None:
    """Text whose lower left corner is (x, y), in px of the finished picture."""
    place = (SCALE * x, SCALE * y)
    cv2.putText(plot, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.47 * SCALE, colour, SCALE, cv2.LINE_AA)


def percentile_row(
    plot: np.ndarray, y: int, name: str, values: np.ndarray, colour: tuple[int, int, int]
) -> None:
    """A line from the 5th to the 95th percentile, a box from the 25th to the 75th, a bar at the median."""
    x = [column(value) for value in values]
    y *= SCALE
    cv2.line(plot, (x[0], y), (x[4], y), colour, 2 * SCALE, cv2.LINE_AA)
    cv2.rectangle(plot, (x[1], y - 6 * SCALE), (x[3], y + 6 * SCALE), colour, cv2.FILLED)
    cv2.line(plot, (x[2], y - 6 * SCALE), (x[2], y + 6 * SCALE), (255, 255, 255), 2 * SCALE)
    write(plot, name, 6, y // SCALE + 5)


def histogram(depth_m: np.ndarray) -> np.ndarray:
    """Depth of all pixels, and percentiles beside the original's scenes, BGR."""
    plot = np.full((SCALE * PLOT_HEIGHT, SCALE * PLOT_WIDTH, 3), 255, np.uint8)
    edges = np.geomspace(NEAR_M, FAR_M, 61)
    counts, _ = np.histogram(depth_m, edges)
    for low, high, count in zip(edges[:-1], edges[1:], counts / counts.max(), strict=True):
        top = round(SCALE * (BASE - (BASE - TOP) * count))
        cv2.rectangle(plot, (column(low), top), (column(high) - SCALE, SCALE * BASE), BLUE, cv2.FILLED)
    for metres in (1, 2, 5, 10, 20, 50, 100):
        x = column(metres)
        cv2.line(plot, (x, SCALE * BASE), (x, SCALE * (PLOT_HEIGHT - 30)), (225, 225, 225), SCALE)
        write(plot, f"{metres} m", x // SCALE - 14, PLOT_HEIGHT - 10)
    write(plot, "share of all pixels", 6, TOP + 10)
    rows = table(depth_m)
    percentile_row(plot, BASE + 25, "this set: pixels", rows["all pixels together"], BLUE)
    percentile_row(plot, BASE + 52, "median scene", rows["median of the scenes"], BLUE)
    for number, values in enumerate(ORIGINAL):
        percentile_row(plot, BASE + 85 + 27 * number, f"original, scene {number + 1}", values, ORANGE)
    return cv2.resize(plot, (PLOT_WIDTH, PLOT_HEIGHT), interpolation=cv2.INTER_AREA)


def save(path: Path, rgb: np.ndarray) -> None:
    data = jpeg(rgb, JPEG_QUALITY) if path.suffix == ".jpg" else rgb_png(rgb)
    write_atomic(path, data)
    print(f"{path}: {rgb.shape[1]} x {rgb.shape[0]} px, {len(data) / 1e3:.0f} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--width", type=int, default=128)
    for name in ("--sheet", "--outdoor", "--histogram", "--json"):
        parser.add_argument(name, type=Path, metavar="FILE")
    options = parser.parse_args()
    tested = SceneSet(StillBoxConfig(), options.width, options.width, SEED)
    depth_m = middle_depths(tested, options.scenes)
    rows = table(depth_m)
    print(
        f"set {tested.version}, {VERSION}, {options.scenes} test scenes of {options.width} px: percentiles, m"
    )
    print(line("percentile", np.array(PERCENTILES)))
    for name, values in rows.items():
        print(line(name, values))
    outdoor, _ = named_set("outdoor")
    outdoor_m = middle_depths(replace(outdoor, width=outdoor.width // 4, height=outdoor.height // 4), 100)
    print(
        line(
            "outdoor, 100 scenes, without the sky",
            np.percentile(outdoor_m[np.isfinite(outdoor_m)], PERCENTILES),
        )
    )
    print(f"share of sky outdoors: {np.isinf(outdoor_m).mean():.3f}")
    if options.sheet:
        save(options.sheet, resolutions_sheet())
    if options.outdoor:
        save(options.outdoor, outdoor_sheet())
    if options.histogram:
        save(options.histogram, histogram(depth_m)[..., ::-1])
    if options.json:
        figures = {name: values.tolist() for name, values in rows.items()}
        facts = {"commit": source_commit(), "set": tested.version, "seed": SEED, "renderer": VERSION}
        facts |= {"scenes": options.scenes, "width": options.width}
        write_json(options.json, facts | {"percentiles_m": figures})


if __name__ == "__main__":
    main()
