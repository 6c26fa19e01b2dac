"""The folder layout of the original Still Box, written scene by scene.

`NN/RGB_SSSS_FF.jpg`, `NN/depth_SSSS_FF.npy` (float32 metres) and `NN/metadata.json`. A scene is named there
when all of its files stand, so that a crash leaves a smaller set, never a broken one.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.files import write_atomic, write_json
from flightdepth.renderers.raycast import VERSION, Rendered
from flightdepth.scenes import Scene, StillBoxConfig
from flightdepth.scenes.config import SET_VERSION

SCENES_PER_FOLDER = 100
DEPTH_CLIP_M = (0.1, 200.0)
JPEG_QUALITY = 95


class OriginalLayout:
    """A set on its way to the disk; scenes are added in the order of their numbers, from 0."""

    def __init__(self, folder: Path, config: StillBoxConfig, width: int, seed: int) -> None:
        self._folder = folder
        self._config = config
        self._head = {
            "args": config.model_dump(mode="json")
            | {"seed": seed, "renderer": VERSION, "set_version": SET_VERSION, "depth_clip_m": DEPTH_CLIP_M},
            "fov": config.horizontal_fov_deg,
            "resolution": [width, width],
        }
        self._scenes: list[dict[str, Any]] = []

    def add(self, number: int, scene: Scene, rendered: Rendered) -> None:
        """Write scene `number` and name it in its folder's metadata."""
        place = number % SCENES_PER_FOLDER
        self._scenes = self._scenes if place else []
        target = self._folder / f"{number // SCENES_PER_FOLDER:02d}"
        target.mkdir(exist_ok=True)
        images = [f"RGB_{place:04d}_{frame:02d}.jpg" for frame in range(scene.frames)]
        depths = [f"depth_{place:04d}_{frame:02d}.npy" for frame in range(scene.frames)]
        for name, image in zip(images, rendered.images, strict=True):
            write_atomic(target / name, jpeg(image))
        for name, depth_m in zip(depths, rendered.depth_m, strict=True):
            write_atomic(target / name, npy(depth_m.clip(*DEPTH_CLIP_M)))
        self._scenes.append(self._described(scene) | {"imgs": images, "depth": depths})
        facts = {"scenes_nb": len(self._scenes), "scenes": self._scenes}
        write_json(target / "metadata.json", self._head | facts)

    def _described(self, scene: Scene) -> dict[str, Any]:
        """Facts of a scene; speed right, up, forward in m/s; no orientations, since the camera does not turn."""
        steps = np.diff(scene.camera_position, axis=0) / self._config.time_step_s
        right, down, forward = (steps[0] @ scene.world_from_camera[0]).tolist()
        return {
            "length": scene.frames,
            "speed": [right, -down, forward],
            "time_step": self._config.time_step_s,
            "orientation": [],
        }


def jpeg(image: NDArray[np.uint8]) -> bytes:
    """An RGB picture [H, W, 3] as JPEG."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def npy(array: NDArray[np.float32]) -> bytes:
    """An array as numpy's own file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()
