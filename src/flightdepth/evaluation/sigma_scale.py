"""What a network's error bar must be multiplied by to keep its word; written on its card at export."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.fixed_set import fixed_set, outdoor_set
from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.evaluation.spread import growing_scale
from flightdepth.ranges.fusion import WORST_SIGMA, ends
from flightdepth.runtimes.error_bar import USUAL_FOCAL_PX, error_bar_scale, log_beta, sky_share
from flightdepth.runtimes.network import Network
from flightdepth.stillbox.testset import OutdoorTestSet, TestSet, test_textures
from flightdepth.weights.card import NetworkCard

Values = NDArray[np.float64]

SEED, TEXTURE_SEED = 1702_2018, 8  # neither training's nor those of the fixed test set
FITS = 4  # which pixels count depends on the scale a little


def calibration_set(
    card: NetworkCard, *, scenes: int, horizontal_fov_deg: float = 90.0, flight_size: bool = False
) -> TestSet:
    """Pairs like those of the fixed test set, of other rooms with other textures."""
    ours = fixed_set(
        card,
        scenes=scenes,
        textures=test_textures(TEXTURE_SEED),
        horizontal_fov_deg=horizontal_fov_deg,
        flight_size=flight_size,
    )
    return replace(ours, seed=SEED)


def outdoor_calibration_set(card: NetworkCard, *, scenes: int, flight_size: bool = False) -> OutdoorTestSet:
    """Pairs like those of the outdoor test set, of other flights."""
    return replace(outdoor_set(card, scenes=scenes, flight_size=flight_size), seed=SEED)


class SigmaScale(NamedTuple):
    """The card's fields of these names, in the order in which they are fitted."""

    sigma_scale: float
    sigma_growth: float
    sigma_far: float
    sigma_lens: float


def fitted_sigma_scale(network: Network, pairs: Iterable[TruePair]) -> SigmaScale:
    """The scale with which 68 % of the errors are inside sigma.

    That is where the motion is known; what an uncertain one adds comes on top (`ranges.motion_error`). Those pixels
    count that fusion would believe.
    """
    error_m, sigma_m, depth_m, *grown_by = _answers(network, pairs)
    by = np.stack(grown_by)  # sky, far and lens, [3, N]
    scale, growths = 1.0, np.zeros(len(by))
    for _ in range(FITS):
        counted = believed(network.card, depth_m, scale * np.exp(growths @ by) * sigma_m)
        error, sigma, by_counted = error_m[counted], sigma_m[counted], by[:, counted]
        for k in range(len(by)):
            growths[k] = 0.0
            scale, growths[k] = growing_scale(error, sigma * np.exp(growths @ by_counted), by_counted[k])
    return SigmaScale(scale, *growths.tolist())


def believed(card: NetworkCard, depth_m: Values, sigma_m: Values) -> NDArray[np.bool_]:
    """Which depths [N] at D0 fusion would take for measured: not a bound, as a sky is, nor too uncertain."""
    lower, upper = (end * card.depth_max_m for end in ends(card))
    return (lower < depth_m) & (depth_m < upper) & (sigma_m < WORST_SIGMA * depth_m)


def _answers(network: Network, pairs: Iterable[TruePair]) -> tuple[Values, ...]:
    """Error, sigma without the card's scale, depth, and what the scale grows by, of every pixel; metres at D0.

    It grows by the share of the picture that is sky, by that times the logarithm of the output over the usual one, and
    by the logarithm of the focal length over the usual one.
    """
    rows = []
    for pair in pairs:
        task = Task.of(pair, network.card)
        found = task.ask(network, pair)
        if found.sigma_m is None:
            raise ValueError(f"expected a network that tells sigma_m, got {network.card.name}")
        depth_m = found.depth_m[0]
        focal_px = task.card.focal_px
        sigma_m = found.sigma_m[0] / error_bar_scale(network.card, found.beta, found.valid, focal_px)[0]
        sky = np.full(depth_m.shape, sky_share(found.beta, found.valid)[0])
        lens = np.full(depth_m.shape, np.log(focal_px / USUAL_FOCAL_PX))
        error_m, far = np.abs(depth_m - task.truth_m), sky * log_beta(found.beta[0])
        rows.append(np.stack([error_m, sigma_m, depth_m, sky, far, lens]).reshape(6, -1))
    return tuple(np.concatenate(rows, axis=1).astype(np.float64))
