"""Test pairs from a stored set: a scene each, the frames in its middle that are about D0 apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.scenes.scene import Floats
from flightdepth.stillbox.stored import StoredSet, unclipped
from flightdepth.stillbox.testset import TestPair


@dataclass(frozen=True)
class StoredTestSet:
    """A pair of each scene of `stored`, its pictures cut to sides of multiples of `stride` around the middle, of odd
    sides half a pixel off it.

    D0_m      metres between the two frames, or as near to it as the scene's frames come
    held_out  whether the scenes are those that training on the set leaves out

    Raises:
        BadInput: a camera that turns, scenes of one frame, or pictures smaller than `stride`; a file that is missing
            or damaged, when its pair is read.
    """

    stored: StoredSet
    D0_m: float
    stride: int
    held_out: bool = False
    seed: None = None

    def __post_init__(self) -> None:
        stored = self.stored
        for what, fits, expected, got in (
            ("", not stored.turns, "a camera that does not turn", "orientations that differ"),
            ("", all(len(facts["imgs"]) > 1 for _, facts in stored.entries), "2 frames a scene", "1"),
            (
                ", pictures",
                min(stored.width, stored.height) >= self.stride,
                f"at least {self.stride} px",
                f"{stored.width}x{stored.height}",
            ),
        ):
            if not fits:
                raise BadInput(f"set {stored.folder}{what}", expected=expected, got=got)

    def __len__(self) -> int:
        return len(self.stored)

    def __iter__(self) -> Iterator[TestPair]:
        return (self.pair(number) for number in range(len(self)))

    def pair(self, number: int) -> TestPair:
        """The pair of scene `number`; depth at the layout's clip, or beyond it, is infinite."""
        scene = self.stored.scene(number)
        before, now = self._frames(scene.camera_position)
        depth_m = self._cut(scene.depth_m[now])
        return TestPair(
            self._cut(scene.images[before]),
            self._cut(scene.images[now]),
            unclipped(depth_m),
            scene.displacement(before, now),
            self.stored.camera.fx,
        )

    def _frames(self, position_m: Floats) -> tuple[int, int]:
        """Those in the middle whose distance is nearest to D0; a scene that moves on evenly has one such number."""
        count = len(position_m)
        pairs = [((count - apart) // 2, (count - apart) // 2 + apart) for apart in range(1, count)]
        gaps_m = [np.linalg.norm(position_m[now] - position_m[before]) for before, now in pairs]
        return pairs[int(np.argmin(np.abs(np.array(gaps_m) - self.D0_m)))]

    def _cut(self, values: NDArray[Any]) -> NDArray[Any]:
        height, width = (side // self.stride * self.stride for side in values.shape[:2])
        y, x = (values.shape[0] - height) // 2, (values.shape[1] - width) // 2
        return np.ascontiguousarray(values[y : y + height, x : x + width])
