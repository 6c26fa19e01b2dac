"""The camera model: OpenCV pixels (the centre of the top-left pixel is 0, 0), x right, y down, z forward."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput

Model = Literal["pinhole", "fisheye"]
DISTORTION_LENGTHS = {"pinhole": (0, 4, 5, 8, 12, 14), "fisheye": (0, 4)}


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels. `distortion` holds OpenCV's coefficients for `model`, none for an ideal lens."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: Model = "pinhole"

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise BadInput("camera size", expected="at least 1x1 px", got=f"{self.width}x{self.height}")
        if not (math.isfinite(self.fx) and math.isfinite(self.fy) and self.fx > 0 and self.fy > 0):
            raise BadInput(
                "camera focal length",
                expected="a positive number of pixels",
                got=f"fx={self.fx}, fy={self.fy}",
                mend="Give --hfov DEGREES or a calibration file.",
            )
        if not (math.isfinite(self.cx) and math.isfinite(self.cy)):
            raise BadInput("camera principal point", expected="finite pixels", got=f"{self.cx}, {self.cy}")
        if self.model not in DISTORTION_LENGTHS:
            raise BadInput("camera model", expected="pinhole or fisheye", got=repr(self.model))
        if len(self.distortion) not in DISTORTION_LENGTHS[self.model]:
            expected = " or ".join(map(str, DISTORTION_LENGTHS[self.model]))
            raise BadInput(
                f"{self.model} distortion", expected=f"{expected} coefficients", got=str(len(self.distortion))
            )

    @classmethod
    def from_fov(cls, width: int, height: int, horizontal_fov_deg: float) -> Camera:
        """Ideal pinhole with square pixels: focal = width / (2 tan(fov / 2)), centred."""
        if not 0 < horizontal_fov_deg < 180:
            raise BadInput(
                "horizontal field of view",
                expected="more than 0 and less than 180 degrees",
                got=str(horizontal_fov_deg),
            )
        focal = width / 2 / math.tan(math.radians(horizontal_fov_deg) / 2)
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Intrinsic matrix K, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def horizontal_fov_deg(self) -> float:
        """Angle between the outer edges of the first and last column, without distortion."""
        left, right = (self.cx + 0.5) / self.fx, (self.width - 0.5 - self.cx) / self.fx
        return math.degrees(math.atan(left) + math.atan(right))

    def without_distortion(self) -> Camera:
        """The ideal pinhole with the same intrinsics."""
        return replace(self, distortion=(), model="pinhole")

    def resized(self, width: int, height: int) -> Camera:
        """The same view at another size; edges of the picture stay edges, so pixel centres move by half pixels."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """The part of the view whose top-left pixel is (x, y); it may reach beyond the picture (padding)."""
        return replace(self, width=width, height=height, cx=self.cx - x, cy=self.cy - y)

    def rays(self) -> NDArray[np.float64]:
        """Direction of each pixel centre with z = 1, shape (H, W, 3), for an ideal pinhole."""
        if self.distortion:
            raise BadInput("rays of a distorted camera", mend="Undistort first: camera.without_distortion().")
        x = (np.arange(self.width) - self.cx) / self.fx
        y = (np.arange(self.height) - self.cy) / self.fy
        rays_hw3 = np.ones((self.height, self.width, 3))
        rays_hw3[..., 0] = x
        rays_hw3[..., 1] = y[:, None]
        return rays_hw3
