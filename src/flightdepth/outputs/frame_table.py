"""frames.csv: one row a frame, what was paired and how much depth came of it."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np

from flightdepth.flight.records import Frame
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.ranges.result import RangedDepth

COLUMNS = (
    *("index", "stamp_ns", "shifts", "displacements_m", "centroids_m"),
    *("valid_fraction", "latency_ms", "reason", "network", "focal_px", "sigma_share", "utc_ns", "picture"),
)
EVERY = 4  # pixels each way are looked at for sigma_share: a network's own are no smaller


ONLY_BOUNDS = "no pixel has depth; what is known is farther or nearer than a bound"


@dataclass(frozen=True)
class FrameRow:
    """One frame.

    index            names its files: depth/000012.png is frame 12
    stamp_ns         time since the video's first picture
    shifts           frames between the pictures of each pair; empty without depth, as the next two
    displacements_m  metres flown between them
    centroids_m      depths that chose the pairs; NaN where none was known yet
    valid_fraction   share of the pixels with depth, 0..1
    latency_ms       time that the depth took
    reason           why no pixel has depth; empty where one has
    network          which one gave depth or bounds; empty where none did, and in tables of older versions
    focal_px         horizontal focal length of its picture, where the lens zooms; None where flight.json tells it
    sigma_share      median of standard deviation over depth, of the pixels with depth; None where none is told
    utc_ns           universal time, since 1970; None where neither the log nor the pictures' names tell it
    picture          name of its file in a folder of pictures; empty of a video
    """

    index: int
    stamp_ns: int
    shifts: tuple[int, ...]
    displacements_m: tuple[float, ...]
    centroids_m: tuple[float, ...]
    valid_fraction: float
    latency_ms: float
    reason: str
    network: str = ""
    focal_px: float | None = None
    sigma_share: float | None = None
    utc_ns: int | None = None
    picture: str = ""

    @classmethod
    def of(cls, frame: Frame, result: RangedDepth, utc: UniversalTime | None = None) -> FrameRow:
        """The row of a frame and its result; `utc` of the flight."""
        known = np.isfinite(result.depth_m)
        return cls(
            index=frame.index,
            stamp_ns=frame.stamp_ns,
            shifts=tuple(int(shift) for shift in result.shifts),
            displacements_m=tuple(float(length) for length in result.displacements_m),
            centroids_m=tuple(float(depth) for depth in result.centroids_m),
            valid_fraction=float(known.mean()),
            latency_ms=result.latency_ms,
            reason=result.reason or ("" if known.any() else ONLY_BOUNDS),
            network=result.network,
            focal_px=None if frame.camera is None else frame.camera.fx,
            sigma_share=_sigma_share(result),
            utc_ns=None if utc is None else utc.at(frame.stamp_ns),
            picture=frame.picture,
        )


def _sigma_share(result: RangedDepth) -> float | None:
    if result.sigma_m is None:
        return None
    depth_m, sigma_m = result.depth_m[::EVERY, ::EVERY], result.sigma_m[::EVERY, ::EVERY]
    told = np.isfinite(depth_m) & np.isfinite(sigma_m)
    return float(np.median(sigma_m[told] / depth_m[told])) if told.any() else None


def cells_of(row: FrameRow) -> list[object]:
    """What stands in the table for one frame; numbers of one cell are separated by spaces."""
    return [
        row.index,
        row.stamp_ns,
        " ".join(map(str, row.shifts)),
        " ".join(f"{length:.4f}" for length in row.displacements_m),
        " ".join(f"{depth:.3f}" for depth in row.centroids_m),
        f"{row.valid_fraction:.4f}",
        f"{row.latency_ms:.2f}",
        row.reason,
        row.network,
        "" if row.focal_px is None else f"{row.focal_px:.3f}",
        "" if row.sigma_share is None else f"{row.sigma_share:.4f}",
        "" if row.utc_ns is None else row.utc_ns,
        row.picture,
    ]


def rows_from_csv(text: str) -> list[FrameRow]:
    """The rows of a table whose lines are those of `cells_of`."""
    return [
        FrameRow(
            index=int(cells["index"]),
            stamp_ns=int(cells["stamp_ns"]),
            shifts=tuple(int(shift) for shift in cells["shifts"].split()),
            displacements_m=tuple(float(length) for length in cells["displacements_m"].split()),
            centroids_m=tuple(float(depth) for depth in cells["centroids_m"].split()),
            valid_fraction=float(cells["valid_fraction"]),
            latency_ms=float(cells["latency_ms"]),
            reason=cells["reason"],
            network=cells.get("network") or "",
            focal_px=float(focal_px) if (focal_px := cells.get("focal_px")) else None,
            sigma_share=float(sigma_share) if (sigma_share := cells.get("sigma_share")) else None,
            utc_ns=int(utc_ns) if (utc_ns := cells.get("utc_ns")) else None,
            picture=cells.get("picture") or "",
        )
        for cells in csv.DictReader(io.StringIO(text))
    ]
