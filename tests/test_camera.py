"""Laws of the camera model; OpenCV is the oracle for what falls on which pixel."""

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightdepth.camera import Camera, fisheye_angle_rad
from flightdepth.errors import BadInput
from flightdepth.runtimes.lens import distort, undistort

BENT = (-0.28, 0.09, 0.011, -0.007, 0.02, 0.01, -0.02, 0.003, 0.004, -0.001, 0.002, 0.0005)
CAMERAS = [
    Camera(640, 360, 450.0, 440.0, 322.0, 178.0),
    *(Camera(640, 360, 450.0, 440.0, 322.0, 178.0, BENT[:count]) for count in (4, 5, 8, 12)),
    Camera(640, 360, 450.0, 440.0, 322.0, 178.0, (*BENT, 0.0, 0.0)),
    Camera(640, 360, 450.0, 440.0, 322.0, 178.0, (*BENT, 0.02, -0.03)),
    Camera(640, 360, 300.0, 295.0, 322.0, 178.0, (), "fisheye"),
    Camera(640, 360, 300.0, 295.0, 322.0, 178.0, (0.03, 0.07, -0.07, 0.03), "fisheye"),
]
NAMES = [f"{camera.model} {len(camera.distortion)}" for camera in CAMERAS]
TURNABLE = [camera for camera in CAMERAS if not any(camera.distortion[12:])]


def lattice(camera):
    columns, rows = np.meshgrid(np.linspace(40, camera.width - 41, 9), np.linspace(40, camera.height - 41, 7))
    return np.stack([columns, rows], -1)


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_a_pixel_comes_back_from_its_ray(camera):
    pixels = lattice(camera)
    assert np.abs(distort(undistort(pixels, camera), camera) - pixels).max() < 0.01


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12, 14])
def test_a_pinhole_without_distortion_needs_no_opencv(count, monkeypatch):
    """More than half of `convert`'s time went into the distortion of a lens that has none."""
    camera = Camera(640, 360, 450.0, 440.0, 322.0, 178.0, count * (0.0,))
    rays = np.random.default_rng(0).normal(size=(30, 20, 2)) * np.logspace(-6, 3, 20)[:, None]
    points = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1).reshape(-1, 3)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, None)
    monkeypatch.setattr(cv2, "projectPoints", None)
    assert np.abs(distort(rays, camera) - expected.reshape(rays.shape)).max() < 1e-9


@pytest.mark.parametrize("camera", TURNABLE, ids=lambda camera: f"{camera.model} {len(camera.distortion)}")
@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_camera_sees_each_ray_on_the_turned_pixel(camera, turns):
    rng = np.random.default_rng(turns)
    rays = rng.uniform(-0.5, 0.5, (40, 2))
    x, y = distort(rays, camera).T
    width, height = camera.width, camera.height
    for _ in range(turns):  # numpy.rot90: the last column becomes the first row
        x, y, width, height = y, width - 1 - x, height, width
        rays = np.stack([rays[:, 1], -rays[:, 0]], -1)
    turned = camera.turned(turns)
    assert (turned.width, turned.height) == (width, height)
    assert np.abs(distort(rays, turned) - np.stack([x, y], -1)).max() < 1e-9


@pytest.mark.parametrize("camera", TURNABLE, ids=lambda camera: f"{camera.model} {len(camera.distortion)}")
def test_four_quarter_turns_are_none(camera):
    back = camera.turned(1).turned(1).turned(1).turned(1)
    assert np.allclose([back.cx, back.cy, *back.distortion], [camera.cx, camera.cy, *camera.distortion])


def test_a_tilted_sensor_cannot_be_turned():
    with pytest.raises(BadInput, match="tilted sensor"):
        CAMERAS[6].turned(1)


@given(st.floats(10, 170), st.sampled_from(["pinhole", "fisheye"]))
@settings(max_examples=40, deadline=None)
def test_the_field_of_view_comes_back(fov_deg, model):
    camera = Camera.from_fov(640, 360, fov_deg, model=model)
    assert camera.horizontal_fov_deg == pytest.approx(fov_deg, abs=0.02)
    # By hand: the right edge lies half the angle off the axis, along OpenCV's own model.
    edge = distort(np.array([[math.tan(math.radians(min(fov_deg, 160)) / 2), 0.0]]), camera)[0, 0]
    if fov_deg < 160:
        assert edge == pytest.approx(camera.width - 0.5, abs=1e-3)


@given(st.floats(0.01, 1.2), st.floats(-0.05, 0.1), st.floats(-0.02, 0.05))
@settings(max_examples=60, deadline=None)
def test_the_angle_of_a_fisheye_inverts_its_polynomial(theta, k1, k2):
    radius = theta * (1 + k1 * theta**2 + k2 * theta**4)
    assert fisheye_angle_rad(radius, (k1, k2, 0.0, 0.0)) == pytest.approx(theta, abs=1e-4)


def test_a_fisheye_may_see_more_than_half_the_world():
    assert Camera.from_fov(800, 800, 186, model="fisheye").horizontal_fov_deg == pytest.approx(186, abs=0.1)
    with pytest.raises(BadInput, match="less than 180"):
        Camera.from_fov(800, 800, 186)


def test_the_rays_of_a_fisheye_are_not_those_of_a_pinhole():
    with pytest.raises(BadInput, match="distorted"):
        Camera.from_fov(64, 64, 90, model="fisheye").rays()


@pytest.mark.parametrize("shape", [(5,), (1, 5), (5, 1)])
def test_what_opencv_tells_makes_a_camera(shape):
    """Found in review: float sizes, as of VideoCapture, and arrays were taken, and broke the first picture."""
    plain = Camera(640, 480, 450.0, 440.0, 322.0, 238.0, BENT[:5])
    camera = Camera(640.0, 480.0, 450.0, 440.0, 322.0, 238.0, np.reshape(BENT[:5], shape))
    assert camera == plain and hash(camera) == hash(plain)
    assert isinstance(camera.width, int) and isinstance(camera.height, int)


@pytest.mark.parametrize("width", [320.5, float("nan"), float("inf"), 0])
def test_a_size_is_whole_pixels(width):
    with pytest.raises(BadInput, match="camera size: expected whole pixels"):
        Camera.from_fov(width, 240, 70)


def test_zooming_narrows_the_view_and_moves_nothing_else():
    camera = Camera.from_fov(640, 360, 90)
    zoomed = camera.zoomed(2.0)
    assert zoomed.horizontal_fov_deg == pytest.approx(np.degrees(2 * np.arctan(0.5)))
    assert zoomed.zoomed(0.5) == camera


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fx": 0.0}, "camera focal length: expected a positive number of pixels, got fx=0.0, fy=440.0"),
        ({"fx": math.inf}, "got fx=inf, fy=440.0"),
        ({"fy": -440.0}, "got fx=450.0, fy=-440.0"),
        ({"fy": math.inf}, "got fx=450.0, fy=inf"),
        ({"cx": math.nan}, "camera principal point: expected finite pixels, got nan, 178.0"),
        ({"cy": math.inf}, "got 322.0, inf"),
        ({"model": "omni"}, "camera model: expected pinhole or fisheye, got 'omni'"),
        (
            {"distortion": (0.1,) * 3},
            "pinhole distortion: expected 0 or 4 or 5 or 8 or 12 or 14 coefficients, got 3",
        ),
        (
            {"model": "fisheye", "distortion": (0.1,) * 5},
            "fisheye distortion: expected 0 or 4 coefficients, got 5",
        ),
    ],
)
def test_what_is_no_lens_is_refused(changes, message):
    with pytest.raises(BadInput, match=re.escape(message)):
        replace(CAMERAS[0], **changes)


@pytest.mark.parametrize(
    ("fov_deg", "model"), [(0, "pinhole"), (180, "pinhole"), (math.nan, "pinhole"), (360, "fisheye")]
)
def test_a_field_of_view_that_is_none_is_refused(fov_deg, model):
    with pytest.raises(BadInput, match="horizontal field of view: expected more than 0 and less than"):
        Camera.from_fov(640, 360, fov_deg, model=model)


def test_the_field_of_view_of_a_lens_that_is_not_in_the_middle():
    """20 pixels of 50 px of focal length to the left edge, 80 to the right one."""
    camera = Camera(100, 50, 50.0, 50.0, 19.5, 24.5)
    degrees = math.degrees(math.atan(20 / 50) + math.atan(80 / 50))
    assert camera.horizontal_fov_deg == pytest.approx(degrees)
    fisheye = replace(camera, model="fisheye")
    assert fisheye.horizontal_fov_deg == pytest.approx(math.degrees(20 / 50 + 80 / 50), abs=1e-3)
