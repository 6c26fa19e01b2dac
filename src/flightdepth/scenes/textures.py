"""Textures as mip pyramids in one block of memory, from a folder of images or made by this package."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.machine import memory_bytes, usable_cores
from flightdepth.scenes import procedural
from flightdepth.scenes.pictures import Image, read_picture

EDGE = 512  # texels, a power of two
LEVELS = EDGE.bit_length()  # 512, 256, ... 1
PYRAMID_TEXELS = sum((EDGE >> level) ** 2 for level in range(LEVELS))
LINEAR = (np.arange(256, dtype=np.float32) / 255) ** 2.2  # light of a byte, 0..1
MEMORY_SHARE = 0.8  # of the machine's, that textures may take, or the pictures of a scene
IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}


@dataclass(frozen=True)
class Textures:
    """`texels` uint8 [T, PYRAMID_TEXELS, 3] RGB, gamma 2.2: each texture's mip levels, finest first, row by row."""

    texels: NDArray[np.uint8]

    def __post_init__(self) -> None:
        if self.texels.dtype != np.uint8 or self.texels.shape[1:] != (PYRAMID_TEXELS, 3):
            raise ValueError(f"texels: expected uint8 [T, {PYRAMID_TEXELS}, 3], got {self.texels.shape}")
        self.texels.setflags(write=False)  # as on the workers of a cluster: compiled code is one for both

    def __len__(self) -> int:
        return len(self.texels)

    @property
    def digest(self) -> str:
        """SHA-256 of the content: what a dataset's config records."""
        content = hashlib.sha256()
        for pyramid in self.texels:
            content.update(np.ascontiguousarray(pyramid[: EDGE * EDGE]).data)
        return content.hexdigest()

    @classmethod
    def from_images(cls, images: Sequence[Image]) -> Textures:
        """Build the pyramids of square-cropped uint8 RGB images of any size."""
        return cls.made(len(images), images.__getitem__)

    @classmethod
    def procedural(cls, count: int, seed: int) -> Textures:
        """`count` textures that this package makes itself, the same for the same seed."""
        return cls.made(count, partial(procedural.texture, seed, edge=EDGE))

    @classmethod
    def made(cls, count: int, image: Callable[[int], Image]) -> Textures:
        """Of `image(number)` for each number below `count`, as for `from_images`; several at a time, on all cores.

        Raises:
            BadInput: this machine has not the memory for so many.
        """
        most = MEMORY_SHARE * memory_bytes() / (3 * PYRAMID_TEXELS)
        if count > most:
            raise BadInput(
                "textures", expected=f"at most {int(most):,}: each takes 1 MB of memory", got=f"{count:,}"
            )
        texels = np.empty((count, PYRAMID_TEXELS, 3), np.uint8)

        def fill(number: int) -> None:
            texels[number] = _pyramid(_square(image(number)))

        with ThreadPoolExecutor(usable_cores()) as executor:
            for _ in executor.map(fill, range(count)):
                pass
        return cls(texels)


def textures_from_folder(folder: Path | str, *, made: int = 0, seed: int = 0) -> Textures:
    """Every image below `folder`, in the order of the file names, then as many `made` ones as `procedural(made, seed)`.

    Raises:
        BadInput: there is no image, or one cannot be read, or there are more than memory holds.
    """
    paths = sorted(p for p in Path(folder).rglob("*") if p.suffix.lower() in IMAGE_SUFFIXES)
    if not paths:
        raise BadInput(f"texture folder {folder}", expected="at least one image", got="none")

    def image(number: int) -> Image:
        photos = len(paths)
        return _read(paths[number]) if number < photos else procedural.texture(seed, number - photos, EDGE)

    return Textures.made(len(paths) + made, image)


def _read(path: Path) -> Image:
    image = read_picture(path)
    if image is None:
        raise BadInput(
            f"texture {path}",
            expected="a whole image that OpenCV can read",
            got="a damaged one, or something else",
        )
    return image


def _square(image: Image) -> Image:
    """The central square, resized to EDGE."""
    height, width = image.shape[:2]
    side = min(height, width)
    y, x = (height - side) // 2, (width - side) // 2
    crop = image[y : y + side, x : x + side]
    method = cv2.INTER_AREA if side > EDGE else cv2.INTER_CUBIC
    return cv2.resize(crop, (EDGE, EDGE), interpolation=method).astype(np.uint8)


def _pyramid(image: Image) -> Image:
    """Mip levels by 2x2 means in linear light, flattened and joined: [PYRAMID_TEXELS, 3]."""
    levels = [image.reshape(-1, 3)]
    linear = cv2.LUT(image, LINEAR)
    while linear.shape[0] > 1:
        linear = (linear[0::2, 0::2] + linear[1::2, 0::2] + linear[0::2, 1::2] + linear[1::2, 1::2]) / 4
        levels.append(np.rint(linear ** (1 / 2.2) * 255).astype(np.uint8).reshape(-1, 3))
    return np.concatenate(levels)
