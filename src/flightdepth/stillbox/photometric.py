"""What a real camera does to the pictures of a pair: exposure, colour, blur, noise, JPEG."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.levels import jpeg
from flightdepth.stillbox.pairs import Image, Pair

LARGEST_PX = 1024  # edge of the field that noise is cut from


class Photometric:
    """Random camera effects, the same on both images but for a small change of exposure and fresh noise.

    Ranges: exposure x0.6..1.6, gamma 0.75..1.35, each channel +-10 %, contrast with a lifted black up to 12 %,
    blur up to 1.1 px (a third of the pairs), noise up to 3 % (two thirds), JPEG quality 35..95 (a third).
    """

    def __init__(self) -> None:
        noise = np.random.default_rng(20170901).standard_normal((LARGEST_PX, LARGEST_PX))
        self._noise: NDArray[np.float32] = noise.astype(np.float32)

    def __call__(self, rng: np.random.Generator, pair: Pair) -> Pair:
        """Draw one set of effects and apply it to both images."""
        exposure, gamma = rng.uniform(-0.7, 0.7), rng.uniform(0.75, 1.35)
        tint, lift = rng.uniform(0.9, 1.1, 3), rng.uniform(0, 0.12)
        sigma_px = rng.uniform(0.3, 1.1) if rng.random() < 1 / 3 else 0.0
        noise = rng.uniform(0.3, 7.5) if rng.random() < 2 / 3 else 0.0
        quality = int(rng.integers(35, 96)) if rng.random() < 1 / 3 else 0
        images = []
        for image in (pair.previous, pair.current):
            stops = exposure + rng.uniform(-0.08, 0.08)
            seen = np.asarray(cv2.LUT(image, _tone_curve(tint * 2.0**stops, gamma, lift)), np.uint8)
            seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), sigma_px), np.uint8) if sigma_px else seen
            seen = self._with_noise(rng, seen, noise) if noise else seen
            images.append(through_jpeg(seen, quality) if quality else seen)
        return replace(pair, previous=images[0], current=images[1])

    def _with_noise(self, rng: np.random.Generator, image: Image, sigma: float) -> Image:
        """Noise of its own for each channel, from random windows of one field."""
        height, width = image.shape[:2]
        out = image.astype(np.float32)
        for channel in range(3):
            y, x = rng.integers(0, LARGEST_PX - np.array([height, width]) + 1)
            out[..., channel] += sigma * self._noise[y : y + height, x : x + width]
        return np.clip(np.rint(out), 0, 255).astype(np.uint8)


def _tone_curve(gain: NDArray[np.float64], gamma: float, lift: float) -> Image:
    """Look-up table uint8 [256, 1, 3]."""
    x = np.arange(256)[:, None] / 255
    curve = lift + (1 - lift) * np.clip(x * gain, 0, 1) ** gamma
    return np.rint(curve * 255).astype(np.uint8)[:, None, :]


def through_jpeg(image: Image, quality: int) -> Image:
    """The picture, uint8 RGB, as a JPEG of that quality (0..100) shows it."""
    data = np.frombuffer(jpeg(image, quality), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR_RGB), dtype=np.uint8)
