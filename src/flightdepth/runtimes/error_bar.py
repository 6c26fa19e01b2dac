"""What a network's error bar is multiplied by so that it keeps its word, in rooms, in the open, through any lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.weights.card import NetworkCard

# Sky is beyond this. Far walls of a room may be beyond what fusion takes for a bound, through a wide lens or after a
# short displacement, but there errors are no larger than a network thinks.
SKY_BETA = 0.9
# Focal length of which `sigma_lens` is a power's base: a flight's through a usual lens, as `motion` sees it.
USUAL_FOCAL_PX = 256.0
# Output of which `sigma_far` is a power's base, and the least that counts: what is nearer may be as near as it likes.
USUAL_BETA, LEAST_BETA = 0.1, 0.01


def error_bar_scale(card: NetworkCard, beta: Maps, valid: Flags, focal_px: float) -> Maps:
    """The scale of each pixel of n pairs, float32 [n, h, w].

    It is larger the finer a picture is seen and the more of it is sky, most of all for what moved little: in the open
    that may be anywhere, in a room the walls are near.

    beta      [n, h, w], output as a share of the largest depth
    valid     bool [h, w], the pixels that count
    focal_px  of the pictures that the network saw
    """
    sky = sky_share(beta, valid).astype(np.float32)[:, None, None]
    scale = np.float32(card.sigma_scale * (focal_px / USUAL_FOCAL_PX) ** card.sigma_lens)
    by_sky = np.float32(card.sigma_growth) + np.float32(card.sigma_far) * log_beta(beta)
    return np.asarray(scale * np.exp(sky * by_sky), np.float32)


def log_beta(beta: Maps) -> Maps:
    """The logarithm of an output over USUAL_BETA, any shape."""
    return np.asarray(np.log(np.maximum(beta, np.float32(LEAST_BETA)) / np.float32(USUAL_BETA)), np.float32)


def sky_share(beta: Maps, valid: Flags) -> NDArray[np.float64]:
    """Which share of the picture is sky, or as far, by each of n pairs, [n]."""
    return np.asarray((beta[:, valid] >= SKY_BETA).mean(axis=1))
