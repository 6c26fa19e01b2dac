"""Pictures of a camera that flies to the right over what can be matched."""

import cv2
import numpy as np

from flightdepth.camera import Camera

CAMERA = Camera.from_fov(192, 128, 90)
FRAME_NS = 100_000_000


def picture(number: int) -> np.ndarray:
    """Smooth noise that moves 3 px to the left with each frame."""
    noise = np.random.default_rng(4).integers(0, 256, (128, 240), dtype=np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0) * 3.0 - 256
    seen = smooth[:, 3 * number : 3 * number + 192].clip(0, 255).astype(np.uint8)
    return np.repeat(seen[..., None], 3, axis=2)
