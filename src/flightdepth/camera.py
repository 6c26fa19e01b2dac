"""The camera model: OpenCV pixels (the centre of the top-left pixel is 0, 0), x right, y down, z forward."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput

Model = Literal["pinhole", "fisheye"]
DISTORTION_LENGTHS = {"pinhole": (0, 4, 5, 8, 12, 14), "fisheye": (0, 4)}


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels. `distortion` holds OpenCV's coefficients for `model`, none for an ideal lens.

    As OpenCV gives them: sizes may be whole floats (VideoCapture), coefficients an array (calibrateCamera).
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: Model = "pinhole"

    def __post_init__(self) -> None:
        if not all(side >= 1 and float(side).is_integer() for side in (self.width, self.height)):
            got = f"{self.width}x{self.height}"
            raise BadInput("camera size", expected="whole pixels, at least 1x1", got=got)
        object.__setattr__(self, "width", int(self.width))
        object.__setattr__(self, "height", int(self.height))
        object.__setattr__(self, "distortion", tuple(map(float, np.ravel(self.distortion))))
        if not (math.isfinite(self.fx) and math.isfinite(self.fy) and self.fx > 0 and self.fy > 0):
            raise BadInput(
                "camera focal length",
                expected="a positive number of pixels",
                got=f"fx={self.fx}, fy={self.fy}",
                mend="Give --hfov DEGREES or a calibration file.",
            )
        if not (math.isfinite(self.cx) and math.isfinite(self.cy)):
            raise BadInput("camera principal point", expected="finite pixels", got=f"{self.cx}, {self.cy}")
        if self.model not in tuple(DISTORTION_LENGTHS):  # which anything may be compared with
            raise BadInput("camera model", expected="pinhole or fisheye", got=repr(self.model))
        if len(self.distortion) not in DISTORTION_LENGTHS[self.model]:
            expected = " or ".join(map(str, DISTORTION_LENGTHS[self.model]))
            raise BadInput(
                f"{self.model} distortion", expected=f"{expected} coefficients", got=str(len(self.distortion))
            )

    @classmethod
    def from_fov(
        cls, width: int, height: int, horizontal_fov_deg: float, *, model: Model = "pinhole"
    ) -> Camera:
        """Ideal lens with square pixels, centred.

        Pinhole: focal = width / (2 tan(fov / 2)); fisheye, the equidistant one: focal = width / fov.
        """
        widest = 180 if model == "pinhole" else 360
        if not 0 < horizontal_fov_deg < widest:
            raise BadInput(
                "horizontal field of view",
                expected=f"more than 0 and less than {widest} degrees",
                got=str(horizontal_fov_deg),
            )
        half_rad = math.radians(horizontal_fov_deg) / 2
        focal = width / 2 / (math.tan(half_rad) if model == "pinhole" else half_rad)
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, model=model)

    @property
    def is_ideal(self) -> bool:
        """Whether it is a pinhole, whose pictures need only be resized to be another's."""
        return self.model == "pinhole" and not any(self.distortion)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Intrinsic matrix K, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def horizontal_fov_deg(self) -> float:
        """Angle between the outer edges of the first and last column; a pinhole's distortion is left out."""
        left, right = (self.cx + 0.5) / self.fx, (self.width - 0.5 - self.cx) / self.fx
        if self.model == "fisheye":
            return math.degrees(sum(fisheye_angle_rad(edge, self.distortion) for edge in (left, right)))
        return math.degrees(math.atan(left) + math.atan(right))

    def without_distortion(self) -> Camera:
        """The ideal pinhole with the same intrinsics."""
        return replace(self, distortion=(), model="pinhole")

    @lru_cache  # noqa: B019 - a camera is small, and the same few are resized for each picture
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

    def zoomed(self, times: float) -> Camera:
        """The same pictures through a focal length so many times as long."""
        return replace(self, fx=self.fx * times, fy=self.fy * times)

    def turned(self, quarter_turns: int) -> Camera:
        """The camera of the picture turned by multiples of 90 degrees anticlockwise, as numpy.rot90 turns it."""
        camera = self
        for _ in range(quarter_turns % 4):
            camera = camera._turned_once()
        return camera

    def _turned_once(self) -> Camera:
        # The new x is the old y and the new y the old -x; what bends them (OpenCV's p and s) follows.
        k = self.distortion
        if len(k) == 14 and any(k[12:]):
            raise BadInput("camera of a turned video", expected="a lens model without tilted sensor")
        if self.model == "pinhole" and k:
            k = (*k[:2], -k[3], k[2], *k[4:8], *((k[10], k[11], -k[8], -k[9]) if len(k) > 8 else ()), *k[12:])
        return Camera(
            self.height,
            self.width,
            self.fy,
            self.fx,
            self.cy,
            self.width - 1 - self.cx,
            tuple(k),
            self.model,
        )

    def rays(self) -> NDArray[np.float64]:
        """Direction of each pixel centre with z = 1, shape (H, W, 3), for an ideal pinhole."""
        rays_hw3 = np.ones((self.height, self.width, 3))
        rays_hw3[..., 0], rays_hw3[..., 1] = self.ray_axes()
        return rays_hw3

    def ray_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Those rays' x, which a column shares, shape (W,), and their y, which a row shares, (H, 1)."""
        if self.distortion or self.model == "fisheye":
            raise BadInput("rays of a distorted camera", mend="Undistort first: camera.without_distortion().")
        x = np.asarray((np.arange(self.width) - self.cx) / self.fx, np.float64)
        y = np.asarray((np.arange(self.height) - self.cy) / self.fy, np.float64)
        return x, y[:, None]


def fisheye_angle_rad(radius: float, distortion: tuple[float, ...] = ()) -> float:
    """Angle off the axis that falls `radius` focal lengths from the centre, 0..pi.

    Kannala-Brandt as in OpenCV's fisheye: radius = theta (1 + k1 theta^2 + k2 theta^4 + ...), up to where it
    folds back.
    """
    thetas = np.linspace(0, math.pi, 3142)
    powers = np.ones_like(thetas)
    for power, k in enumerate(distortion, start=1):
        powers += k * thetas ** (2 * power)
    radii = thetas * powers
    falls = np.flatnonzero(np.diff(radii) <= 0)
    rising = slice(0, int(falls[0]) + 1 if len(falls) else None)
    return float(np.interp(radius, radii[rising], thetas[rising]))
