"""Masks: which part of every picture shows the scene, and which parts of the drone or burned-in text.

What moves with the camera looks infinitely far, and hides what lies behind it. A mask is black (0) there, and anything
else where the scene is seen, as in COLMAP (its `mask_path`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from flightdepth.errors import BadInput
from flightdepth.levels import picture_in
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.sampling import shown_at


@dataclass(frozen=True, eq=False)
class PictureMask:
    """A mask that was read from `path`; shown [h, w] is False where it is black."""

    path: Path
    shown: Flags

    @classmethod
    def read(cls, path: Path) -> PictureMask:
        """From a picture that OpenCV reads, of grey levels or of colours."""
        try:
            grey = picture_in(path.read_bytes(), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
        except OSError as error:
            raise BadInput(f"--mask {path}", expected="a picture", got=error.strerror) from error
        if grey is None:
            raise BadInput(f"--mask {path}", expected="a picture, such as a PNG", got="another file")
        if not grey.any():
            raise BadInput(f"--mask {path}", expected="white where the scene is seen", got="black alone")
        return cls(path, np.asarray(grey > 0))

    def at(self, width: int, height: int) -> PictureMask:
        """The same for pictures of this size, which must have its shape."""
        own_height, own_width = self.shown.shape
        if abs(own_width * height - own_height * width) > max(own_width, width):  # more than a pixel off
            expected, got = f"a picture of {width}x{height}, or of its shape", f"{own_width}x{own_height}"
            raise BadInput(f"--mask {self.path}", expected=expected, got=got)
        return PictureMask(self.path, shown_at(self.shown, width, height))

    def __str__(self) -> str:
        return f"{self.path}, black in {1 - self.shown.mean():.1%} of the picture"

    @cached_property
    def digest(self) -> str:
        """Tells this mask from another one: the first digits of SHA-256 over its size and its pixels."""
        told = hashlib.sha256(np.array(self.shown.shape, np.int64).tobytes() + self.shown.tobytes())
        return told.hexdigest()[:16]
