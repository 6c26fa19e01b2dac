"""What a flight's telemetry gets wrong: the direction of motion, and a small rotation that no one reported."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.scenes import chance
from flightdepth.scenes.scene import Floats
from flightdepth.stillbox.pairs import Image, Pair


@dataclass(frozen=True)
class MotionNoise:
    """Largest errors in degrees. Each pair's error is the largest times u^3, u uniform: most pairs are nearly right.

    The length of the displacement stays right: depth is proportional to it, whatever a network does.
    """

    direction_deg: float
    rotation_deg: float

    def __call__(self, rng: np.random.Generator, pair: Pair) -> Pair:
        """The pair as a flight would report it: `displacement` off, `previous` turned."""
        towards, about = chance.unit_vector(rng), chance.unit_vector(rng)
        direction_deg, rotation_deg = np.array([self.direction_deg, self.rotation_deg]) * rng.random(2) ** 3
        return replace(
            pair,
            displacement=tilted(pair.displacement, towards, float(direction_deg)),
            previous=rotated(pair.previous, pair.camera, about * np.radians(rotation_deg)),
        )


def tilted(vector: Floats, towards: Floats, angle_deg: float) -> Floats:
    """`vector` (3,) turned by an angle towards another one; as it is where the two are parallel."""
    across = towards - vector * (towards @ vector) / max(float(vector @ vector), 1e-30)
    length = float(np.linalg.norm(across))
    if length < 1e-9:
        return vector
    angle = np.radians(angle_deg)
    return np.asarray(vector * np.cos(angle) + across * (np.linalg.norm(vector) / length * np.sin(angle)))


def rotated(image: Image, camera: Camera, rotation_vector: Floats) -> Image:
    """The picture as the same camera turned by a rotation vector (3,), radians, would have seen it."""
    if not np.any(rotation_vector):
        return image
    turn = cv2.Rodrigues(np.asarray(rotation_vector, dtype=np.float64))[0]
    # A pixel of the turned camera looks where `turn` takes its ray.
    seen_from_new = camera.matrix @ turn @ np.linalg.inv(camera.matrix)
    size, how = (camera.width, camera.height), cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(image, seen_from_new, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(warped, dtype=np.uint8)
