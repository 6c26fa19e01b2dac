"""What the pairs of one picture showed, on the network's grid, and as the result that a caller gets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightdepth.ranges.choice import Seer
from flightdepth.ranges.fusion import Fused
from flightdepth.ranges.network import AtSource, Map
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.result import RangedDepth
from flightdepth.ranges.seen_turns import SeenOrientation
from flightdepth.ranges.view import View
from flightdepth.runtimes.prediction import Prediction


@dataclass(frozen=True, eq=False)
class Seen:
    """Of `current`, through `view`; it serves again while that picture is shown again."""

    view: View
    current: Frame
    pairs: tuple[Pair, ...]
    prediction: Prediction
    fused: Fused
    seer: Seer
    doubt: str | None
    orientation: SeenOrientation | None

    def result(self, frames_given: int, notes: tuple[str, ...]) -> RangedDepth:
        """At the source's pixels, in arrays that are the caller's; `frames_given` so far number the shifts."""
        pairs, fused = self.pairs, self.fused
        at_source = self.view.at_source(fused.depth_m, self.current.image)
        confidence = at_source(fused.confidence)
        np.copyto(confidence, np.float32(0), where=np.isnan(confidence))
        told = self.seer.card.knows_direction or all(pair.directed for pair in self.pairs)
        return RangedDepth(
            depth_m=at_source.depth_m,
            confidence=confidence,
            sigma_m=None if fused.sigma_m is None else at_source(fused.sigma_m),
            range_depths_m=self.prediction.depth_m.copy(),
            shifts=np.array([frames_given - pair.previous.index for pair in pairs]),
            displacements_m=np.array([pair.length_m for pair in pairs]),
            centroids_m=np.array([pair.depth_m for pair in pairs]),
            farther_than_m=_bound(fused.farther_than_m, at_source),
            nearer_than_m=_bound(fused.nearer_than_m, at_source),
            latency_ms=0.0,  # set by who timed it
            notes=notes,
            doubt=self.doubt,
            moved_m=np.stack([pair.displacement_m for pair in self.pairs]) if told else None,
            aside_rad=np.array([pair.aside_rad for pair in self.pairs]) if told else None,
            orientation=self.orientation,
            network=self.seer.card.name,
        )


def _bound(bound_m: Map, at_source: AtSource) -> Map:
    """A bound at the source's size; it is one value over wide areas, and known only where depth is not."""
    if not np.isfinite(bound_m).any():
        return np.full_like(at_source.depth_m, np.nan)
    bound = at_source.marks(bound_m)
    np.copyto(bound, np.float32(np.nan), where=np.isfinite(at_source.depth_m))
    return bound
