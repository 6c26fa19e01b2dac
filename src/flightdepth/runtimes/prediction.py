"""What a network says about a batch of frame pairs that share the current frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flightdepth.runtimes.arrays import Flags, Maps


@dataclass(frozen=True)
class Prediction:
    """Maps on the network's output grid, n pairs.

    beta      [n, h, w]  output as a share of the network's largest depth, 0..1 (paper, equation 2)
    depth_m   [n, h, w]  alpha * beta * |displacement|, metres; NaN where the displacement is 0
    sigma_m   [n, h, w]  standard deviation in metres, or None where the network does not tell
    valid     [h, w]     bool: the pixel lies inside the source image, not in padding, and is not masked
    """

    beta: Maps
    depth_m: Maps
    sigma_m: Maps | None
    valid: Flags

    def __post_init__(self) -> None:
        if self.beta.ndim != 3 or self.depth_m.shape != self.beta.shape:
            raise ValueError(
                f"expected beta and depth_m [n, h, w], got {self.beta.shape}, {self.depth_m.shape}"
            )
        if self.valid.shape != self.beta.shape[1:]:
            raise ValueError(f"expected valid {self.beta.shape[1:]}, got {self.valid.shape}")

    def where(self, shown: Flags) -> Prediction:
        """The same, and nothing (NaN) where `shown` [h, w] is False."""
        beta, depth_m = (np.where(shown, each, np.float32(np.nan)) for each in (self.beta, self.depth_m))
        sigma_m = None if self.sigma_m is None else np.where(shown, self.sigma_m, np.float32(np.nan))
        return replace(self, beta=beta, depth_m=depth_m, sigma_m=sigma_m, valid=self.valid & shown)
