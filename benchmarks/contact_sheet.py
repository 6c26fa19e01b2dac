"""Many scenes at a glance: each picture beside its depth in colour."""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.renderers.raycast import render
from flightdepth.scenes import Textures
from flightdepth.stillbox.pairs import Depth, Image
from flightdepth.stillbox.sets import SceneSet

NEAREST_M, FARTHEST_M = 2.0, 100.0  # red to blue, by the logarithm of the depth
GAP = 4  # pixels between scenes


def contact_sheet(
    scene_set: SceneSet, textures: Textures, *, scenes: int, columns: int, first: int = 0
) -> Image:
    """The middle frame of scenes `first` ... with its depth, uint8 RGB, `columns` scenes in a row."""
    height, width = scene_set.height, scene_set.width
    rows = -(-scenes // columns)
    sheet = np.full((rows * (height + GAP) - GAP, columns * (2 * width + GAP) - GAP, 3), 255, np.uint8)
    for place in range(scenes):
        scene = scene_set.scene(first + place, len(textures))
        seen = render(scene, textures, scene_set.camera, frames=[scene.frames // 2])
        y, x = place // columns * (height + GAP), place % columns * (2 * width + GAP)
        sheet[y : y + height, x : x + width] = seen.images[0]
        sheet[y : y + height, x + width : x + 2 * width] = coloured_depth(seen.depth_m[0])
    return sheet


def coloured_depth(depth_m: Depth) -> Image:
    """Depth [H, W] as uint8 RGB: near red, far blue, the sky as far as can be."""
    share = np.log(np.clip(depth_m, NEAREST_M, FARTHEST_M) / NEAREST_M) / np.log(FARTHEST_M / NEAREST_M)
    bgr = cv2.applyColorMap(np.rint(255 * (1 - share)).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)
