"""How a decoded picture is to be shown: by the matrix of MP4 and MOV, into which FFmpeg turns what others say."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from av.sidedata.sidedata import Type
from numpy.typing import NDArray

from flightdepth.levels import rgb


class Turn(NamedTuple):
    """What makes a picture stand upright: swapping left and right, where `mirrored`, then turns by 90 degrees.

    quarter_turns  anticlockwise, 0..3
    """

    quarter_turns: int
    mirrored: bool


def beside(picture: Any, kind: Type) -> Any | None:
    """What a decoder gave beside a picture; None of it, or where PyAV does not know some of it (18: EXIF tags)."""
    try:
        return picture.side_data.get(kind)
    except ValueError:
        return None


def turn_of(picture: Any) -> Turn:
    """Of a decoded picture, by ISO/IEC 14496-12, 6.2.2: its point (x, y) is shown at (a x + c y, b x + d y), y down."""
    told = beside(picture, Type.DISPLAYMATRIX)
    if told is None:
        return Turn(0, False)
    a, b, _, c, d = np.frombuffer(told, np.int32)[:5].tolist()
    mirrored = a * d < b * c
    rightwards = -1 if mirrored else 1  # where x points once left and right are swapped
    clockwise_rad = math.atan2(rightwards * b, rightwards * a)  # 0 of a matrix of zeros, which says nothing
    return Turn(-round(clockwise_rad / (math.pi / 2)) % 4, mirrored)


def upright(picture: Any) -> NDArray[np.uint8]:
    """RGB [H, W, 3] of a decoded picture, mirrored and turned by the multiple of 90 degrees that the file asks for."""
    return turned_upright(picture, turn_of(picture))


def turned_upright(picture: Any, turn: Turn) -> NDArray[np.uint8]:
    """RGB [H, W, 3] of a decoded picture, mirrored and turned."""
    image = rgb(picture)
    shown = np.rot90(image[:, ::-1] if turn.mirrored else image, turn.quarter_turns)
    return np.ascontiguousarray(shown)
