"""How far a network's own error bar, `sigma_m`, can be trusted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.weights.card import INSIDE_ONE

Values = NDArray[np.float64]

GROWTHS = tuple(step / 20 for step in range(31))  # the least of those that fit as well
LEAST = 1e-9
LEFT_OUT = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # shares of a sparsification curve


def spread_summary(error_m: Values, sigma_m: Values) -> dict[str, Any]:
    """Figures of errors [N] >= 0 beside the deviations [N] that were foretold, both in metres.

    inside_one, inside_two   share of errors smaller than sigma, 2 sigma (a normal error: 0.683, 0.954)
    by_sigma                 mean error and share inside one sigma in ten equal groups of rising sigma
    sparsification           mean error of what is left when the pixels of largest sigma are left out, beside
                             the same by the true error (the best order there is), as shares of the mean error
                             (Ilg et al. 2018); `area` between the two curves: 0 is a perfect order
    """
    order = np.argsort(sigma_m, kind="stable")
    groups = np.array_split(order, 10)
    own, best = left_over(error_m, sigma_m), left_over(error_m, error_m)
    return {
        "inside_one": float((error_m < sigma_m).mean()),
        "inside_two": float((error_m < 2 * sigma_m).mean()),
        "by_sigma": [
            {
                "sigma_m": float(sigma_m[group].mean()),
                "l1_m": float(error_m[group].mean()),
                "inside_one": float((error_m[group] < sigma_m[group]).mean()),
            }
            for group in groups
        ],
        "sparsification": {"left_out": list(LEFT_OUT), "by_sigma": own, "by_error": best},
        "area": float(np.trapezoid(np.array(own) - np.array(best), LEFT_OUT)),
    }


def sigma_scale(error_m: Values, sigma_m: Values) -> float:
    """What deviations [N] must be multiplied by for INSIDE_ONE of the errors [N] to be inside; 1 where nothing tells.

    The quantile of error / sigma: one number for all pixels, which leaves their order as it is.
    """
    known = np.isfinite(error_m) & np.isfinite(sigma_m) & (sigma_m > 0)
    ratio = float(np.quantile(error_m[known] / sigma_m[known], INSIDE_ONE)) if known.any() else 1.0
    return ratio if ratio > 0 else 1.0


def growing_scale(error_m: Values, sigma_m: Values, by: Values) -> tuple[float, float]:
    """The same, scale * exp(growth * by), for pixels [N] of pictures of which something, `by` [N], is known.

    Linear quantile regression (Koenker and Bassett 1978) of log(error / sigma) on `by`, its slope one of GROWTHS.
    """

    def scale(growth: float) -> float:
        return sigma_scale(error_m, sigma_m * np.exp(growth * by))

    def loss(growth: float) -> float:
        foretold = scale(growth) * np.exp(growth * by) * sigma_m
        above = np.log(np.maximum(error_m, LEAST) / np.maximum(foretold, LEAST))
        return round(float(np.nanmean(np.maximum(INSIDE_ONE * above, (INSIDE_ONE - 1) * above))), 9)

    growth = min(GROWTHS, key=loss)
    return scale(growth), growth


def left_over(error_m: Values, by: Values) -> list[float]:
    """Mean error without the pixels of the largest `by`, for each share LEFT_OUT, over the mean of all."""
    rising = error_m[np.argsort(by, kind="stable")]
    kept = [max(1, round(len(rising) * (1 - share))) for share in LEFT_OUT]
    return [float(rising[:count].mean() / rising.mean()) for count in kept]
