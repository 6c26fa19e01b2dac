"""Occupancy maps of a wall that a camera flies towards, read back by OctoMap's own library."""

import numpy as np
import octomap
import pytest
from flown_folder import FRAMES, LOOKING_EAST, STEP_M, WALL_M, pose, write_flown
from output_samples import HEIGHT, WIDTH, known

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.outputs import FlightFolder
from flightdepth.outputs.cloud import CloudSettings
from flightdepth.outputs.occupancy import bt_bytes, free_to, occupancy_of, volumes_m3
from flightdepth.ranges.fusion import RIGHT_WITHIN

CELL_M = 0.5
SETTINGS = CloudSettings(every=1, voxel_m=CELL_M, max_range_m=30)
UNKNOWN, FREE, OCCUPIED = -1, 0, 1
NEARER_M = (WALL_M - STEP_M * (FRAMES - 1)) / (1 + RIGHT_WITHIN) + STEP_M * (
    FRAMES - 1
)  # what the last frame sees past


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> FlightFolder:
    return write_flown(tmp_path_factory.mktemp("flown") / "out")


def label(tree, east_m, north_m, up_m=0.1) -> int:
    return int(tree.getLabels(np.array([[east_m, north_m, up_m]]))[0])


def read_back(data: bytes):
    tree = octomap.OcTree(1.0)
    assert tree.readBinary(data)
    return tree


@pytest.fixture(scope="module")
def tree(folder):
    return read_back(bt_bytes(occupancy_of(folder, SETTINGS)))


def test_the_wall_is_occupied_from_side_to_side(tree):
    """As far as four frames see it, 90 degrees across: less than its distance to either side."""
    for east_m in (-16.2, -8.2, 0.2, 8.2, 15.8):
        assert label(tree, east_m, WALL_M + 0.2) == OCCUPIED


def test_the_way_to_it_is_free_and_what_lies_behind_unknown(tree):
    norths = np.arange(2.25, WALL_M + 6, CELL_M)
    labels = np.array([label(tree, 0.2, north_m) for north_m in norths])
    assert (labels[norths < NEARER_M - CELL_M] == FREE).all()
    between = (norths > NEARER_M + CELL_M) & (norths < WALL_M - CELL_M)
    assert (labels[between] == UNKNOWN).all()
    assert between.sum() > 1
    assert (labels[norths > WALL_M + 2 * CELL_M] == UNKNOWN).all()


def test_what_no_picture_shows_is_unknown(tree):
    """Beside, above and behind a camera that sees 90 degrees across and looks north."""
    assert [label(tree, *place) for place in ((12, 8), (-12, 8), (0.2, -2), (0.2, 8, 9))] == 4 * [UNKNOWN]


def test_cells_are_as_large_as_asked_and_the_file_says_whose_axes(folder, tree):
    assert tree.getResolution() == CELL_M
    head = bt_bytes(occupancy_of(folder, SETTINGS)).splitlines()[:2]
    assert head[0] == b"# Octomap OcTree binary file"  # what readers ask for
    assert b"flightdepth: metres east, north, up" in head[1]


def test_volumes(folder, tree):
    """The wall is a cell thick, as wide and high as the fourth frame sees it; free is the first's pyramid and more."""
    occupied_m3, free_m3 = volumes_m3(tree)
    seen_m = WALL_M - 4 * STEP_M
    assert occupied_m3 == pytest.approx(2 * seen_m * 2 * seen_m * HEIGHT / WIDTH * CELL_M, rel=0.1)
    far_m = (WALL_M - STEP_M) / (1 + RIGHT_WITHIN)
    pyramid_m3 = (2 * far_m) * (2 * far_m * HEIGHT / WIDTH) * far_m / 3
    assert 0.95 * pyramid_m3 < free_m3 < 1.3 * pyramid_m3


def test_nothing_is_told_farther_than_asked(folder):
    near = occupancy_of(folder, CloudSettings(every=1, voxel_m=CELL_M, max_range_m=5))
    north_m = STEP_M * (FRAMES - 1)
    assert label(near, 0.2, north_m + 4.1) == FREE
    assert label(near, 0.2, north_m + 6) == UNKNOWN
    assert volumes_m3(near)[0] == 0


def test_what_lies_beside_a_barrels_picture_stays_unknown(tmp_path):
    """Its polynomial folds back at 49 degrees: cells 59 degrees aside were free, as what lies near the axis is."""
    barrel = Camera(WIDTH, HEIGHT, 75, 75, 47.5, 31.5, (-0.25, 0, 0, 0))
    folder = write_flown(tmp_path / "out", camera=barrel, poses=[pose(i, 0.0) for i in range(FRAMES)])
    tree = occupancy_of(folder, SETTINGS)
    assert label(tree, 0.2, 6.2, 0.2) == FREE
    assert label(tree, 6.2 * np.tan(np.radians(59)), 6.2, 0.2) == UNKNOWN


def test_a_flight_that_an_octomap_cannot_hold_is_refused(tmp_path):
    """OctoMap left out what lies farther than 32,768 cells from its origin, without a word."""
    folder = write_flown(tmp_path / "out", poses=[pose(i, 700.0 * (i > 5)) for i in range(FRAMES)])
    with pytest.raises(BadInput, match="--voxel: expected larger cells, got a flight that leaves 655 m"):
        occupancy_of(folder, CloudSettings(every=4, voxel_m=0.02, max_range_m=0.2))


def test_a_camera_that_looks_east_frees_the_east(tmp_path):
    poses = [pose(i, STEP_M * i) for i in range(FRAMES)]
    for each in poses:
        object.__setattr__(each, "world_from_camera", LOOKING_EAST)
    tree = occupancy_of(write_flown(tmp_path / "out", poses=poses), SETTINGS)
    assert label(tree, 5, 2.2) == FREE
    assert label(tree, 0.2, 12) == UNKNOWN


class Maps:
    """A frame's maps, as a FlightFolder has them."""

    def __init__(self, depth_m, sigma_m=None, farther_than_m=None, confidence=0.8) -> None:
        shape = HEIGHT, WIDTH
        self.depth_m = known(depth_m).depth_m
        self._sigma_m = None if sigma_m is None else np.full(shape, sigma_m, np.float32)
        self._farther_than_m = farther_than_m
        self._confidence = np.where(np.isfinite(self.depth_m), np.float32(confidence), np.float32(0))

    def sigma_m(self, _):
        return self._sigma_m

    def farther_than_m(self, _):
        return self._farther_than_m

    def confidence(self, _):
        return self._confidence


def half(left, right):
    return np.where(np.arange(WIDTH) < WIDTH // 2, np.float32(left), np.float32(right)) * np.ones(
        (HEIGHT, 1), np.float32
    )


@pytest.mark.parametrize(
    ("maps", "reach_m"),
    [
        (Maps(10.0, sigma_m=0.5), 9.0),
        (Maps(10.0), 8.0),
        (Maps(10.0, sigma_m=6.0), 0.0),  # less than nothing
        (Maps(10.0, sigma_m=0.5, confidence=0.5), 0.0),
        (Maps(np.nan), 0.0),
        (Maps(np.nan, farther_than_m=half(300, 300)), 300.0),
        (Maps(np.nan, farther_than_m=half(np.nan, np.nan)), 0.0),
    ],
)
def test_how_far_a_pixel_looks_past_nothing(maps, reach_m):
    assert free_to(maps, 0, maps.depth_m, SETTINGS) == pytest.approx(np.full((HEIGHT, WIDTH), reach_m))


def test_beside_something_near_space_is_free_no_farther(folder):
    """What is thin may have no pixel of its own in a network's map."""
    maps = Maps(half(5, 20), sigma_m=0.0)
    reach_m = free_to(maps, 0, maps.depth_m, SETTINGS)[0]
    assert reach_m[WIDTH // 2] == 5
    assert reach_m[WIDTH // 2 + 2] == 20
