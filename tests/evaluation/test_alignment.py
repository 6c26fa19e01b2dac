"""Depth aligned with the pictures, on planes whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from plane_pairs import plane_pair

from flightdepth.camera import Camera
from flightdepth.runtimes import alignment
from flightdepth.runtimes.alignment import align, clues_of
from flightdepth.runtimes.left_rotation import mended_depth, rotated_flow
from flightdepth.runtimes.network import Network, load_network
from flightdepth.triangulation import flow_of_depth
from tests_networks import swept_card

SQUARE = Camera(128, 128, 64.0, 64.0, 63.5, 63.5)
MIDDLE = (slice(4, 28), slice(8, 24))
BLANK = np.full((128, 128, 3), 90, np.uint8)


class Wrong:
    """A MotionNet that knows a plane's distance but for a factor, and doubts it."""

    description = "made by hand"
    architecture = "MotionNet"

    def __init__(self, distances: float, factor: float) -> None:
        self.depth_m = distances * 0.3 * factor  # at D0

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        n, height, width = inputs["current"].shape[:3]
        depth_m = np.full((n, height // 4, width // 4), self.depth_m, np.float32)
        return {"depth_m": depth_m, "sigma_m": 0.15 * depth_m}


def network(distances: float, factor: float, **options: bool) -> Network:
    """For planes that many displacements away."""
    return Network(swept_card(), Wrong(distances, factor), **options)


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("moved", [(1.0, 0.0, 0.0), (0.6, 0.3, 0.5), (-0.5, 0.8, -0.2)])
def test_a_depth_that_is_a_fourth_wrong_is_nearly_right_after_it(
    moved: tuple[float, float, float], factor: float
) -> None:
    pair = plane_pair(SQUARE, moved, distance_m=6.0)
    found = network(6.0 / np.linalg.norm(moved), factor).predict(
        [pair.previous], pair.current, [moved], SQUARE
    )
    assert found.sigma_m is not None
    relative = found.depth_m[0] / 6.0 - 1
    assert np.median(np.abs(relative[MIDDLE])) < 0.083
    assert np.median(found.sigma_m[0][MIDDLE]) < 0.2 * 6 * factor  # where the network says 0.15


def test_without_it_the_output_is_the_networks() -> None:
    pair = plane_pair(SQUARE, (1.0, 0.0, 0.0), distance_m=6.0)
    found = network(6.0, 1.25, aligned=False).predict([pair.previous], pair.current, [[1.0, 0, 0]], SQUARE)
    np.testing.assert_allclose(found.depth_m, 7.5, rtol=1e-5)


def test_pictures_without_texture_change_little() -> None:
    """Flow stands still there, as if all were far away."""
    found = network(6.0, 1.25).predict([BLANK], BLANK, [[1.0, 0, 0]], SQUARE)
    np.testing.assert_allclose(found.depth_m, 7.5, rtol=0.15)


def test_each_pair_of_a_batch_is_aligned_by_itself() -> None:
    near, far = (plane_pair(SQUARE, (size, 0.0, 0.0), distance_m=6.0) for size in (1.0, 0.5))
    moves = [[1.0, 0, 0], [0.5, 0, 0]]
    np.testing.assert_array_equal(near.current, far.current)
    both = network(6.0, 1.25).predict([near.previous, far.previous], near.current, moves, SQUARE)
    for i, pair in enumerate((near, far)):
        alone = network(6.0, 1.25).predict([pair.previous], pair.current, moves[i : i + 1], SQUARE)
        np.testing.assert_array_equal(both.depth_m[i], alone.depth_m[0])


def test_a_pair_that_did_not_move_knows_nothing_and_spoils_nothing() -> None:
    pair = plane_pair(SQUARE, (1.0, 0.0, 0.0), distance_m=6.0)
    found = network(6.0, 1.25).predict(
        [BLANK, pair.previous], pair.current, [[0.0, 0, 0], [1.0, 0, 0]], SQUARE
    )
    assert np.isnan(found.depth_m[0]).all()
    assert np.median(np.abs(found.depth_m[1] / 6.0 - 1)[MIDDLE]) < 0.03


def test_the_shipped_network_is_nearer_the_truth_for_it() -> None:
    camera = Camera.from_fov(256, 192, 70)
    pair = plane_pair(camera, (0.6, 0.24, 0.36), distance_m=4.0, tilt=0.3)  # points move by 30 pixels
    truth = pair.depth_m
    errors, shipped = [], load_network("motion", "openvino", precision="f32")
    for aligned in (False, True):
        asked = Network(shipped.card, shipped.runtime, aligned=aligned)
        depth_m = asked.depth(pair.previous, pair.current, pair.displacement, camera)
        errors.append(np.median(np.abs(depth_m / truth - 1)[20:-20, 20:-20]))
    assert errors[1] < 0.01
    assert errors[1] < 0.5 * errors[0]


def test_what_the_judge_is_told_of_a_plane() -> None:
    pair = plane_pair(SQUARE, (1.0, 0.0, 0.0), distance_m=6.0)
    grey = pair.previous[..., 0].copy(), pair.current[..., 0].copy()
    depth, sigma = np.full((32, 32), 6.6, np.float32), np.full((32, 32), 0.1, np.float32)
    clues, _ = clues_of(*grey, depth, sigma, np.array([1.0, 0, 0]), camera=SQUARE)
    ratio, doubt, moved, off, rough, gradient, held = (np.median(clue[MIDDLE]) for clue in clues)
    assert ratio == pytest.approx(np.log(1.1), abs=0.01)
    assert doubt == pytest.approx(np.log(0.1))
    assert moved == pytest.approx(np.log(64 / 6.6), abs=1e-3)
    assert off < 0.1 and rough < 0.5
    assert gradient > 1
    assert held == 1
    assert not clues[-1][:, -1].any()  # 10 px to the right: the last two columns were outside
    assert not clues[0][:, -1].any()  # and of them flow knows nothing


@pytest.mark.parametrize(
    ("direction", "change"), [([1.0, 0, 0], 1.0), ([0.6, 0.8, 0], 1.96), ([0.6, -0.8, 0], 0.04)]
)
def test_the_judge_is_told_the_change_of_grey_along_the_line(direction: list[float], change: float) -> None:
    """A level a pixel to the right, and one down; squared."""
    slope = np.add.outer(np.arange(128), np.arange(128)).astype(np.uint8)
    depth, sigma = np.full((32, 32), 6.6, np.float32), np.full((32, 32), 0.1, np.float32)
    clues, _ = clues_of(slope, slope, depth, sigma, np.array(direction), camera=SQUARE)
    assert clues[5][MIDDLE] == pytest.approx(np.log1p(change), abs=1e-4)


def test_an_aligned_depth_stays_within_the_network_s_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """60 of 100 m, and a judge who says e times as far: that is the upper end, which fusion takes for a bound."""
    says = np.stack([np.full((32, 32), 1.0, np.float32), np.full((32, 32), 0.1, np.float32)])
    monkeypatch.setattr(alignment, "judge", lambda: lambda _: says)
    found = network(200.0, 1.0).predict([BLANK], BLANK, [[1.0, 0, 0]], SQUARE)
    assert found.beta == pytest.approx(1.0)
    assert found.depth_m == pytest.approx(100 / 0.3, rel=1e-5)


def test_an_aligned_depth_is_no_nearer_than_the_network_s_range(monkeypatch: pytest.MonkeyPatch) -> None:
    says = np.stack([np.full((32, 32), -3.0, np.float32), np.full((32, 32), 0.1, np.float32)])
    monkeypatch.setattr(alignment, "judge", lambda: lambda _: says)
    depth_m = np.full((1, 32, 32), 20.0, np.float32)
    output = {"depth_m": depth_m, "sigma_m": 0.15 * depth_m}
    card = swept_card().model_copy(update={"depth_min_m": 10.0})
    align(card, output, [BLANK], BLANK, np.array([[1.0, 0, 0]]), camera=SQUARE)
    assert (output["depth_m"] == 10).all()


def test_a_depth_is_aligned_through_another_lens_than_the_card_s() -> None:
    """Twice the focal length, at which an output is worth another depth; one that is a fourth wrong is mended."""
    camera, card = SQUARE.zoomed(2.0), swept_card()
    pair = plane_pair(camera, (1.0, 0.0, 0.0), distance_m=6.0)
    worth = card.at_focal(128.0).alpha / card.depth_max_m
    depth_m = np.full((1, 32, 32), 1.25 * 6.0 / worth, np.float32)
    output = {"depth_m": depth_m, "sigma_m": 0.15 * depth_m}
    align(card, output, [pair.previous], pair.current, pair.displacement[None], camera=camera)
    assert np.median(output["depth_m"][0][MIDDLE]) * worth == pytest.approx(6.0, rel=0.08)


def test_the_judge_is_told_how_far_the_flow_left_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two pixels, which no rotation made."""
    monkeypatch.setattr(alignment, "left_rotation", lambda *_: None)
    pair = plane_pair(SQUARE, (1.0, 0.0, 0.0), distance_m=6.0)
    previous, current = np.roll(pair.previous[..., 0], 2, axis=0), pair.current[..., 0].copy()
    depth, sigma = np.full((32, 32), 6.0, np.float32), np.full((32, 32), 0.1, np.float32)
    clues, _ = clues_of(previous, current, depth, sigma, np.array([1.0, 0, 0]), camera=SQUARE)
    assert np.median(clues[3][MIDDLE]) == pytest.approx(np.log1p(3 * 2), abs=0.05)


# What the judge is told, of a flow that is given


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """Flow is what it starts from, times and plus what stands here; no rotation is left."""
    change = [np.float32(1), np.zeros((128, 128, 2), np.float32)]

    class Given:
        def calc(self, current: np.ndarray, previous: np.ndarray, start: np.ndarray) -> np.ndarray:
            return start * change[0] + change[1]

    monkeypatch.setattr(alignment, "_FLOW", SimpleNamespace(dis=Given()))
    monkeypatch.setattr(alignment, "left_rotation", lambda *_: None)
    return change


def clues_along_x(depth: float = 6.0, sigma: float = 0.1) -> np.ndarray:
    maps = (np.full((32, 32), value, np.float32) for value in (depth, sigma))
    return clues_of(BLANK[..., 0], BLANK[..., 0], *maps, np.array([1.0, 0, 0]), camera=SQUARE)[0]


def test_flow_starts_from_where_the_network_says_that_points_were(flown: list[np.ndarray]) -> None:
    ratio, *_ = clues_along_x()
    assert ratio[MIDDLE] == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize(("times", "ratio"), [(1.5, np.log(1.5)), (20, 2), (0.01, -2)])
def test_the_judge_is_told_of_no_more_than_e_squared_times_another_depth(
    flown: list[np.ndarray], times: float, ratio: float
) -> None:
    flown[0] = np.float32(times)
    assert clues_along_x(depth=60.0)[0][:, :10] == pytest.approx(ratio, abs=1e-4)


def test_the_judge_is_told_how_rough_the_flow_is_within_a_block(flown: list[np.ndarray]) -> None:
    """Pixels beside each other two pixels to the left and to the right of the mean."""
    flown[1][..., 0] = np.where(np.indices((128, 128)).sum(0) % 2, 2, -2)
    ratio, _, _, off, rough, *_ = clues_along_x()
    assert rough[MIDDLE] == pytest.approx(np.log1p(3 * 2), abs=1e-4)
    assert (ratio[MIDDLE], off[MIDDLE]) == (pytest.approx(0, abs=1e-5), pytest.approx(0, abs=1e-4))


def test_the_judge_is_told_of_no_smaller_doubt_and_shift_than_count(flown: list[np.ndarray]) -> None:
    _, doubt, moved, *_ = clues_along_x(depth=1e6, sigma=1e-6)
    assert (doubt[5, 5], moved[5, 5]) == (pytest.approx(np.log(0.005)), pytest.approx(np.log(0.05)))


@pytest.mark.parametrize(
    ("moved", "block", "held"),
    [
        ((1.51, 0), (5, -1), 0),
        ((1.51, 0), (5, 0), 1),
        ((-1.51, 0), (5, 0), 0),
        ((0, 1.51), (-1, 5), 0),
        ((0, 1.51), (0, 5), 1),
        ((0, -1.51), (0, 5), 0),
        ((1.49, 1.49), (-1, -1), 1),
        ((-1.49, -1.49), (0, 0), 1),
    ],
)
def test_the_earlier_picture_holds_a_block_whose_middle_is_in_it(
    flown: list[np.ndarray], moved: tuple[float, float], block: tuple[int, int], held: float
) -> None:
    """The middle of the outermost blocks is 1.5 pixels from that of the outermost pixels."""
    flown[0], flown[1][:] = np.float32(0), moved
    assert clues_along_x()[-1][block] == held


@pytest.mark.parametrize(
    ("direction", "change"), [([1.0, 0, 0], 1.0), ([0.6, 0.8, 0], 0.04), ([0.6, -0.8, 0], 1.96)]
)
def test_contrast_across_the_line_tells_of_rotation(
    flown: list[np.ndarray], monkeypatch: pytest.MonkeyPatch, direction: list[float], change: float
) -> None:
    """A level a pixel to the right, and one down; squared."""
    told = []
    monkeypatch.setattr(alignment, "left_rotation", lambda _, contrast, *__: told.append(contrast))
    slope = np.add.outer(np.arange(128), np.arange(128)).astype(np.uint8)
    maps = np.full((32, 32), 6.0, np.float32), np.full((32, 32), 0.1, np.float32)
    clues_of(slope, slope, *maps, np.array(direction), camera=SQUARE)
    assert told[0][MIDDLE] == pytest.approx(change, abs=1e-4)


def test_a_rotation_is_taken_out_of_the_flow_and_of_the_depth(
    flown: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flow that a turn made is none, and the network's depth is what it would have said without."""
    turn, way = np.array([0.0, 0.01, 0.0]), np.array([1.0, 0, 0])
    depth = np.full((32, 32), 6.0, np.float32)
    start = flow_of_depth(depth, way, SQUARE.resized(32, 32)) * 4
    made = rotated_flow((start * 0).astype(np.float32), turn, SQUARE)
    flown[1] = cv2.resize(made, (128, 128))
    clues = []
    for rotation in (None, turn):
        monkeypatch.setattr(alignment, "left_rotation", lambda *_, rotation=rotation: rotation)
        clues.append(clues_of(BLANK[..., 0], BLANK[..., 0], depth, 0.1 + 0 * depth, way, camera=SQUARE))
    mended = mended_depth(depth, turn, way, SQUARE)
    np.testing.assert_allclose(clues[1][1], mended)
    assert np.abs(np.log(mended / depth)).min() > 0.05
    shifts = [np.exp(told[0][MIDDLE]) / depth_then[MIDDLE] for told, depth_then in clues]
    assert np.median(shifts[1]) == pytest.approx(1 / 6, rel=0.01)
    assert abs(np.median(shifts[0]) * 6 - 1) > 0.05


def test_the_error_bar_is_the_judge_s_share_of_the_aligned_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    says = np.stack([np.full((32, 32), value, np.float32) for value in (0.5, 0.1)])
    monkeypatch.setattr(alignment, "judge", lambda: lambda _: says)
    depth_m = np.full((1, 32, 32), 20.0, np.float32)
    output = {"depth_m": depth_m, "sigma_m": 0.15 * depth_m}
    align(swept_card(), output, [BLANK], BLANK, np.array([[1.0, 0, 0]]), camera=SQUARE)
    assert output["depth_m"] == pytest.approx(20 * np.exp(0.5), rel=1e-4)
    assert output["sigma_m"] == pytest.approx(2 * np.exp(0.5), rel=1e-4)
