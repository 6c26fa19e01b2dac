"""What gives depth from one pair of a flight, networks and the classical peer alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.metrics import pooled
from flightdepth.evaluation.peer import BLIND_PX, ClassicalPeer
from flightdepth.evaluation.warping import NEAREST_M
from flightdepth.levels import Image
from flightdepth.motion import Vector
from flightdepth.ranges.fusion import BETA_MAX, WORST_SIGMA, ends
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.network import Network
from flightdepth.sweep import FIELD_SCALE, motion_field
from flightdepth.weights.card import NetworkCard

PEER = "classical peer"


@dataclass(frozen=True, eq=False)
class Answer:
    """Depth of a frame in metres and where it is a measurement, not an end of the range.

    float32 and bool [h, w], a quarter of the pictures' size.
    """

    depth_m: Maps
    measured: Flags


class Method(Protocol):
    """What gives depth from a pair on the network's grid."""

    @property
    def name(self) -> str:
        """Unique among the methods of a study."""

    def answer(self, previous: Image, current: Image, displacement: Vector, camera: Camera) -> Answer:
        """Depth of `current`; displacement (3,), metres, in its orientation."""


@dataclass(frozen=True)
class NetworkMethod:
    """A network, one pair at a time."""

    network: Network

    @property
    def name(self) -> str:
        """As on its card."""
        return self.network.card.name

    def answer(self, previous: Image, current: Image, displacement: Vector, camera: Camera) -> Answer:
        """See `Method`. What is a measurement is told as in the fusion of ranges: by range and by error bar."""
        found = self.network.predict([previous], current, displacement[None], camera)
        beta, (lower, upper) = found.beta[0], ends(self.network.card)
        measured = (beta > lower) & (beta < upper)
        if found.sigma_m is not None:
            measured &= found.sigma_m[0] < WORST_SIGMA * found.depth_m[0]
        return Answer(found.depth_m[0], measured)


@dataclass(frozen=True)
class PeerMethod:
    """Optical flow and triangulation, clipped to the widest range of the networks that it stands beside."""

    cards: tuple[NetworkCard, ...]
    name = PEER

    def answer(self, previous: Image, current: Image, displacement: Vector, camera: Camera) -> Answer:
        """See `Method`. Means of inverse depth over 4x4 pixels; what could not have moved is not measured."""
        length_m = float(np.linalg.norm(displacement))
        cards = [card.at_focal(camera.fx) for card in self.cards]
        least_m = length_m * min(card.alpha * card.beta_min for card in cards)
        most_m = length_m * max(card.alpha for card in cards)
        depth_m = ClassicalPeer(least_m, most_m).depth(previous, current, displacement, camera)
        shape = (camera.height // FIELD_SCALE, camera.width // FIELD_SCALE)
        inverse = pooled((1 / np.maximum(depth_m, np.float32(NEAREST_M))).astype(np.float32), shape)
        depth_m = (1 / inverse).astype(np.float32)
        reach = np.hypot(*motion_field(displacement, camera)) * camera.fx
        inside = (depth_m > least_m) & (depth_m < BETA_MAX * most_m)
        return Answer(depth_m, inside & (reach >= BLIND_PX * most_m / 10))
