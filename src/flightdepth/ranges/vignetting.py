"""How much darker pictures are towards their corners, learnt from the flight, and pictures without that.

A point that moves outwards through such a lens darkens, and networks take that for motion: with 58 % of the light in
the corners the error of `motion` is half as large again (docs/filming.md). Cameras of drones even it out more or less.

The law is that of a simple lens, light by the cosine's fourth power, to a share that is learnt: grey levels fall by
(1 + tan^2)^-strength, since a grey level is about the 2.2th root of light and 2 / 2.2 would be all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, within_levels
from flightdepth.motion import Vector
from flightdepth.ranges.pairs import AnyFrame, Frame
from flightdepth.ranges.tracks import Corners, in_grey
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.lens import distort

# Corners are followed in pictures of even brightness: in pictures as they come they slip to where it is the same, and
# half of the effect is lost. A window of 33 px loses a tenth of it, one of 17 little; what is less leaves no contrast.
EVEN_PX, MIDDLE_GREY, DARK = 17, 110.0, 4.0
LEVEL_PX = 5  # a point's grey level is the mean of so many pixels either way
DARKEST, BRIGHTEST = 20.0, 235.0  # grey levels that tell something
FEWEST_POINTS = 30
# Logarithm of grey levels, .17 stops. Half a stop in each of 40 pairs passed for a strength of .09, since grey levels
# are not quite a power of light.
MOST_EXPOSED = 0.05
STEPS, LEAST_SCATTER = 3, 0.003  # of the weights; logarithm of a grey level
LEAST_STRENGTH, OVER_SIGMA = 0.06, 3.0  # what is taken out; a flight without any showed .015
MOST_STRENGTH = 1.0
EVERY, BACK, SURE = 5, 8, 0.01  # frames; frames; deviation that is good enough


class Vignetting:
    """Learns from pairs of pictures of an ideal pinhole; `strength` is 0 until it is sure of more."""

    def __init__(self, camera: Camera, shown: Flags | None = None) -> None:
        """`shown` [h, w], a quarter of the size, is False where no points are to be followed."""
        self._camera, self._shown = camera, shown
        self._weight = self._weighted = 0.0
        self._watched = count()
        self._gain: tuple[float, NDArray[np.float32]] | None = None

    @property
    def estimate(self) -> tuple[float, float]:
        """The strength that the pairs so far tell, and its deviation; infinite where none did."""
        if not self._weight:
            return 0.0, np.inf
        return self._weighted / self._weight, self._weight**-0.5

    @property
    def strength(self) -> float:
        """What is taken out of pictures."""
        told, sigma = self.estimate
        return min(told, MOST_STRENGTH) if told > max(LEAST_STRENGTH, OVER_SIGMA * sigma) else 0.0

    def watch(self, current: Frame, earlier: Sequence[AnyFrame]) -> None:
        """Learn from a frame and those before it, oldest first, of every few until enough is known."""
        watched = next(self._watched)  # not the frame's place: each picture may be shown five times
        if watched % EVERY or len(earlier) < BACK or self.estimate[1] < SURE:
            return
        self.learn(earlier[-BACK].image, current.image)

    def learn(self, previous: AnyImage, current: AnyImage) -> None:
        """Take in a pair, RGB [H, W, 3], 0 to 255, on the grid and as bright as the camera made them.

        Of a point at rest log(before / now) = strength (fall now - fall before) + the change of exposure, with fall =
        log(1 + tan^2): a line through what corners tell, with Cauchy's weights.
        """
        now, before = Corners(_even(current), self._camera, self._shown).rays(_even(previous))
        if len(now) < FEWEST_POINTS:
            return
        levels = self._levels(current, now), self._levels(previous, before)
        tells = np.logical_and.reduce([(level > DARKEST) & (level < BRIGHTEST) for level in levels])
        if tells.sum() < FEWEST_POINTS:
            return
        brighter = np.log(levels[1][tells] / levels[0][tells])
        outwards = _fall(now[tells]) - _fall(before[tells])
        strength = self.estimate[0]
        for _ in range(STEPS):
            left = brighter - strength * outwards
            left -= np.median(left)
            scatter = 1.4826 * np.median(np.abs(left)) + LEAST_SCATTER
            share = 1 / (1 + (left / scatter) ** 2)
            x, y = (
                outwards - np.average(outwards, weights=share),
                brighter - np.average(brighter, weights=share),
            )
            weight, weighted = (share * x * x).sum() / scatter**2, (share * x * y).sum() / scatter**2
            strength = (self._weighted + weighted) / (self._weight + weight + 1e-9)
        if abs(np.average(brighter - strength * outwards, weights=share)) > MOST_EXPOSED:
            return
        self._weight += weight
        self._weighted += weighted

    def evened(self, image: AnyImage) -> AnyImage:
        """A picture, RGB [H, W, 3], as bright in its corners as in its middle; itself until strength is known."""
        strength = self.strength
        if not strength:
            return image
        if self._gain is None or self._gain[0] != strength:
            x, y = self._camera.ray_axes()
            gain = (1 + x**2 + y**2) ** strength
            self._gain = strength, np.repeat(gain[..., None], 3, axis=2).astype(np.float32)
        return within_levels(np.asarray(cv2.multiply(image, self._gain[1], dtype=cv2.CV_32F), np.float32))

    def _levels(self, image: AnyImage, rays: Vector) -> NDArray[np.float64]:
        """Grey levels [N] where rays [N, 3] meet a picture."""
        grey = cv2.blur(in_grey(image), (LEVEL_PX, LEVEL_PX)).astype(np.float32)
        pixels = distort(rays[:, None, :2], self._camera).astype(np.float32)
        found = cv2.remap(grey, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR)
        return np.asarray(found[:, 0], dtype=np.float64)


def _fall(rays: Vector) -> Vector:
    """Logarithm by which grey levels of rays [N, 3] fall at a strength of 1."""
    return np.asarray(np.log1p((rays[:, :2] ** 2).sum(axis=1)))


def _even(image: AnyImage) -> AnyImage:
    """A picture in grey, each pixel over the mean around it."""
    grey = in_grey(image).astype(np.float32) + np.float32(DARK)
    return np.asarray(
        cv2.multiply(grey, 1 / cv2.blur(grey, (EVEN_PX, EVEN_PX)), scale=MIDDLE_GREY, dtype=cv2.CV_8U),
        dtype=np.uint8,
    )
