"""A flight from above: the height of its highest surface in each square of the ground, and that surface's colour.

Of the points over a square, the surface is the highest slab, as thick as the square is wide, that holds a fair share of
what the fullest one holds: crowns and roofs count, though most points lie beneath them, and a stray point is no tower.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.files import file_in_progress
from flightdepth.motion import Vector
from flightdepth.outputs.voxels import Cloud

FAIR_SHARE = 1 / 3  # of the fullest slab's weight
LEAST_POINTS = 3  # in a slab; with fewer nothing is known
MOST_CELLS = 100_000_000  # of a map: 0.8 GB, known or not
TILE = 256  # cells, of a file
SOFTWARE = "TIFFTAG_SOFTWARE"


@dataclass(frozen=True, eq=False)
class HeightMap:
    """A surface from above, north up: the first row is the northernmost. Cells begin at whole multiples of their width.

    height_m   float32 [H, W]; NaN where nothing is known
    colours    uint8 RGBA [H, W, 4]; 255 in the last where a height is known, all 0 elsewhere
    corner_m   east and north of the north-western corner
    cell_m     width of a cell
    """

    height_m: NDArray[np.float32]
    colours: NDArray[np.uint8]
    corner_m: tuple[float, float]
    cell_m: float

    @property
    def known(self) -> int:
        """How many cells have a height."""
        return int(np.isfinite(self.height_m).sum())


def height_map(cloud: Cloud, cell_m: float) -> HeightMap:
    """Of points east, north, up, in cells of that width; as large as what is known, without a cell where nothing is.

    Raises:
        BadInput: it would have more than `MOST_CELLS`.
    """
    cells = np.floor(cloud.points_m[:, :2] / cell_m).astype(np.int64)  # to the east, to the north
    found, rank = np.unique(cells, axis=0, return_inverse=True)
    heights_m, colours = surfaces(cloud, rank.ravel(), len(found), thick_m=cell_m)
    known = np.isfinite(heights_m)
    if not known.any():
        return HeightMap(np.empty((0, 0), np.float32), np.empty((0, 0, 4), np.uint8), (0.0, 0.0), cell_m)
    found, heights_m, colours = found[known], heights_m[known], colours[known]
    (west, south), (east, north) = found.min(axis=0).tolist(), found.max(axis=0).tolist()
    height, width = north - south + 1, east - west + 1
    if height * width > MOST_CELLS:
        raise BadInput("--voxel", expected="wider cells", got=f"a map of {width:,} x {height:,} of them")
    rows, columns = north - found[:, 1], found[:, 0] - west
    height_m, rgba = np.full((height, width), np.nan, np.float32), np.zeros((height, width, 4), np.uint8)
    height_m[rows, columns], rgba[rows, columns, :3], rgba[rows, columns, 3] = heights_m, colours, 255
    return HeightMap(height_m, rgba, (west * cell_m, (north + 1) * cell_m), cell_m)


def surfaces(
    cloud: Cloud, cell: NDArray[np.intp], cells: int, *, thick_m: float
) -> tuple[Vector, NDArray[np.uint8]]:
    """Heights [cells] and colours [cells, 3] of each cell's highest surface, NaN and 0 where too few points tell it.

    cell     of each point [N]; every cell has one
    thick_m  of a slab

    A point weighs its confidence times the number of those it stands for.
    """
    lowest_m = cloud.points_m[:, 2].min(initial=np.inf)
    above_m = cloud.points_m[:, 2] - lowest_m
    order = np.lexsort((above_m, cell))
    cell, above_m = cell[order], above_m[order]
    seen = np.ones(len(cloud), np.int64) if cloud.seen is None else cloud.seen[order]
    weight = seen * cloud.confidence[order].astype(np.float64)
    # All cells' points upwards in one line, too far apart for a slab to reach the next cell's.
    line_m = cell * (above_m.max(initial=0.0) + 2 * thick_m) + above_m
    first, end = np.searchsorted(line_m, line_m - thick_m), np.arange(len(line_m)) + 1  # of each one's slab

    def in_slab(values: NDArray[Any]) -> NDArray[Any]:
        sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
        return np.asarray(sums[end] - sums[first])

    slab_weight = in_slab(weight)
    fullest = np.zeros(cells)
    np.maximum.at(fullest, cell, slab_weight)
    counts = (slab_weight >= FAIR_SHARE * fullest[cell]) & (in_slab(seen) >= LEAST_POINTS)
    highest = np.full(cells, -1)
    highest[cell[counts]] = np.nonzero(counts)[0]  # upwards: the last one stays
    known, top = highest >= 0, highest[highest >= 0]
    values = np.c_[above_m, cloud.colours[order]] * weight[:, None]
    means = in_slab(values)[top] / slab_weight[top, None]
    heights_m, colours = np.full(cells, np.nan), np.zeros((cells, 3), np.uint8)
    heights_m[known] = lowest_m + means[:, 0]
    colours[known] = np.clip(np.rint(means[:, 1:]), 0, 255)
    return heights_m, colours


def photo_beside(path: Path) -> Path:
    """The file of the colours: NAME-photo.tif beside NAME.tif."""
    return path.with_stem(f"{path.stem}-photo")


def write_heights(path: Path, surface: HeightMap, frame: str, crs: Any = None) -> None:
    """Heights as GeoTIFF, float32 with NaN as nodata, and their colours, RGBA, in `photo_beside` it.

    frame  the axes, for people
    crs    the pyproj.CRS of east and north, None of a local frame
    """
    photo = geotiff(np.moveaxis(surface.colours, 2, 0), surface, f"colours of heights; {frame}", crs)
    heights = geotiff(surface.height_m[None], surface, f"heights of the highest surface; {frame}", crs)
    with file_in_progress(photo_beside(path)) as beside, file_in_progress(path) as file:  # both, or neither
        beside.write(photo)
        beside.flush()
        file.write(heights)


def wrote_geotiff(path: Path, head: bytes) -> bool:
    """Whether flightdepth wrote a GeoTIFF; its first bytes, `head`, do not tell of a large one."""
    import rasterio

    if not head.startswith((b"II", b"MM")):
        return False
    try:
        with warnings.catch_warnings(action="ignore"), rasterio.open(path) as file:
            return bool(file.tags().get(SOFTWARE) == "flightdepth")
    except rasterio.RasterioIOError:
        return False


def geotiff(bands: NDArray[Any], surface: HeightMap, described: str, crs: Any) -> bytes:
    """Bands [B, H, W] where `surface` lies, compressed without loss: one of heights, or four of colours."""
    import rasterio
    from rasterio.enums import ColorInterp
    from rasterio.io import MemoryFile

    west_m, north_m = surface.corner_m
    of_heights = len(bands) == 1
    options = {"nodata": np.nan, "predictor": 3} if of_heights else {"photometric": "RGB", "predictor": 2}
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff",
            count=len(bands),
            height=bands.shape[1],
            width=bands.shape[2],
            dtype=bands.dtype,
            crs=None if crs is None else rasterio.crs.CRS.from_epsg(crs.to_epsg()),
            transform=rasterio.Affine(surface.cell_m, 0, west_m, 0, -surface.cell_m, north_m),
            compress="deflate",
            tiled=True,
            blockxsize=TILE,
            blockysize=TILE,
            interleave="pixel",
            **options,
        ) as file:
            file.update_tags(
                AREA_OR_POINT="Area",
                TIFFTAG_IMAGEDESCRIPTION=described,
                **{SOFTWARE: "flightdepth"},
            )
            if of_heights:
                file.set_band_description(1, "height of the highest surface")
                file.units = ("metre",)
            else:
                file.colorinterp = [ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha]
            file.write(bands)
        return bytes(memory.read())
