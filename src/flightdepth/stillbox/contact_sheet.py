"""Many scenes at a glance: each picture beside its depth in colour."""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.stillbox.pairs import Depth, Image

NEAREST_M, FARTHEST_M = 2.0, 100.0  # red to blue, by the logarithm of the depth
GAP = 4  # pixels between scenes


def contact_sheet(
    config: StillBoxConfig,
    textures: Textures,
    seed: int,
    *,
    scenes: int = 16,
    columns: int = 4,
    width: int = 160,
) -> Image:
    """The middle frame of scenes 0 .. scenes - 1 with its depth, uint8 RGB, `columns` scenes in a row."""
    camera = Camera.from_fov(width, width, config.horizontal_fov_deg)
    rows = -(-scenes // columns)
    sheet = np.full((rows * (width + GAP) - GAP, columns * (2 * width + GAP) - GAP, 3), 255, np.uint8)
    for number in range(scenes):
        scene = draw_scene(config, len(textures), seed, number)
        seen = render(scene, textures, camera, frames=[scene.frames // 2])
        y, x = number // columns * (width + GAP), number % columns * (2 * width + GAP)
        sheet[y : y + width, x : x + width] = seen.images[0]
        sheet[y : y + width, x + width : x + 2 * width] = _coloured(seen.depth_m[0])
    return sheet


def _coloured(depth_m: Depth) -> Image:
    """Depth [H, W] as uint8 RGB: near red, far blue."""
    share = np.log(np.clip(depth_m, NEAREST_M, FARTHEST_M) / NEAREST_M) / np.log(FARTHEST_M / NEAREST_M)
    bgr = cv2.applyColorMap(np.rint(255 * (1 - share)).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)
