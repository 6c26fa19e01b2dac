"""Where in a picture a network errs: at edges of depth, beside them, on surfaces with a texture or without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.metrics import mean, pooled
from flightdepth.levels import Image, grey
from flightdepth.runtimes.arrays import Maps

PLACES = ("at an edge", "beside one", "flat, textured", "flat, blank")
EDGE, BESIDE, TEXTURED, BLANK = range(len(PLACES))
APART = 1.3  # farthest over nearest depth of a block with an edge
LEAST_DEVIATION = 2.0  # of grey (0 to 255) over 3x3 blocks: less is blank

Indices = NDArray[np.int64]


def places_of(apart: Maps, picture: Image) -> Indices:
    """Index into PLACES of each block [h, w]: by an edge of depth in it or beside it, else by its texture.

    apart    farthest over nearest depth of each block [h, w]
    picture  uint8 RGB [H, W, 3], whole multiples of that
    """
    edge = (apart > APART).astype(np.uint8)
    around = np.ones((3, 3), np.uint8)
    values = grey(picture).astype(np.float32)
    middle, squared = (cv2.blur(pooled(each, apart.shape), (3, 3)) for each in (values, values * values))
    blank = squared - middle * middle < LEAST_DEVIATION**2
    places = np.where(blank, BLANK, TEXTURED)
    places[cv2.dilate(edge, around) > 0] = BESIDE
    places[edge > 0] = EDGE
    return np.asarray(places, np.int64)


def errors_by_place(
    places: Sequence[Indices], truths: Sequence[Maps], answers: Mapping[str, Sequence[Maps]]
) -> list[dict[str, Any]]:
    """A row for each of PLACES, over the pixels of all pictures where the truth is known.

    Each has its share of the pixels, each answer's mean error in metres and in relative terms where that knows a depth,
    and the share of all its error that lies there.
    """
    place, truth = _pixels(places), _pixels(truths)
    error = {who: np.abs(_pixels(maps) - truth) for who, maps in answers.items()}
    known, rows = np.isfinite(truth), []
    for index, name in enumerate(PLACES):
        here = known & (place == index)
        row: dict[str, Any] = {"place": name, "share": mean(here[known])}
        for who, off in error.items():
            told = here & np.isfinite(off)
            row[who] = {
                "l1_m": mean(off[told]),
                "abs_rel": mean(off[told & (truth > 0)] / truth[told & (truth > 0)]),
                "of_error": float(off[told].sum() / max(np.nansum(off[known]), 1e-9)),
            }
        rows.append(row)
    return rows


def _pixels(maps: Sequence[NDArray[Any]]) -> NDArray[np.float64]:
    return np.concatenate([np.zeros(0), *(each.ravel() for each in maps)])
