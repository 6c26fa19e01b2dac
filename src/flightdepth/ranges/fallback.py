"""A second network for frames that the first can't see: it takes the same pictures and answers on the same grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage
from flightdepth.motion import Vector
from flightdepth.ranges.network import DepthNetwork, Map, Movable
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.prediction import Prediction


class OnGridOf:
    """A network that is given pictures prepared for another, and whose maps have the size of the other's.

    Where its own focal length differs, it scales the pictures to that once more.
    """

    def __init__(self, network: DepthNetwork) -> None:
        self._network = network
        self.card = network.card

    def grid(self, camera: Camera, /) -> NetworkGrid:
        """Its own."""
        return self._network.grid(camera)

    def predict(
        self,
        previous_n: Sequence[AnyImage],
        current: AnyImage,
        displacements_n3: Vector,
        camera: Camera,
        valid: Flags | None = None,
        /,
    ) -> Prediction:
        """As the network's own, [n, h, w] with a quarter of the sides of `camera`.

        On another grid `valid` is not passed on: it matters to error bars, which a network without directions has not.
        """
        grid = self._network.grid(camera)
        if grid.camera == camera:  # the same size is not enough: its pixels may be of another focal length
            return self._network.predict(previous_n, current, displacements_n3, camera, valid)
        found = self._network.predict(previous_n, current, displacements_n3, camera)

        def resized(maps: Map) -> Map:
            """Of each 4x4 of the picture's pixels one in the middle."""
            return np.stack([grid.to_source(one, "nearest")[2::4, 2::4] for one in maps])

        beta = resized(found.beta)
        sigma_m = None if found.sigma_m is None else resized(found.sigma_m)
        valid = np.asarray(np.isfinite(beta).all(axis=0))
        return Prediction(beta, resized(found.depth_m), sigma_m, valid)

    def move_to_cpu(self) -> bool:
        """As the network's own; False where it has no such place."""
        return isinstance(self._network, Movable) and self._network.move_to_cpu()
