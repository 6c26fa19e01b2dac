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


def error_bar_scale(card: NetworkCard, beta: Maps, valid: Flags, focal_px: float) -> Maps:
    """The scale of each of n pairs, float32 [n, 1, 1]: larger the more of a picture is sky, and the finer it is seen.

    beta      [n, h, w], output as a share of the largest depth
    valid     bool [h, w], the pixels that count
    focal_px  of the pictures that the network saw
    """
    scale = card.sigma_scale * (focal_px / USUAL_FOCAL_PX) ** card.sigma_lens
    sky = sky_share(beta, valid)
    return np.asarray(scale * np.exp(card.sigma_growth * sky), np.float32)[:, None, None]


def sky_share(beta: Maps, valid: Flags) -> NDArray[np.float64]:
    """Which share of the picture is sky, or as far, by each of n pairs, [n]."""
    return np.asarray((beta[:, valid] >= SKY_BETA).mean(axis=1))
