"""What the estimator asks of a network; `flightdepth.runtimes` provides it, the tests an oracle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage
from flightdepth.motion import Vector
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

Map = NDArray[np.float32]


class AtSource(Protocol):
    """Maps [h, w] of the output size at the source's pixels [H, W]. The caller owns the results."""

    @property
    def depth_m(self) -> Map:
        """Depth in metres, NaN = unknown."""

    def __call__(self, map_hw: Map, /) -> Map:
        """Another map of the same pixels, NaN where depth is."""

    def marks(self, map_hw: Map, /) -> Map:
        """One that is not to be interpolated, NaN where NaN."""


class DepthNetwork(Protocol):
    """A network that takes n pairs sharing their current frame."""

    @property
    def card(self) -> NetworkCard:
        """How it was trained: alpha and the ends of its range."""

    def grid(self, camera: Camera, /) -> NetworkGrid:
        """The grid for one source camera."""

    def predict(
        self,
        previous_n: Sequence[AnyImage],
        current: AnyImage,
        displacements_n3: Vector,
        camera: Camera,
        valid: Flags | None = None,
        /,
    ) -> Prediction:
        """One batch of n pairs; displacements in metres [n, 3]; `valid` [h, w]: which outputs count, None: the grid's.

        Raises:
            OutOfMemory: the device has no room for so many.
        """


@runtime_checkable
class Movable(Protocol):
    """A network on a device of little memory."""

    def move_to_cpu(self) -> bool:
        """Go on where there is room for every batch; False where there is no such place."""
