"""A rendered scene as the bytes and facts that are stored of it, whichever way a set is laid out."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.levels import jpeg
from flightdepth.renderers import raycast
from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes import Scene, Textures
from flightdepth.stillbox.camera_path import described_path
from flightdepth.stillbox.sets import SceneSet

DEPTH_CLIP_M = (0.1, 200.0)  # the original's; a sky is 200 m away
JPEG_QUALITY = 95
JPEG_LARGEST_PX = 65_500  # a side


@dataclass(frozen=True)
class Renderer:
    """A way to draw a scene's frames, and the name and version under which a set remembers it."""

    name: str
    render: Callable[[Scene, Textures, Camera], Rendered]


RAYCAST = Renderer(raycast.VERSION, raycast.render)


@dataclass(frozen=True)
class EncodedScene:
    """Scene `number`: its metadata, and for each frame a JPEG picture and a depth map as .npy (float32, metres)."""

    number: int
    facts: dict[str, Any]
    pictures: tuple[bytes, ...]
    depths: tuple[bytes, ...]


@dataclass(frozen=True)
class Source:
    """What every byte of a stored set follows from, besides the textures."""

    scenes: SceneSet
    renderer: Renderer = RAYCAST

    def __post_init__(self) -> None:
        width, height = self.scenes.width, self.scenes.height
        if max(width, height) > JPEG_LARGEST_PX:
            raise BadInput(
                "pictures of a set",
                expected=f"at most {JPEG_LARGEST_PX:,} px a side, as JPEG",
                got=f"{width}x{height}",
            )

    def encoded(self, number: int, textures: Textures) -> EncodedScene:
        """Draw, render and encode scene `number`."""
        scene = self.scenes.scene(number, len(textures))
        rendered = self.renderer.render(scene, textures, self.scenes.camera)
        return EncodedScene(
            number,
            described_path(scene, self.scenes.config.time_step_s),
            tuple(jpeg(image, JPEG_QUALITY) for image in rendered.images),
            tuple(npy(depth_m.clip(*DEPTH_CLIP_M)) for depth_m in rendered.depth_m),
        )

    def arguments(self, textures: Textures) -> dict[str, Any]:
        """Every setting that decides the bytes; `fov` and `resolution` as the authors' evaluation looks for them."""
        return {
            "fov": self.scenes.config.horizontal_fov_deg,
            "resolution": [self.scenes.width, self.scenes.height],
            "seed": self.scenes.seed,
            "textures": len(textures),
            "textures_sha256": textures.digest,
            "renderer": self.renderer.name,
            "set_version": self.scenes.version,
            "depth_clip_m": list(DEPTH_CLIP_M),
            "jpeg": f"quality {JPEG_QUALITY}, opencv {cv2.__version__}",
        } | self.scenes.config.model_dump(mode="json")


def npy(array: NDArray[np.float32]) -> bytes:
    """An array as numpy's own file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()
