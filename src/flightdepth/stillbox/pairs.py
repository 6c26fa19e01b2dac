"""Two frames of a scene become one training pair: shift, target, flips and quarter turns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes.scene import Floats

Image = NDArray[np.uint8]
Depth = NDArray[np.float32]
Array = TypeVar("Array", Image, Depth)

QUARTER_TURNS = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}


class Flown(Protocol):
    """What a pair needs of a scene, drawn or stored."""

    @property
    def frames(self) -> int:
        """Number of camera positions."""

    @property
    def is_open(self) -> bool:
        """Whether it lies under a sky."""

    def displacement(self, previous: int, current: int) -> Floats:
        """Position at `current` minus that at `previous`, metres, in `current`'s orientation, shape (3,)."""


@dataclass(frozen=True)
class PairRule:
    """How pairs are drawn and what the network has to answer.

    nominal_shift   frames between the images of a pair whose target is the true depth: 3, Clamped 5
    depth_min_m, depth_max_m   the target is clipped to this range: 0..100, Clamped 10..60
    reference_focal_px         None: the target is metres. Else it is the depth that moves a pixel as far in a
                               picture of this focal length: depth * reference / focal
    backward, still            whether there are pairs with the later frame first, and pairs of one frame
    wide_share                 of the pairs are farther apart: the nominal shift up to a whole scene, so that much of
                               what stands near lies outside the earlier picture
    """

    nominal_shift: int = 3
    depth_min_m: float = 0.0
    depth_max_m: float = 100.0
    reference_focal_px: float | None = None
    backward: bool = True
    still: bool = True
    wide_share: float = 0.0

    def __post_init__(self) -> None:
        if self.nominal_shift < 1:
            raise BadInput("nominal shift", expected="1 frame or more", got=str(self.nominal_shift))
        if not 0 <= self.depth_min_m < self.depth_max_m:
            got = f"{self.depth_min_m:g} to {self.depth_max_m:g} m"
            raise BadInput("range of the target", expected="0 m or more, the nearest first", got=got)

    def draw_frames(self, rng: np.random.Generator, frames: int) -> tuple[int, int]:
        """Numbers of (previous, current), either order: |shift| = round(2 * nominal * u), at most frames - 1.

        Of a wide pair |shift| is any from the nominal one to frames - 1.
        """
        if self.wide_share and rng.random() < self.wide_share:
            shift = int(rng.integers(min(self.nominal_shift, frames - 1), frames))
        else:
            shift = min(round(2 * self.nominal_shift * rng.random()), frames - 1)
            shift = shift if self.still else max(shift, 1)
        first = int(rng.integers(frames - shift))
        second = first + shift
        return (first, second) if rng.random() < 0.5 or not self.backward else (second, first)

    def target_m(self, depth_m: Depth, shift: int, focal_px: float) -> Depth:
        """Depth that gives the same picture pair at the nominal shift: depth * nominal / |shift|, clipped.

        Without a shift nothing moves, as if all were infinitely far: the largest depth everywhere (paper, III.B).
        """
        if shift == 0:
            return np.full_like(depth_m, self.depth_max_m)
        lens = 1.0 if self.reference_focal_px is None else self.reference_focal_px / focal_px
        scaled = depth_m * np.float32(self.nominal_shift / abs(shift) * lens)
        return np.asarray(np.clip(scaled, self.depth_min_m, self.depth_max_m))


@dataclass(frozen=True)
class Pair:
    """previous, current uint8 [H, W, 3], seen by `camera`; target_m float32 [H, W] for current; displacement [3]."""

    previous: Image
    current: Image
    target_m: Depth
    displacement: Floats
    camera: Camera


@dataclass(frozen=True)
class Batch:
    """Pairs of one size, B of them; what is made of all is made when it is asked for."""

    each: tuple[Pair, ...]

    @property
    def pairs(self) -> Image:
        """(previous, current) of each, uint8 [B, H, W, 6]."""
        both = np.empty((len(self.each), *self.each[0].target_m.shape, 6), np.uint8)
        for out, pair in zip(both, self.each, strict=True):
            cv2.merge([pair.previous, pair.current], out)  # many times as fast as numpy's concatenate
        return both

    @property
    def target_m(self) -> Depth:
        """For each current picture, float32 [B, H, W]."""
        return np.stack([pair.target_m for pair in self.each])


def make_pair(
    scene: Flown, rendered: Rendered, camera: Camera, rule: PairRule, frames: tuple[int, int]
) -> Pair:
    """The pair of two frames (previous, current), with the displacement between them."""
    previous, current = frames
    return Pair(
        rendered.images[previous],
        rendered.images[current],
        rule.target_m(rendered.depth_m[current], current - previous, camera.fx),
        scene.displacement(previous, current),
        camera,
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

    camera = pair.camera
    camera = replace(camera, cx=camera.width - 1 - camera.cx) if mirror else camera
    moved = np.array([x, y, z])
    return Pair(
        seen(pair.previous), seen(pair.current), seen(pair.target_m), moved, camera.turned(quarter_turns)
    )
