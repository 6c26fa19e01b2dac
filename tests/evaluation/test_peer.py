from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane_pairs import plane_pair

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.peer import BLIND_PX, ClassicalPeer, best_constant_m
from flightdepth.triangulation import inverse_depth

CAMERA = Camera.from_fov(192, 128, 70)
BLACK = np.zeros((128, 192, 3), np.uint8)
LATERAL, FORWARD, MIXED = (0.6, 0.0, 0.0), (0.0, 0.0, 0.8), (-0.3, 0.2, 0.5)


@pytest.mark.parametrize(
    ("displacement", "tilt"),
    [(LATERAL, 0.0), (LATERAL, 0.4), (FORWARD, 0.0), (FORWARD, 0.4), (MIXED, 0.3)],
    ids=["lateral", "lateral tilted", "forward", "forward tilted", "mixed tilted"],
)
def test_a_textured_plane_is_found(displacement: tuple[float, float, float], tilt: float) -> None:
    pair = plane_pair(CAMERA, displacement, tilt=tilt)
    depth_m = ClassicalPeer(0, 100).depth(pair.previous, pair.current, displacement, CAMERA)
    relative = np.abs(depth_m / pair.depth_m - 1)[8:-8, 16:-16]
    assert np.median(relative) < 0.02
    assert np.mean(relative < 0.1) > 0.85


def test_the_wrong_direction_is_the_largest_depth() -> None:
    pair = plane_pair(CAMERA, LATERAL)
    depth_m = ClassicalPeer(0, 60).depth(pair.current, pair.previous, LATERAL, CAMERA)
    assert np.median(depth_m) == 60


def test_depth_is_clipped_to_the_networks_range() -> None:
    pair = plane_pair(CAMERA, LATERAL, distance_m=5)
    depth_m = ClassicalPeer(10, 60).depth(pair.previous, pair.current, LATERAL, CAMERA)
    assert depth_m.min() == 10
    assert depth_m.dtype == np.float32


def test_next_to_the_focus_of_expansion_stands_the_median() -> None:
    pair = plane_pair(CAMERA, FORWARD)
    depth_m = ClassicalPeer(0, 100).depth(pair.previous, pair.current, FORWARD, CAMERA)
    leverage_px = inverse_depth(np.zeros((128, 192, 2), np.float32), FORWARD, CAMERA)[1]
    centre = leverage_px < 0.8 * BLIND_PX * 10
    assert centre.any()
    assert set(depth_m[centre]) == {depth_m[64, 96]}
    assert depth_m[64, 96] == pytest.approx(10, rel=0.02)


def test_that_median_is_the_one_of_all_other_pixels() -> None:
    pair = plane_pair(CAMERA, FORWARD, tilt=0.9)
    depth_m = ClassicalPeer(0, 100).depth(pair.previous, pair.current, FORWARD, CAMERA)
    blind = inverse_depth(np.zeros((128, 192, 2), np.float32), FORWARD, CAMERA)[1] < BLIND_PX * 10
    others = depth_m[~blind]
    assert set(depth_m[blind]) == {np.median(others)}
    assert abs(others.mean() / np.median(others) - 1) > 0.01


def test_without_a_displacement_nothing_is_known() -> None:
    pair = plane_pair(CAMERA, LATERAL)
    depth_m = ClassicalPeer(0, 100).depth(pair.previous, pair.current, (0.0, 0.0, 0.0), CAMERA)
    assert np.isnan(depth_m).all()


def test_a_distorted_camera_is_refused() -> None:
    camera = Camera(192, 128, 140.0, 140.0, 95.5, 63.5, (0.1, 0.0, 0.0, 0.0))
    with pytest.raises(BadInput, match="distorted"):
        ClassicalPeer(0, 100).depth(BLACK, BLACK, LATERAL, camera)


@given(values=st.lists(st.floats(1, 100, width=32), min_size=1, max_size=30), other=st.floats(1, 100))
def test_no_constant_is_better_than_the_best(values: list[float], other: float) -> None:
    truth = np.array([values], np.float32)
    best = np.abs(truth.astype(np.float64) - best_constant_m([truth])).mean()
    assert best <= np.abs(truth.astype(np.float64) - other).mean() + 1e-5


def test_the_best_constant_does_not_count_what_is_unknown() -> None:
    assert best_constant_m([np.array([[1, np.nan, 3]], np.float32), np.array([[2.0]], np.float32)]) == 2


def test_the_best_constant_of_nothing_is_nan() -> None:
    assert np.isnan(best_constant_m([]))
