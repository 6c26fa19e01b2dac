"""Things that move by themselves, put into pairs of pictures: is an error bar large on them?

A thing is a rounded shape in a texture, facing the camera at a depth of its own. Between the pictures it moves by some
pixels beside what the camera's motion makes of it. As far as that is along its line (the one on which a point at rest
would move) it looks like a thing at rest, nearer or farther away, and no pair of pictures tells the two apart; as far
as it leaves its line, flow shows it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.levels import Image
from flightdepth.scenes.textures import EDGE, Textures
from flightdepth.stillbox.pairs import Pair

Mask = NDArray[np.float32]

SIZE = (0.1, 0.35)  # of the picture's smaller side
ASPECT = (0.5, 2.0)
SHAPES = (2.0, 6.0)  # exponents: an ellipse, a box with rounded corners
NEARER = (0.4, 1.0)  # its depth, of what is behind it
FARTHEST_M = 200.0  # behind it: a sky counts as that
OWN_PX = (1.0, 24.0)  # its own motion, where the picture is as wide as WIDTH_PX; small ones are more frequent
WIDTH_PX = 256
MOST_NEARED = 3.0  # times as large as in the earlier picture, or as small
SOFTNESS_PX = 0.6


@dataclass(frozen=True)
class MovingThing:
    """A pair with a thing that moves by itself.

    inside     where the current picture shows it, bool [H, W]; the pair's depth there is its own
    off_px     by how many pixels it left its line
    """

    pair: Pair
    inside: NDArray[np.bool_]
    off_px: float


def with_moving_thing(pair: Pair, textures: Textures, rng: np.random.Generator) -> MovingThing | None:
    """The pair with one more thing in both pictures; None where it would lie at the camera, or nowhere."""
    camera, (height, width) = pair.camera, pair.target_m.shape
    middle = rng.uniform(0.1, 0.9, 2) * (width, height)
    shape = _shape(rng, middle, width, height)
    inside = shape > 0.5
    if not inside.any():
        return None
    behind_m = float(np.median(pair.target_m[inside].clip(max=FARTHEST_M)))
    depth_m = behind_m * rng.uniform(*NEARER)
    ray = (middle - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    dx, dy, dz = pair.displacement
    before_m = depth_m + dz
    if not depth_m / MOST_NEARED < before_m < depth_m * MOST_NEARED:
        return None
    at_rest = (ray * depth_m + (dx, dy)) / before_m * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    angle, own_px = rng.uniform(0, 2 * np.pi), np.exp(rng.uniform(*np.log(OWN_PX))) * width / WIDTH_PX
    own = own_px * np.array([np.cos(angle), np.sin(angle)])
    field = np.array([dx, dy]) - ray * dz
    across = np.array([-field[1], field[0]]) / max(float(np.hypot(*field)), 1e-9)
    look = _look(textures, rng, middle, width, height)
    scale = depth_m / before_m
    where = at_rest + own - scale * middle
    to_before = np.array([[scale, 0, where[0]], [0, scale, where[1]]])
    seen_before = cv2.warpAffine(look, to_before, (width, height), borderMode=cv2.BORDER_REFLECT)
    shape_before = cv2.warpAffine(shape, to_before, (width, height))
    return MovingThing(
        replace(
            pair,
            previous=_over(pair.previous, np.asarray(seen_before, np.uint8), np.asarray(shape_before)),
            current=_over(pair.current, look, shape),
            target_m=np.where(inside, np.float32(depth_m), pair.target_m),
        ),
        inside,
        float(abs(own @ across)),
    )


def _shape(rng: np.random.Generator, middle: NDArray[np.float64], width: int, height: int) -> Mask:
    """How much of each pixel a thing covers, [H, W]."""
    size = rng.uniform(*SIZE) * min(width, height) / 2
    half = size * np.exp(rng.uniform(*np.log(ASPECT)) / 2 * np.array([1, -1]))
    angle, power = rng.uniform(0, np.pi), rng.choice(SHAPES)
    rows, columns = np.indices((height, width))
    x, y = columns - middle[0], rows - middle[1]
    along = np.abs(x * np.cos(angle) + y * np.sin(angle)) / half[0]
    across = np.abs(y * np.cos(angle) - x * np.sin(angle)) / half[1]
    covered = (along**power + across**power < 1).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(covered, (0, 0), SOFTNESS_PX), np.float32)


def _look(
    textures: Textures, rng: np.random.Generator, middle: NDArray[np.float64], width: int, height: int
) -> Image:
    """A texture, as large as the picture's smaller side or half of that, its middle at `middle`: [H, W, 3]."""
    texture = textures.texels[rng.integers(len(textures)), : EDGE * EDGE].reshape(EDGE, EDGE, 3)
    edge = round(rng.uniform(0.5, 1.0) * min(width, height))
    small = cv2.resize(texture, (edge, edge), interpolation=cv2.INTER_AREA)
    place = np.array([[1, 0, middle[0] - edge / 2], [0, 1, middle[1] - edge / 2]])
    return np.asarray(cv2.warpAffine(small, place, (width, height), borderMode=cv2.BORDER_REFLECT), np.uint8)


def _over(picture: Image, look: Image, shape: Mask) -> Image:
    share = shape[..., None]
    return np.rint(picture * (1 - share) + look * share).astype(np.uint8)
