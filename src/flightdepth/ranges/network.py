"""What the estimator asks of a network; `flightdepth.runtimes` provides it, the tests an oracle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage
from flightdepth.motion import Vector
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


class FrameGrid(Protocol):
    """How one source camera is brought to the network's focal length and size, and back."""

    @property
    def camera(self) -> Camera:
        """Ideal pinhole of the prepared images: focal length of the card, sides multiples of 64 px."""

    @property
    def valid(self) -> NDArray[np.bool_]:
        """[h, w] at the output size: the pixel shows the scene, not padding, not what is masked."""

    def masked(self, shown: NDArray[np.bool_], /) -> FrameGrid:
        """The same of a source whose pixels show the scene only where `shown` [H, W]; maps are NaN elsewhere."""

    def image(self, image: AnyImage, /) -> AnyImage:
        """Source image [H, W, 3] RGB to the prepared one: undistorted, scaled, padded; float32 unless the same."""

    def to_source(self, map_hw: Map, /, interpolation: Literal["bilinear", "nearest"] = "bilinear") -> Map:
        """Map [h, w] float32 at the output size, at the source's pixels [H, W]; NaN where NaN is nearest.

        The caller owns the result.
        """

    def along_edges(self, depth_m: Map, image: AnyImage, /) -> AtSource:
        """Depth [h, w] and what belongs to it at the source's pixels, with edges where the prepared image has them."""


class DepthNetwork(Protocol):
    """A network that takes n pairs sharing their current frame."""

    @property
    def card(self) -> NetworkCard:
        """How it was trained: alpha and the ends of its range."""

    def grid(self, camera: Camera, /) -> FrameGrid:
        """The grid for one source camera."""

    def predict(
        self, previous_n: Sequence[AnyImage], current: AnyImage, displacements_n3: Vector, camera: Camera, /
    ) -> Prediction:
        """One batch of n pairs; displacements in metres [n, 3].

        Raises:
            OutOfMemory: the device has no room for so many.
        """


@runtime_checkable
class Movable(Protocol):
    """A network on a device of little memory."""

    def move_to_cpu(self) -> bool:
        """Go on where there is room for every batch; False where there is no such place."""
