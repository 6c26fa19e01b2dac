import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.motion import rotation_from_euler
from flightdepth.ranges.turning import homography, in_view, is_visible, turned

CAMERA = Camera.from_fov(128, 128, 90)


def smooth(camera: Camera, rotation: np.ndarray) -> np.ndarray:
    """A smooth pattern on the sphere, as a camera of that orientation sees it."""
    rays = camera.rays() @ rotation.T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.clip(128 + 100 * np.sin(4 * rays), 0, 255).astype(np.uint8)


def everywhere(size: int) -> np.ndarray:
    return np.ones((size, size), dtype=np.bool_)


@pytest.mark.parametrize("angles", [(0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.3), (0.05, -0.08, 0.1)])
def test_a_turned_picture_is_what_the_current_camera_sees(angles: tuple[float, float, float]) -> None:
    previous = rotation_from_euler(*angles)
    warped = turned(smooth(CAMERA, previous), previous, CAMERA)
    truth = smooth(CAMERA, np.eye(3))
    seen = in_view(previous, CAMERA, everywhere(128))
    assert 0.5 < seen.mean() < 1
    assert np.abs(warped.astype(int) - truth.astype(int))[seen].max() <= 3


def test_turned_levels_stay_between_whole_ones_and_within_black_and_white() -> None:
    previous = rotation_from_euler(0.05, -0.08, 0.1)
    levels = smooth(CAMERA, previous).astype(np.float32)
    levels[::7] = 255  # stripes, beside which cubic interpolation overshoots
    found = turned(levels, previous, CAMERA)
    assert found.dtype == np.float32
    assert found.min() >= 0 and found.max() <= 255
    assert np.abs(found - np.rint(found)).mean() > 0.2
    assert np.abs(found - turned(levels.astype(np.uint8), previous, CAMERA)).mean() < 0.3


def test_no_turn_changes_nothing() -> None:
    image = smooth(CAMERA, np.eye(3))
    np.testing.assert_array_equal(turned(image, np.eye(3), CAMERA), image)
    assert in_view(np.eye(3), CAMERA, everywhere(32)).all()


def test_a_turn_and_its_inverse_cancel() -> None:
    turn = rotation_from_euler(0.1, 0.2, -0.3)
    both = homography(turn, CAMERA) @ homography(turn.T, CAMERA)
    np.testing.assert_allclose(both / both[2, 2], np.eye(3), atol=1e-9)


def test_what_lies_behind_is_not_in_view() -> None:
    assert not in_view(rotation_from_euler(0, np.pi, 0), CAMERA, everywhere(32)).any()


def test_what_was_padding_before_is_not_in_view() -> None:
    """The right quarter of the pictures is padding: half of the focal length off the middle and beyond."""
    valid = everywhere(32)
    valid[:, 24:] = False
    np.testing.assert_array_equal(in_view(np.eye(3), CAMERA, valid), valid)
    seen = in_view(rotation_from_euler(0, -np.arctan(0.5), 0), CAMERA, valid)
    assert seen[16, :16].all() and not seen[16, 16:].any()


@pytest.mark.parametrize(("angle_rad", "visible"), [(0.001, False), (0.01, True)])
def test_a_quarter_pixel_is_visible(angle_rad: float, visible: bool) -> None:
    assert is_visible(angle_rad, CAMERA) is visible


@pytest.mark.parametrize(
    ("fov_deg", "angle_rad", "visible"),
    [(10, 0.0003, True), (90, 0.0003, False), (140, 0.003, True), (140, 0.001, False)],
)
def test_a_turn_is_seen_in_the_middle_through_a_long_lens_and_at_the_edge_through_a_wide_one(
    fov_deg: float, angle_rad: float, visible: bool
) -> None:
    """Focal lengths of 731, 64 and 23 px; half of the width is 64."""
    assert is_visible(angle_rad, Camera.from_fov(128, 128, fov_deg)) is visible
