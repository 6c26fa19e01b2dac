"""Height maps: which cells are known, and how high, against a plain reference; their files, against rasterio."""

import errno
import sys
from contextlib import contextmanager
from dataclasses import replace

import laspy
import numpy as np
import pytest
import rasterio
from flown_folder import FRAMES, STEP_M, WALL_M, pose, write_flown
from pyproj import CRS, Geod, Transformer

from flightdepth.cli import main
from flightdepth.errors import BadInput
from flightdepth.files import file_in_progress
from flightdepth.outputs import heights
from flightdepth.outputs.heights import (
    FAIR_SHARE,
    LEAST_POINTS,
    height_map,
    photo_beside,
    write_heights,
    wrote_geotiff,
)
from flightdepth.outputs.voxels import Cloud, VoxelGrid

MUNICH = (48.1, 11.5, 520.0)
CELL_M = 0.5


def cloud(points, *, colours=None, confidence=1.0, seen=None):
    points = np.asarray(points, float).reshape(-1, 3)
    if colours is None:
        colours = np.zeros((len(points), 3), np.uint8)
    shares = np.broadcast_to(np.float32(confidence), len(points))
    return Cloud(points, np.asarray(colours, np.uint8), shares, seen)


def over_one_cell(*layers):
    """`number` points a layer at height `up`, spread over the cell that begins at 0, 0."""
    return np.concatenate(
        [
            np.random.default_rng(int(up)).uniform((0, 0, up), (0.5, 0.5, up + 0.01), (n, 3))
            for up, n in layers
        ]
    )


def moved(points, by):
    return np.asarray(points) + by


def height_of(points, **options):
    return float(height_map(cloud(points, **options), CELL_M).height_m[0, 0])


def by_hand(points, weights, thick_m):
    """The rule in plain words, for the points of one cell."""
    slabs = [(points[:, 2] <= top) & (points[:, 2] >= top - thick_m) for top in points[:, 2]]
    fullest = max(weights[slab].sum() for slab in slabs)
    counting = [
        (top, slab)
        for top, slab in zip(points[:, 2], slabs, strict=True)
        if weights[slab].sum() >= FAIR_SHARE * fullest and slab.sum() >= LEAST_POINTS
    ]
    if not counting:
        return np.nan
    _, slab = max(counting, key=lambda each: each[0])
    return np.average(points[slab, 2], weights=weights[slab])


# Cells


@pytest.mark.parametrize("cell_m", [0.3, 0.5, 2.0])
@pytest.mark.parametrize("middle_m", [(0.0, 0.0, 0.0), (691_234.5, 5_330_012.7, 520.0)])
def test_each_cell_says_what_the_plain_rule_says(cell_m, middle_m):
    rng = np.random.default_rng(0)
    points = middle_m + rng.normal(0, (1.2, 1, 0.7), (600, 3))
    weights = rng.uniform(0.5, 1, 600).astype(np.float32)
    found = height_map(cloud(points, confidence=weights), cell_m)
    west_m, north_m = found.corner_m
    known = 0
    for row, column in np.ndindex(found.height_m.shape):
        low = np.array([west_m + column * cell_m, north_m - (row + 1) * cell_m])
        here = ((points[:, :2] >= low) & (points[:, :2] < low + cell_m)).all(axis=1)
        expected = by_hand(points[here], weights[here], cell_m) if here.any() else np.nan
        assert found.height_m[row, column] == pytest.approx(expected, abs=1e-4, nan_ok=True)
        known += np.isfinite(expected)
    assert known > 5
    assert found.known == known


def test_a_map_is_as_large_as_what_is_known():
    """A stray point far off, which no cell counts, made it no larger."""
    points = np.concatenate([over_one_cell((2, 9)), moved(over_one_cell((5, 9)), (3, 1.5, 0)), [(90, 80, 1)]])
    found = height_map(cloud(points), CELL_M)
    assert found.height_m.shape == (4, 7)
    assert np.isfinite(found.height_m).sum() == 2
    assert found.height_m[[3, 0], [0, 6]] == pytest.approx([2.005, 5.005], abs=0.005)
    assert found.corner_m == (0.0, 2.0)


def test_maps_of_neighbouring_flights_have_the_same_cells():
    """A cell begins at a multiple of its width, wherever the points do."""
    points = moved(over_one_cell((2, 200)) * (20, 20, 1), (37.2, -11.9, 0))
    one, other = (height_map(cloud(part), CELL_M) for part in (points, points[points[:, 0] > 40.1]))
    for found in (one, other):
        assert np.mod(found.corner_m, CELL_M) == pytest.approx([0, 0])
    columns = round((other.corner_m[0] - one.corner_m[0]) / CELL_M)
    assert columns > 5


def test_a_plane_is_itself():
    rng = np.random.default_rng(1)
    places = rng.uniform(-10, 10, (40_000, 2))
    plane = lambda east, north: 30 + 0.2 * east - 0.1 * north  # noqa: E731
    found = height_map(cloud(np.c_[places, plane(*places.T)]), CELL_M)
    rows, columns = np.indices(found.height_m.shape)
    west_m, north_m = found.corner_m
    expected = plane(west_m + (columns + 0.5) * CELL_M, north_m - (rows + 0.5) * CELL_M)
    assert found.height_m.shape == (40, 40)
    assert np.abs(found.height_m - expected).max() < 0.05


# Which surface counts


@pytest.mark.parametrize(
    ("ground", "crown", "height_m"),
    [(60, 60, 8), (60, 25, 8), (60, 15, 0), (3, 3, 8), (3, 2, 0), (0, 5, 8)],
)
def test_the_upper_of_two_layers_counts_where_enough_points_tell_it(ground, crown, height_m):
    assert height_of(over_one_cell((0, ground), (8, crown))) == pytest.approx(height_m, abs=0.01)


@pytest.mark.parametrize("stray", [1, 2])
@pytest.mark.parametrize("ground", [3, 5, 50])
def test_a_stray_point_is_no_tower(ground, stray):
    assert height_of(over_one_cell((0, ground), (15, stray))) == pytest.approx(0, abs=0.01)


def test_a_stray_point_just_above_hardly_lifts_the_ground():
    """Its slab holds the ground too, whose mean it is."""
    assert height_of(over_one_cell((0, 30), (0.4, 1))) == pytest.approx(0.018, abs=0.01)


@pytest.mark.parametrize("number", range(LEAST_POINTS))
def test_too_few_points_tell_nothing(number):
    found = height_map(cloud(over_one_cell((4, number))), CELL_M)
    assert (found.height_m.size, found.known) == (0, 0)


def test_a_point_counts_as_many_as_it_stands_for():
    """Of a thinned cloud one may stand for hundreds."""
    points = [(0.2, 0.2, 0.0), (0.3, 0.3, 8.0)]
    for seen, height_m in (((100, 40), 8.0), ((100, 20), 0.0), ((1, LEAST_POINTS), 8.0)):
        assert height_of(points, seen=np.array(seen)) == pytest.approx(height_m)


def test_a_sure_point_counts_more():
    points = over_one_cell((0, 30), (8, 15))
    assert height_of(points, confidence=np.repeat([1.0, 0.5], (30, 15))) == pytest.approx(0, abs=0.01)
    assert height_of(points, confidence=np.repeat([0.5, 1.0], (30, 15))) == pytest.approx(8, abs=0.01)


def test_thinning_counts_its_points():
    grid = VoxelGrid(CELL_M)
    grid.add(over_one_cell((0, 30), (8, 12)), np.zeros((42, 3), np.uint8), np.ones(42, np.float32))
    assert sorted(grid.cloud().seen) == [12, 30]
    assert height_map(grid.cloud(), CELL_M).height_m == pytest.approx(8, abs=0.01)


def test_colours_are_those_of_the_surface():
    points = over_one_cell((0, 20), (8, 20))
    colours = np.repeat([(10, 200, 30), (90, 60, 20)], 20, axis=0)
    neighbour = moved(over_one_cell((1, 3)), (1.0, 0, 0))
    both = np.concatenate([colours, np.full((3, 3), 77)])
    found = height_map(cloud(np.concatenate([points, neighbour]), colours=both), CELL_M)
    assert found.colours.tolist() == [[[90, 60, 20, 255], [0, 0, 0, 0], [77, 77, 77, 255]]]


def test_a_map_that_no_memory_holds_is_refused(monkeypatch):
    monkeypatch.setattr(heights, "MOST_CELLS", 6)
    ends = np.concatenate([over_one_cell((0, 3)), moved(over_one_cell((0, 3)), (1.0, 1.0, 0))])
    with pytest.raises(BadInput, match="--voxel: expected wider cells, got a map of 3 x 3 of them"):
        height_map(cloud(ends), CELL_M)
    assert height_map(cloud(ends), 1.0).height_m.shape == (2, 2)


# Files


@pytest.mark.parametrize("crs", [CRS.from_epsg(32632), None])
def test_the_files_go_through_rasterio(tmp_path, crs):
    points = np.concatenate([over_one_cell((2, 9)), moved(over_one_cell((5, 9)), (300, 1.5, 0))])
    surface = height_map(cloud(moved(points, (691_000, 5_330_000, 0)), colours=np.full((18, 3), 200)), CELL_M)
    write_heights(tmp_path / "a.tif", surface, "heights above mean sea level", crs)
    with rasterio.open(tmp_path / "a.tif") as file, rasterio.open(photo_beside(tmp_path / "a.tif")) as photo:
        for each in (file, photo):
            assert each.transform.to_gdal() == (691_000.0, CELL_M, 0.0, 5_330_002.0, 0.0, -CELL_M)
            assert (each.crs and each.crs.to_epsg()) == (crs and 32632)
            assert (each.profile["compress"], each.profile["tiled"]) == ("deflate", True)
            assert "heights above mean sea level" in each.tags()["TIFFTAG_IMAGEDESCRIPTION"]
            assert each.tags().get("AREA_OR_POINT", "Area") == "Area"
        assert np.isnan(file.nodata)
        assert (file.dtypes, file.units, file.descriptions) == (
            ("float32",),
            ("metre",),
            ("height of the highest surface",),
        )
        assert np.array_equal(file.read(1), surface.height_m, equal_nan=True)
        assert np.array_equal(file.read_masks(1) > 0, np.isfinite(surface.height_m))
        assert np.array_equal(np.moveaxis(photo.read(), 0, 2), surface.colours)
        assert [band.name for band in photo.colorinterp] == ["red", "green", "blue", "alpha"]
        assert np.array_equal(photo.dataset_mask() > 0, np.isfinite(surface.height_m))


def test_large_maps_say_whose_they_are_too(tmp_path):
    """Their first bytes do not: where their tiles lie stands before who wrote them, and no second map was written."""
    surface = height_map(
        cloud(np.concatenate([over_one_cell((2, 9)), moved(over_one_cell((2, 9)), 2_000)])), CELL_M
    )
    write_heights(tmp_path / "a.tif", surface, "axes", CRS.from_epsg(32632))
    for path in (tmp_path / "a.tif", tmp_path / "a-photo.tif"):
        assert wrote_geotiff(path, path.read_bytes()[:512])
        assert path.stat().st_size < 1_000_000
        path.write_bytes(path.read_bytes()[:1000])
        assert not wrote_geotiff(path, path.read_bytes()[:512])


# The command


def placed_poses():
    """The flight along the wall, from Munich northwards."""
    geod, poses = Geod(ellps="WGS84"), []
    for i in range(FRAMES):
        longitude, latitude, _ = geod.fwd(MUNICH[1], MUNICH[0], 0.0, STEP_M * i)
        poses.append(replace(pose(i, STEP_M * i), place=np.array([latitude, longitude, MUNICH[2]])))
    return poses


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    write_flown(folder / "local")
    record = write_flown(folder / "out", poses=placed_poses()).folder / "flight.json"
    record.write_text(
        record.read_text().replace('"altitude_above": null', '"altitude_above": "mean sea level"')
    )
    return folder


@pytest.fixture
def convert(work, capsys):
    def call(name, *options, folder="out"):
        code = main(["convert", str(work / folder), str(work / name), "--every", "1", *options])
        out, err = capsys.readouterr()
        return code, " ".join(out.split()), " ".join(err.split())

    return call


def refused(outcome, *words):
    code, _, stderr = outcome
    assert code == 2
    assert [word for word in words if word not in stderr] == []


@pytest.mark.parametrize("name", ["flight.tif", "other.TIFF"])
def test_a_height_map_lies_where_the_cloud_lies(convert, work, name):
    code, stdout, _ = convert(name)
    assert code == 0
    assert convert("flight.laz")[0] == 0
    assert "EPSG:32632), heights above mean sea level first camera at latitude 48.1" in stdout
    points = laspy.read(work / "flight.laz").xyz
    wall_m = Transformer.from_crs(4326, 32632, always_xy=True).transform(
        MUNICH[1], MUNICH[0] + WALL_M / 111_200
    )
    with rasterio.open(work / name) as file:
        assert file.crs.to_epsg() == 32632
        assert file.res == (CELL_M, CELL_M)
        height_m = file.read(1)
        rows, columns = np.nonzero(np.isfinite(height_m))
        east, north = (np.array(each) for each in file.xy(rows, columns))
    assert len(rows) > 20
    assert f"{len(rows):,} cells of 0.5 m, with colours in {photo_beside(work / name).name}," in stdout
    for middle, up in zip(np.c_[east, north], height_m[rows, columns], strict=True):
        beside = np.abs(points[:, :2] - middle).max(axis=1) < CELL_M
        assert points[beside, 2].min() - 0.01 <= up <= points[beside, 2].max() + 0.01
    highest = max(points[:, 2])
    assert height_m[rows, columns].max() == pytest.approx(highest, abs=CELL_M)
    assert np.median(north) == pytest.approx(wall_m[1], abs=CELL_M)
    with rasterio.open(photo_beside(work / name)) as photo:
        assert photo.read()[:3, rows, columns].mean(axis=1) == pytest.approx([200, 40, 40], abs=15)


def test_a_flight_without_positions_has_a_local_map(convert, work):
    code, stdout, _ = convert("here.tif", "--voxel", "1", folder="local")
    assert (code, " cells of 1 m" in stdout) == (0, True)
    assert "metres east, north, up, not in UTM: poses.csv tells no latitude and longitude" in stdout
    with rasterio.open(work / "here.tif") as file:
        assert (file.crs, file.res) == (None, (1.0, 1.0))
        assert file.bounds.bottom <= WALL_M <= file.bounds.top


@pytest.mark.parametrize("theirs", ["again.tif", "again-photo.tif"])
def test_only_its_own_older_result_is_replaced(convert, work, theirs):
    (work / theirs).write_bytes(b"II*\x00 a map of somebody else")
    refused(convert("again.tif"), "a new file, or an older one of the same that flightdepth wrote", theirs)
    assert (work / theirs).read_bytes() == b"II*\x00 a map of somebody else"
    (work / theirs).unlink()
    assert [convert("again.tif")[0] for _ in range(2)] == [0, 0]


def test_nothing_counts(convert, work):
    refused(
        convert("empty.tif", "--min-confidence", "1"),
        "expected ground that enough points tell, got none",
        "lower",
    )
    assert not list(work.glob("empty*"))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--voxel", "0"), "--voxel: expected 0.01 m or more"),
        (("--utc",), "--utc: expected a FILE that ends in .mcap"),
    ],
)
def test_options_that_do_not_fit(convert, options, said):
    refused(convert("odd.tif", *options), said)


def test_the_finest_cells(convert, work):
    """Their cloud is as fine as one may be."""
    assert convert("fine.tif", "--voxel", "0.01")[0] == 0
    with rasterio.open(work / "fine.tif") as file:
        assert file.res == pytest.approx((0.01, 0.01))


def test_a_file_among_those_of_the_run(convert, work):
    refused(convert("out/flight.tif"), "a place outside", "replaces")
    assert not (work / "out/flight.tif").exists()


@pytest.mark.parametrize("module", ["rasterio", "pyproj"])
def test_without_the_extra_it_says_which(convert, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)  # an import of it fails
    code, _, stderr = convert("missing.tif")
    assert (code, "flightdepth[rasters]" in stderr) == (3, True)


class FullDisk:
    def write(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("file", [1, 2])
def test_a_full_disk_leaves_neither_file(convert, work, monkeypatch, file):
    """A second one without room left the first: a photo without its heights."""
    begun = []

    @contextmanager
    def with_less_room(path):
        begun.append(path)
        with file_in_progress(path) as real:
            yield real if len(begun) != file else FullDisk()

    monkeypatch.setattr(heights, "file_in_progress", with_less_room)
    code, _, stderr = convert("large.tif")
    assert (code, list(work.glob("large*"))) == (3, [])
    assert f"no room left on the disk of {work / 'large.tif'}; nothing of it was written" in stderr


def test_positions_that_the_way_does_not_follow_are_warned_of(convert, work):
    strange = [
        replace(each, place=moved(each.place, (0.002 * i, 0, 0))) for i, each in enumerate(placed_poses())
    ]
    write_flown(work / "strange", poses=strange)
    code, _, stderr = convert("strange.tif", folder="strange")
    assert (code, "go another way than its velocities" in stderr) == (0, True)
