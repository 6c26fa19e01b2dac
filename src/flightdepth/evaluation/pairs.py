"""What an evaluation needs to know of a test set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.metrics import pooled
from flightdepth.levels import Image
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.contract import STRIDE
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

LEAST_M = np.float32(1e-3)
SAME_FOCAL = 0.01  # by which share a network for one lens bears another focal length


def refuse_namesakes(what: str, networks: Sequence[Network]) -> None:
    """Networks that stand side by side are told apart by name alone.

    Raises:
        BadInput: two have the same; `what` was to name them.
    """
    names = [network.card.name for network in networks]
    if len(set(names)) < len(names):
        raise BadInput(what, expected="networks of different names", got=", ".join(names))


class TruePair(Protocol):
    """Two pictures with the truth, as `stillbox.testset.TestPair` is."""

    @property
    def previous(self) -> Image:
        """Uint8 RGB [H, W, 3]."""

    @property
    def current(self) -> Image:
        """Uint8 RGB [H, W, 3]."""

    @property
    def depth_m(self) -> Maps:
        """Depth of `current` in metres, float32 [H, W], NaN = unknown; clipped or not."""

    @property
    def displacement(self) -> NDArray[np.float64]:
        """Metres (3,), in the camera's frame."""

    @property
    def focal_px(self) -> float:
        """Focal length; the principal point is the middle, or half a pixel off it."""


@dataclass(frozen=True)
class Task:
    """What one network has to answer for one pair.

    truth_m  [h, w] metres at D0: depth * D0 / |displacement|, clipped to the card's range, then averaged over
             4x4 px (paper, III.B); for a nominal pair the depth itself
    sampled_m  the same, one pixel of each 4x4 instead of their mean
    apart    [h, w] the farthest of each 4x4 over the nearest
    nominal  the displacement shortened or lengthened to D0, metres (3,)
    card     the network's at the pair's focal length
    """

    camera: Camera
    truth_m: Maps
    sampled_m: Maps
    apart: Maps
    nominal: NDArray[np.float64]
    card: NetworkCard

    @classmethod
    def of(cls, pair: TruePair, card: NetworkCard) -> Task:
        """The task of a pair that was drawn at a focal length that the network knows; anything else is refused."""
        height, width = pair.depth_m.shape
        card = card.at_focal(pair.focal_px)
        if abs(pair.focal_px / card.focal_px - 1) > SAME_FOCAL or height % STRIDE or width % STRIDE:
            raise BadInput(
                "test set",
                expected=f"focal length {card.focal_px:g} px and sides of {STRIDE} px multiples for {card.name}",
                got=f"{pair.focal_px:g} px, {width}x{height}",
            )
        length_m = float(np.linalg.norm(pair.displacement))
        if not length_m > 0:
            raise BadInput("test pair", expected="a displacement", got=str(pair.displacement))
        scale = length_m / card.D0_m
        at_D0 = (pair.depth_m / np.float32(scale)).clip(card.depth_min_m, card.depth_max_m)
        camera = Camera(width, height, pair.focal_px, pair.focal_px, (width - 1) / 2, (height - 1) / 2)
        nominal = np.asarray(pair.displacement, dtype=np.float64) / scale
        truth_m, sampled_m = pooled(at_D0, (height // 4, width // 4)), at_D0[2::4, 2::4].copy()
        blocks = at_D0.reshape(height // 4, 4, width // 4, 4)
        apart = blocks.max(axis=(1, 3)) / np.maximum(blocks.min(axis=(1, 3)), LEAST_M)
        return cls(camera, truth_m, sampled_m, apart, nominal, card)

    def ask(
        self,
        network: Network,
        pair: TruePair,
        *,
        previous: Image | None = None,
        nominal: NDArray[np.float64] | None = None,
    ) -> Prediction:
        """What the network says of the pair, or of a wrong one, at the pair's own focal length."""
        before = pair.previous if previous is None else previous
        moved = self.nominal if nominal is None else nominal
        return network.at_focal(self.card.focal_px).predict([before], pair.current, moved[None], self.camera)
