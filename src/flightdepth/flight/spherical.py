"""Videos of a whole sphere, by cameras of 360 degrees: no single lens saw their pictures, so that they are refused.

What a file tells:

    projection      sv3d of MP4 (Google's Spherical Video V2), its GSpherical XML (V1), Matroska's Projection
    two tracks      of one size: two strips of a cube (GoPro MAX, .360), or two fisheyes (Insta360, Antigravity: .insv;
                    DJI Osmo 360: .OSV), which no projection tells
    one track       of Insta360's, known by the mark at its end: one fisheye, or two side by side

A sphere whose mark was lost on the way (cut, encoded anew) is not told from an ordinary video.
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from av.sidedata.sidedata import Type

from flightdepth.errors import BadInput
from flightdepth.flight.display_matrix import beside

# FFmpeg's AVSphericalProjection, but for pictures through one lens (rectilinear, fisheye).
SPHERES = {
    0: "equirectangular",
    1: "a cube map",
    2: "a part of an equirectangular picture",
    3: "half an equirectangular picture",
    6: "parametric",
}
INSTA360 = b"8db42d694ccc418790edff439fe026bf"
SQUARE, SIDE_BY_SIDE = 1.0, 2.0  # width by height of one fisheye, and of two
STRIP = 2.9  # and of three faces of a cube at least: GoPro's are 3.04 to 3.1
MEND = (
    "Reframe it first: export a view of it as an ordinary (flat) MP4, with a fixed field of view, from GoPro Player, "
    "Insta360 Studio or DJI Studio, and give that as --hfov."
)


def refuse_sphere(path: Path, container: Any, picture: Any) -> None:
    """Refuse a file that says that its pictures are of a whole sphere; `picture` is one of them, decoded."""
    told = _projection(picture) or _two_halves(container) or _insta360(path, picture)
    if told:
        expected, got = "pictures through one lens", f"a video of 360 degrees ({told})"
        raise BadInput(f"video {path}", expected=expected, got=got, mend=MEND)


def _projection(picture: Any) -> str | None:
    told = beside(picture, Type.SPHERICAL)
    return None if told is None else SPHERES.get(int(np.frombuffer(told, np.int32)[0]))


def _two_halves(container: Any) -> str | None:
    """Two tracks of one size; thumbnails have one picture, and where pictures are not counted none is told."""
    sizes = Counter((each.width, each.height) for each in container.streams.video if each.frames > 1)
    (width, height), count = sizes.most_common(1)[0] if sizes else ((0, 1), 0)
    if count != 2:
        return None
    if width == height:
        return "a fisheye in each of its two tracks"
    return "half of a cube in each of its two tracks" if width > STRIP * height else None


def _insta360(path: Path, picture: Any) -> str | None:
    if picture.width / picture.height not in (SQUARE, SIDE_BY_SIDE):
        return None
    with path.open("rb") as file:
        file.seek(-min(len(INSTA360), path.stat().st_size), os.SEEK_END)
        return "as an Insta360 recorded it" if file.read() == INSTA360 else None
