"""What the drawn set looks like: depth percentiles beside the original's, and a contact sheet.

python benchmarks/stillbox.py [--scenes 300] [--width 128] [--sheet docs/images/stillbox-scenes.jpg] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.files import write_atomic
from flightdepth.renderers.raycast import VERSION, render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.config import SET_VERSION
from flightdepth.stillbox.contact_sheet import contact_sheet
from flightdepth.stillbox.testset import SEED, test_textures

SHARES = (5, 25, 50, 75, 95)
# Five scenes of 256 px that were published with the original set, m.
ORIGINAL = np.array(
    [
        [4.7, 7.8, 16, 20, 55],
        [2.7, 4.3, 9.4, 24, 41],
        [2.7, 4.7, 47, 56, 70],
        [5.5, 9.4, 42, 59, 67],
        [5.5, 6.7, 11, 65, 81],
    ]
)


def scene_percentiles(scenes: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Depth percentiles in the middle frame of each test scene [S, 5], and of all pixels together [5], m."""
    config, blank = StillBoxConfig(), Textures.from_images([])
    camera = Camera.from_fov(width, width, config.horizontal_fov_deg)
    depth_m = np.stack(
        [
            render(draw_scene(config, 0, SEED, n), blank, camera, frames=[config.frames // 2]).depth_m[0]
            for n in range(scenes)
        ]
    )
    return np.percentile(depth_m, SHARES, axis=(1, 2)).T, np.percentile(depth_m, SHARES)


def line(name: str, values: np.ndarray) -> str:
    return f"{name:42s}" + "".join(f"{value:8.1f}" for value in values)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--width", type=int, default=128)
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    each, pooled = scene_percentiles(options.scenes, options.width)
    rows = {
        "all pixels together": pooled,
        "median of the scenes": np.median(each, axis=0),
        "10 % of the scenes are nearer than": np.percentile(each, 10, axis=0),
        "10 % of the scenes are farther than": np.percentile(each, 90, axis=0),
        "original: nearest of five scenes": ORIGINAL.min(axis=0),
        "original: median of five scenes": np.median(ORIGINAL, axis=0),
        "original: farthest of five scenes": ORIGINAL.max(axis=0),
    }
    print(
        f"set {SET_VERSION}, {VERSION}, {options.scenes} test scenes of {options.width} px: depth percentiles, m"
    )
    print(line("percentile", np.array(SHARES)))
    for name, values in rows.items():
        print(line(name, values))
    if options.sheet:
        sheet = contact_sheet(StillBoxConfig(), test_textures(), SEED)
        _, data = cv2.imencode(".jpg", sheet[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
        write_atomic(options.sheet, data.tobytes())
        print(f"{options.sheet}: {len(data) / 1e3:.0f} kB")
    if options.json:
        figures = {name: values.tolist() for name, values in rows.items()}
        options.json.write_text(
            json.dumps({"set": SET_VERSION, "renderer": VERSION, "percentiles_m": figures})
        )


if __name__ == "__main__":
    main()
