"""Two frames of a scene become one training pair: shift, target, flips and quarter turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes.scene import Floats, Scene

Image = NDArray[np.uint8]
Depth = NDArray[np.float32]
Array = TypeVar("Array", Image, Depth)

QUARTER_TURNS = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}


@dataclass(frozen=True)
class PairRule:
    """How pairs are drawn and what the network has to answer.

    nominal_shift   frames between the images of a pair whose target is the true depth: 3, Clamped 5
    depth_min_m, depth_max_m   the target is clipped to this range: 0..100, Clamped 10..60
    """

    nominal_shift: int = 3
    depth_min_m: float = 0.0
    depth_max_m: float = 100.0

    def draw_frames(self, rng: np.random.Generator, frames: int) -> tuple[int, int]:
        """Numbers of (previous, current): |shift| = round(2 * nominal * u) at most frames - 1, either order."""
        shift = min(round(2 * self.nominal_shift * rng.random()), frames - 1)
        first = int(rng.integers(frames - shift))
        second = first + shift
        return (first, second) if rng.random() < 0.5 else (second, first)

    def target_m(self, depth_m: Depth, shift: int) -> Depth:
        """Depth that gives the same picture pair at the nominal shift: depth * nominal / |shift|, clipped.

        Without a shift nothing moves, as if all were infinitely far: the largest depth everywhere (paper, III.B).
        """
        if shift == 0:
            return np.full_like(depth_m, self.depth_max_m)
        scaled = depth_m * np.float32(self.nominal_shift / abs(shift))
        return np.asarray(np.clip(scaled, self.depth_min_m, self.depth_max_m))


@dataclass(frozen=True)
class Pair:
    """previous, current uint8 [H, W, 3]; target_m float32 [H, W] for current; displacement [3] metres."""

    previous: Image
    current: Image
    target_m: Depth
    displacement: Floats


@dataclass(frozen=True)
class Batch:
    """pairs uint8 [B, H, W, 6] (previous, current); target_m float32 [B, H, W]; displacement [B, 3] metres."""

    pairs: Image
    target_m: Depth
    displacement: Floats

    @classmethod
    def of(cls, pairs: list[Pair]) -> Batch:
        """Stack pairs of one size."""
        both = np.empty((len(pairs), *pairs[0].target_m.shape, 6), np.uint8)
        for out, pair in zip(both, pairs, strict=True):
            cv2.merge([pair.previous, pair.current], out)  # many times as fast as numpy's concatenate
        return cls(
            both,
            np.stack([p.target_m for p in pairs]),
            np.stack([p.displacement for p in pairs]),
        )


def make_pair(scene: Scene, rendered: Rendered, rule: PairRule, previous: int, current: int) -> Pair:
    """The pair of two frames; displacement = position at current - at previous, in current's axes."""
    moved = scene.camera_position[current] - scene.camera_position[previous]
    return Pair(
        rendered.images[previous],
        rendered.images[current],
        rule.target_m(rendered.depth_m[current], current - previous),
        np.asarray(moved @ scene.world_from_camera[current]),
    )


def turned(pair: Pair, *, quarter_turns: int, mirror: bool) -> Pair:
    """The pair seen in a mirror (left-right), then turned counter-clockwise; the displacement goes along.

    One quarter turn takes the image's x axis to its -y axis: (x, y) -> (y, -x).
    """
    x, y, z = pair.displacement
    x = -x if mirror else x
    for _ in range(quarter_turns % 4):
        x, y = y, -x

    def seen(array: Array) -> Array:
        # OpenCV turns pictures many times as fast as numpy does.
        mirrored = cv2.flip(array, 1) if mirror else array
        turn = QUARTER_TURNS.get(quarter_turns % 4)
        return np.asarray(mirrored if turn is None else cv2.rotate(mirrored, turn), dtype=array.dtype)

    return Pair(seen(pair.previous), seen(pair.current), seen(pair.target_m), np.array([x, y, z]))
