"""Point clouds as files: PLY by hand (a header and records), LAS and LAZ by laspy."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from flightdepth.errors import MissingExtra
from flightdepth.files import write_atomic
from flightdepth.outputs.voxels import Cloud

PLY_TYPES = {"<f4": "float", "u1": "uchar"}
FRAME = "flightdepth: metres east, north, up; origin: the first camera"
LAS_SCALE_M = 0.001


def write_ply(path: Path, cloud: Cloud) -> None:
    """Binary little-endian PLY: x, y, z, red, green, blue, confidence."""
    kinds = [(axis, "<f4") for axis in "xyz"]
    kinds += [(colour, "u1") for colour in ("red", "green", "blue")] + [("confidence", "<f4")]
    records = np.empty(len(cloud), kinds)
    for i, axis in enumerate("xyz"):
        records[axis] = cloud.points_m[:, i]
    for i, colour in enumerate(("red", "green", "blue")):
        records[colour] = cloud.colours[:, i]
    records["confidence"] = cloud.confidence
    header = ["ply", "format binary_little_endian 1.0", f"comment {FRAME}", f"element vertex {len(cloud)}"]
    header += [f"property {PLY_TYPES[kind]} {name}" for name, kind in kinds]
    write_atomic(path, "\n".join([*header, "end_header", ""]).encode() + records.tobytes())


def write_las(path: Path, cloud: Cloud, crs: Any = None) -> None:
    """LAS 1.2 with colours (point format 2), to the millimetre; LAZ where the name ends so.

    `crs` is the pyproj.CRS of its points, None of a local frame.
    """
    import laspy

    header = laspy.LasHeader(point_format=2, version="1.2")
    header.scales = np.full(3, LAS_SCALE_M)
    header.offsets = np.zeros(3) if not len(cloud) else np.floor(cloud.points_m.min(axis=0))
    header.generating_software = "flightdepth"
    header.add_extra_dim(laspy.ExtraBytesParams("confidence", np.float32, description="0 to 1"))
    if crs is not None:
        header.add_crs(crs)
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points_m.T
    las.red, las.green, las.blue = cloud.colours.T.astype(np.uint16) * 257  # LAS counts colours to 65535
    las["confidence"] = cloud.confidence
    las.return_number = las.number_of_returns = np.ones(len(cloud), np.uint8)  # 0 is none in LAS
    data = io.BytesIO()
    try:
        las.write(data, do_compress=path.suffix.lower() == ".laz")
    except laspy.errors.LaspyException as error:
        raise MissingExtra(f"Writing LAZ ({error})", "clouds") from error
    write_atomic(path, data.getvalue())
