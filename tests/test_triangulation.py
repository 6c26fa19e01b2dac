"""Flow and depth, against points moved by hand."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flightdepth.camera import Camera
from flightdepth.triangulation import flow_of_depth, inverse_depth

OBLONG = Camera(192, 128, 140.0, 110.0, 90.0, 66.0)

metres = st.floats(-1, 1)


def true_flow(camera: Camera, depth_m: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Flow from current to previous [H, W, 2] of points that moved by `displacement`."""
    points = camera.rays() * depth_m[..., None] + displacement
    pixels = points[..., :2] / points[..., 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return pixels - np.stack([columns, rows], axis=-1)


@given(x=metres, y=metres, z=metres, seed=st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_exact_flow_gives_exact_depth(x: float, y: float, z: float, seed: int) -> None:
    depth_m = np.random.default_rng(seed).uniform(3, 50, (OBLONG.height, OBLONG.width))
    displacement = np.array([x, y, z])
    flow = true_flow(OBLONG, depth_m, displacement)
    inverse, leverage_px = inverse_depth(flow, displacement, OBLONG)
    able = leverage_px > 1e-3
    assert np.abs(inverse * depth_m - 1)[able].max(initial=0) < 1e-6


@given(scale=st.floats(0.01, 100))
@settings(max_examples=20, deadline=None)
def test_depth_scales_with_the_displacement(scale: float) -> None:
    flow = np.random.default_rng(0).normal(size=(OBLONG.height, OBLONG.width, 2))
    once, _ = inverse_depth(flow, np.array([0.5, 0.1, 0.3]), OBLONG)
    scaled, _ = inverse_depth(flow, np.array([0.5, 0.1, 0.3]) * scale, OBLONG)
    assert np.allclose(scaled * scale, once, rtol=1e-9)


@given(x=metres, y=metres, z=metres, seed=st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_depth_gives_the_flow_of_points_that_moved(x: float, y: float, z: float, seed: int) -> None:
    depth_m = np.random.default_rng(seed).uniform(3, 50, (OBLONG.height, OBLONG.width))
    flow = flow_of_depth(depth_m, (x, y, z), OBLONG)
    assert np.allclose(flow, true_flow(OBLONG, depth_m, np.array([x, y, z])), atol=1e-9)


def test_a_point_that_the_camera_flew_past_keeps_a_finite_flow() -> None:
    """The displacement is where the earlier camera's points went: -5 m along the axis is a flight backwards."""
    flow = flow_of_depth(np.full((OBLONG.height, OBLONG.width), 2.0), (0.1, 0.0, -5.0), OBLONG)
    assert np.isfinite(flow).all()


def test_such_a_point_is_told_beyond_the_edge_that_it_left_by() -> None:
    """It was ahead of the earlier camera by nothing; mirrored, it would have come from the other side."""
    flow = flow_of_depth(np.full((OBLONG.height, OBLONG.width), 2.0), (0.0, 0.0, -5.0), OBLONG)
    assert np.array_equal(np.sign(flow), np.sign(OBLONG.rays()[..., :2]))
