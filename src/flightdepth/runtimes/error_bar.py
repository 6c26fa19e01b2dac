"""What a network's error bar is multiplied by so that it keeps its word, in rooms and in the open."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.weights.card import NetworkCard

# Sky is beyond this. Far walls of a room may be beyond what fusion takes for a bound, through a wide lens or after a
# short displacement, but there errors are no larger than a network thinks.
SKY_BETA = 0.9


def error_bar_scale(card: NetworkCard, beta: Maps, valid: Flags) -> Maps:
    """The scale of each of n pairs, float32 [n, 1, 1]; the more of a picture is sky, the larger errors are.

    beta   [n, h, w], output as a share of the largest depth
    valid  bool [h, w], the pixels that count
    """
    sky = sky_share(beta, valid)
    return np.asarray(card.sigma_scale * np.exp(card.sigma_growth * sky), np.float32)[:, None, None]


def sky_share(beta: Maps, valid: Flags) -> NDArray[np.float64]:
    """Which share of the picture is sky, or as far, by each of n pairs, [n]."""
    return np.asarray((beta[:, valid] >= SKY_BETA).mean(axis=1))
