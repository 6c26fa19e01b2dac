"""The maps of a flight's frames, one file each: depth, confidence, deviation, and bounds where depth is unknown."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import get_args

import numpy as np

from flightdepth.outputs.encoding import (
    FARTHEST,
    UNKNOWN,
    Map,
    bytes_from_confidence,
    centimetres_from_depth,
    npz,
    png,
    rounded_centimetres,
)
from flightdepth.outputs.record import DepthFormat
from flightdepth.ranges.result import RangedDepth

DEPTH, CONFIDENCE, SIGMA = "depth", "confidence", "sigma"
FARTHER, NEARER = "farther_than", "nearer_than"  # bounds of what has no depth
KINDS = (DEPTH, CONFIDENCE, SIGMA, FARTHER, NEARER)  # a folder each


def map_file(flight: Path, kind: str, index: int, ending: str = "png") -> Path:
    """Where a flight's folder has one frame's map of a kind."""
    return flight / kind / f"{index:06d}.{ending}"


class MapFiles:
    """Writes maps below `folder`. Depth and deviation stand in centimetres ("png") or in metres ("npz").

    saturated_pixels   depths in centimetres so far that were 655.35 m or farther
    """

    def __init__(self, folder: Path, depth_format: DepthFormat) -> None:
        self._folder, self._format = folder, depth_format
        self.saturated_pixels = 0
        for kind in (DEPTH, CONFIDENCE):
            (folder / kind).mkdir()

    def add(self, index: int, result: RangedDepth) -> None:
        """Write those of one frame."""
        self._write(CONFIDENCE, index, png(bytes_from_confidence(result.confidence)))
        if (sigma_m := result.sigma_m) is not None:
            exact = self._format == "npz"
            sigma = npz(sigma_m=sigma_m) if exact else png(rounded_centimetres(sigma_m))
            self._write(SIGMA, index, sigma, self._format)
        self._write_bound(FARTHER, index, result.farther_than_m)
        self._write_bound(NEARER, index, result.nearer_than_m)
        self._write_depth(index, result.depth_m)

    def remove(self, index: int) -> None:
        """Take away what came to the disk of one frame."""
        for kind in KINDS:
            for ending in get_args(DepthFormat):
                with suppress(OSError):
                    map_file(self._folder, kind, index, ending).unlink()

    def _write_depth(self, index: int, depth_m: Map) -> None:
        if self._format == "npz":
            self._write(DEPTH, index, npz(depth_m=depth_m), "npz")
            return
        centimetres = centimetres_from_depth(depth_m)
        self._write(DEPTH, index, png(centimetres))
        self.saturated_pixels += int(np.count_nonzero(centimetres == FARTHEST))

    def _write_bound(self, kind: str, index: int, bound_m: Map) -> None:
        """In centimetres whatever the format: a bound is one value over wide areas, and small so."""
        if not np.isfinite(bound_m).any():
            return
        centimetres = centimetres_from_depth(bound_m)
        if kind == NEARER:  # "at most 655.35 m" would be wrong of what is at most 700 m
            centimetres[centimetres == FARTHEST] = UNKNOWN
        if centimetres.any():
            self._write(kind, index, png(centimetres))

    def _write(self, kind: str, index: int, data: bytes, ending: str = "png") -> None:
        (self._folder / kind).mkdir(exist_ok=True)
        map_file(self._folder, kind, index, ending).write_bytes(data)
