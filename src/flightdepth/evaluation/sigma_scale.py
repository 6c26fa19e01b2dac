"""What a network's error bar must be multiplied by to keep its word in flight; written on its card at export."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.fixed_set import fixed_set
from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.evaluation.spread import sigma_scale
from flightdepth.ranges.derotation import derotated
from flightdepth.ranges.fusion import WORST_SIGMA, ends
from flightdepth.runtimes.network import Network
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox.testset import SCENES, TEXTURES, TestSet
from flightdepth.weights.card import NetworkCard

Values = NDArray[np.float64]

SEED, TEXTURE_SEED = 1702_2018, 8  # neither training's nor those of the fixed test set
NOISE_RAD = 0.001  # of each frame's orientation, as in the multi-range study: what a gimbal leaves
FITS = 4  # which pixels count depends on the scale a little


def calibration_sets(card: NetworkCard, *, scenes: int = SCENES) -> tuple[TestSet, TestSet]:
    """Pairs like those of the fixed test set, of other rooms with other textures: half of them turn a little."""
    textures = Textures.procedural(TEXTURES, TEXTURE_SEED)
    half = fixed_set(card, scenes=(scenes + 1) // 2, textures=textures)
    turning = StillBoxConfig(orientation_noise_rad=NOISE_RAD)
    return replace(half, seed=SEED, config=turning), replace(half, seed=SEED + 1)


def fitted_sigma_scale(network: Network, pairs: Iterable[TruePair]) -> float:
    """The scale with which 68 % of the errors are inside sigma, on flights that turn a little and on some that don't.

    Pairs are derotated first, and those pixels count that fusion would believe: inside the network's range and
    with a sigma below WORST_SIGMA of the depth. The card's own scale is part of what is multiplied.
    """
    error_m, sigma_m, depth_m = _answers(network, pairs)
    lower, upper = (end * network.card.depth_max_m for end in ends(network.card))
    measured, scale = (lower < depth_m) & (depth_m < upper), 1.0
    for _ in range(FITS):
        believed = measured & (scale * sigma_m < WORST_SIGMA * depth_m)
        scale = sigma_scale(error_m[believed], sigma_m[believed])
    return scale * network.card.sigma_scale


def _answers(network: Network, pairs: Iterable[TruePair]) -> tuple[Values, Values, Values]:
    """Error, sigma and depth of every pixel, metres at D0, [N] each."""
    rows = []
    for pair in pairs:
        task = Task.of(pair, network.card)
        previous, nominal = derotated(pair.previous, pair.current, task.nominal, task.camera)
        found = task.ask(network, pair, previous=previous, nominal=nominal)
        if found.sigma_m is None:
            raise ValueError(f"expected a network that tells sigma_m, got {network.card.name}")
        depth_m = found.depth_m[0]
        rows.append(np.stack([np.abs(depth_m - task.truth_m), found.sigma_m[0], depth_m]).reshape(3, -1))
    error_m, sigma_m, depth_m = np.concatenate(rows, axis=1).astype(np.float64)
    return error_m, sigma_m, depth_m
