"""`flightdepth convert` to GeoTIFF: a height map, and its colours in a file beside it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from flightdepth.commands.convert import WIDER, on_earth
from flightdepth.commands.extras import extra_packages
from flightdepth.commands.terminal import progress_bar
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, refuse_to_replace

if TYPE_CHECKING:
    from flightdepth.outputs import FlightFolder
    from flightdepth.outputs.cloud import CloudSettings

VOXELS_A_CELL = 2  # along an edge: finer ones tell the same heights
FINEST_M = 0.01  # of a cloud's voxels


def check_height_map(file: Path) -> None:
    """Refuse, before the work, what cannot be written or would replace a file that is no older result, or its photo."""
    from flightdepth.outputs.heights import photo_beside, wrote_geotiff

    with extra_packages("Writing GeoTIFF", "rasters"):
        import pyproj  # noqa: F401
        import rasterio  # noqa: F401
    for each in (file, photo_beside(file)):
        check_parent("FILE", each)
        refuse_to_replace("file", each, partial(wrote_geotiff, each))


def write_height_map(flight: FlightFolder, file: Path, settings: CloudSettings) -> tuple[str, str]:
    """The height map of a flight into `file`; how many cells it knows, and in which frame. `voxel_m` is a cell's."""
    from flightdepth.outputs.cloud import cloud_of
    from flightdepth.outputs.heights import height_map, photo_beside, write_heights

    cell_m = settings.voxel_m
    finer = replace(settings, voxel_m=max(cell_m / VOXELS_A_CELL, FINEST_M))
    with progress_bar("heights", -(-len(flight.rows) // settings.every), "frames") as bar:
        cloud = cloud_of(flight, finer, bar.step)
    cloud, crs, frame = on_earth(flight, cloud)
    surface = height_map(cloud, cell_m)
    if not surface.known:
        raise BadInput(
            f"depth in {flight.folder}", expected="ground that enough points tell", got="none", mend=WIDER
        )
    write_heights(file, surface, frame.splitlines()[0], crs)
    what = f"{surface.known:,} cells of {cell_m:g} m, with colours in {photo_beside(file).name},"
    return what, frame
