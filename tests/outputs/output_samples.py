"""A frame, a result and a source, made by hand."""

from __future__ import annotations

import csv
import io

import numpy as np

from flightdepth.camera import Camera
from flightdepth.flight.records import Frame
from flightdepth.outputs.record import Source
from flightdepth.ranges.result import RangedDepth
from tests_networks import difference_card

WIDTH, HEIGHT = 96, 64
CARD = difference_card(name="by-hand", focal_px=64)
SOURCE = Source(
    flight="flight.mp4",
    telemetry="log.csv",
    camera=Camera.from_fov(WIDTH, HEIGHT, 90),
    network=CARD,
    settings={"ranges": 2, "network": None},
)


def frame(index: int = 0) -> Frame:
    return Frame(index, index * 33_366_667, np.full((HEIGHT, WIDTH, 3), 10 * index % 256, np.uint8))


def known(depth_m: np.ndarray | float, lengths_m: tuple[float, ...] = (0.25, 1.5)) -> RangedDepth:
    """A result with this depth, [H, W] or everywhere the same; NaN in it is unknown without a bound."""
    depth = np.broadcast_to(np.asarray(depth_m, np.float32), (HEIGHT, WIDTH)).copy()
    nothing = np.full_like(depth, np.nan)
    n = len(lengths_m)
    return RangedDepth(
        depth_m=depth,
        confidence=np.where(np.isfinite(depth), np.float32(0.8), np.float32(0)),
        sigma_m=None,
        range_depths_m=np.full((n, HEIGHT, WIDTH), 20, np.float32),
        shifts=np.arange(3, 3 + 4 * n, 4),
        displacements_m=np.array(lengths_m),
        centroids_m=np.array([np.nan, *[30.0] * (n - 1)]),
        farther_than_m=nothing,
        nearer_than_m=nothing.copy(),
        latency_ms=5.0,
        notes=("taken not to turn",),
    )


def unknown(reason: str = "hovering: flown 0.01 m in 3.9 s, no baseline") -> RangedDepth:
    return RangedDepth.unknown(HEIGHT, WIDTH, reason, 0.5)


def csv_text(*rows) -> str:
    """What a TableFile of these rows holds, without the disk."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
