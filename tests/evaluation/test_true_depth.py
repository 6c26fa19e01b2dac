"""True depth of frames: units, sky, rays, sizes, and which file is whose."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.true_depth import TrueDepth, at_centres, lengths_of_rays, matched, truth_files

CAMERA = Camera(64, 48, 50.0, 40.0, 30.0, 25.0)
INF, NAN = np.inf, np.nan


def truth(folder: Path, stored: np.ndarray, **options: object) -> np.ndarray:
    np.save(folder / "7.npy", stored)
    return TrueDepth(truth_files(folder), **options).at(7, Camera.from_fov(4, 2, 90))


def test_whole_numbers_are_centimetres_of_which_the_last_is_sky(tmp_path: Path) -> None:
    stored = np.array([[0, 1, 100, 250], [65534, 65535, 9, 9]], np.uint16)
    expected = [[NAN, 0.01, 1, 2.5], [655.34, INF, 0.09, 0.09]]
    np.testing.assert_allclose(truth(tmp_path, stored), expected, rtol=1e-6)


def test_numbers_of_more_than_16_bits_have_no_last_one(tmp_path: Path) -> None:
    found = truth(tmp_path, np.full((2, 4), 65535, np.uint32))
    np.testing.assert_allclose(found, np.full((2, 4), 655.35), rtol=1e-6)


def test_floats_are_metres(tmp_path: Path) -> None:
    stored = np.array([[0, -1, 0.5, 2000], [NAN, INF, -INF, 9]], np.float64)
    found = truth(tmp_path, stored)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, [[NAN, NAN, 0.5, 2000], [NAN, INF, NAN, 9]])


def test_a_unit_divides_whatever_is_stored(tmp_path: Path) -> None:
    for kind in (np.uint16, np.float32):
        found = truth(tmp_path, np.full((2, 4), 512, kind), per_m=256.0)
        np.testing.assert_array_equal(found, np.full((2, 4), 2.0))


def test_truth_from_far_on_is_sky(tmp_path: Path) -> None:
    found = truth(tmp_path, np.array([[1.0, 99, 100, 1e10]] * 2), far_m=100.0)
    np.testing.assert_array_equal(found[0], [1, 99, INF, INF])


def test_far_is_a_length_where_rays_are_stored(tmp_path: Path) -> None:
    """As a far plane is: by depth only the middle of its sky was one."""
    length = np.full((2, 4), 100.0)
    assert np.isinf(truth(tmp_path, length, far_m=100.0, is_ray=True)).all()
    assert np.isfinite(truth(tmp_path, length - 1, far_m=100.0, is_ray=True)).all()


def test_the_used_units_are_told(tmp_path: Path) -> None:
    np.save(tmp_path / "1.npy", np.ones((2, 4), np.float32))
    cv2.imwrite(str(tmp_path / "2.png"), np.ones((2, 4), np.uint16))
    true = TrueDepth(truth_files(tmp_path))
    for index in (1, 2):
        true.at(index, Camera.from_fov(4, 2, 90))
    assert true.used == {1.0, 100.0}


# Rays


def test_a_pinholes_rays_are_shortened_by_hand() -> None:
    depth_m = np.random.default_rng(0).uniform(1, 100, (48, 64))
    rows, columns = np.indices((48, 64))
    length_m = depth_m * np.sqrt(1 + ((columns - 30) / 50) ** 2 + ((rows - 25) / 40) ** 2)
    np.testing.assert_allclose(length_m / lengths_of_rays(CAMERA), depth_m, rtol=1e-5)


def test_rays_of_a_truth_of_another_size_go_through_its_own_pixels(tmp_path: Path) -> None:
    rows, columns = np.indices((24, 32))
    x, y = (2 * columns + 0.5 - 30) / 50, (2 * rows + 0.5 - 25) / 40  # its pixels lie between the camera's
    np.save(tmp_path / "0.npy", 20 * np.sqrt(1 + x**2 + y**2))
    found = TrueDepth(truth_files(tmp_path), is_ray=True).at(0, CAMERA)
    np.testing.assert_allclose(found, np.full((24, 32), 20), rtol=1e-5)


def test_a_fisheyes_rays_have_the_cosine_of_their_angle() -> None:
    camera = Camera.from_fov(65, 65, 220, model="fisheye")
    found = 10 / lengths_of_rays(camera)
    degrees = np.abs(np.arange(65) - 32) * 220 / 65
    seen = degrees < 89
    np.testing.assert_allclose(found[32][seen], 10 * np.cos(np.radians(degrees[seen])), rtol=1e-3)
    assert np.isnan(found[32][degrees > 91]).all()


def test_rays_through_a_distorted_lens(tmp_path: Path) -> None:
    camera = Camera(64, 48, 50.0, 50.0, 31.5, 23.5, (-0.2, 0.05, 0.001, 0.002))
    rays = np.array([[0.0, 0.0, 1.0], [0.3, -0.2, 1.0], [-0.4, 0.3, 1.0]])
    pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    found = 1 / lengths_of_rays(camera)
    for ray, (x, y) in zip(rays, pixels[:, 0], strict=True):
        assert found[round(y), round(x)] == pytest.approx(1 / np.linalg.norm(ray), rel=0.01)


# Sizes


def test_every_fifth_pixel_is_looked_up_at_its_centre() -> None:
    depth_m = np.arange(360 * 640, dtype=np.float32).reshape(360, 640)
    np.testing.assert_array_equal(at_centres(depth_m, (72, 128)), depth_m[2::5, 2::5])


def test_the_same_size_stays_and_a_larger_one_repeats() -> None:
    depth_m = np.arange(6, dtype=np.float32).reshape(2, 3)
    np.testing.assert_array_equal(at_centres(depth_m, (2, 3)), depth_m)
    np.testing.assert_array_equal(at_centres(depth_m, (4, 6)), depth_m.repeat(2, 0).repeat(2, 1))


def test_another_shape_is_refused_and_a_rounded_one_is_not(tmp_path: Path) -> None:
    np.save(tmp_path / "000.npy", np.ones((68, 90)))
    np.save(tmp_path / "001.npy", np.ones((48, 85)))
    true = TrueDepth(truth_files(tmp_path))
    assert true.at(0, CAMERA).shape == (68, 90)
    with pytest.raises(BadInput, match=r"001\.npy: expected the shape of the flight's 64x48.*, got 85x48"):
        true.at(1, CAMERA)


def test_a_shape_that_is_two_per_cent_off_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "0.npy", np.ones((49, 64)))
    with pytest.raises(BadInput, match="got 64x49"):
        TrueDepth(truth_files(tmp_path)).at(0, CAMERA)


# Names


def test_a_name_tells_the_frame_by_its_last_number(tmp_path: Path) -> None:
    names = (
        "depth_00012.png",
        "0000000003.tif",
        "t1.5_left_7_depth.npy",
        "12b.exr_note.txt",
        "notes.png",
        ".9.png",
    )
    for name in names:
        (tmp_path / name).touch()
    (tmp_path / "100.png").mkdir()
    found = truth_files(tmp_path)
    assert {index: path.name for index, path in found.items()} == {12: names[0], 3: names[1], 7: names[2]}


def test_two_files_of_one_frame_are_refused(tmp_path: Path) -> None:
    for name in ("left_01.png", "right_01.png"):
        (tmp_path / name).touch()
    with pytest.raises(BadInput, match=r"one file a frame, got left_01\.png and right_01\.png"):
        truth_files(tmp_path)


@pytest.mark.parametrize(("name", "got"), [("none", "got none"), ("file", "got a file"), ("", "got none")])
def test_a_folder_without_truth_is_refused(tmp_path: Path, name: str, got: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match=got):
        truth_files(tmp_path / name)


# Beside a flight's pictures


def touched(folder: Path, names: list[str]) -> Path:
    for name in names:
        (folder / name).touch()
    return folder


def names(found: dict[int, Path]) -> dict[int, str]:
    return {index: path.name for index, path in found.items()}


def test_frames_of_a_video_count_from_first(tmp_path: Path) -> None:
    touched(tmp_path, ["d_1.npy", "d_2.npy", "d_9.npy"])
    found = matched(tmp_path, {0: "", 1: "", 2: ""}, 1)
    assert names(found.files) == {0: "d_1.npy", 1: "d_2.npy"}
    assert (found.of_no_frame, found.first) == (1, 1)
    assert found.spans == "their numbers are 1 to 9, the frames' 1 to 3 (--first)"
    assert names(matched(tmp_path, {0: "", 1: "", 2: ""}).files) == {1: "d_1.npy", 2: "d_2.npy"}


def test_numbered_pictures_have_the_truth_of_their_numbers(tmp_path: Path) -> None:
    touched(tmp_path, [f"depth{number:04d}.exr" for number in (1, 2, 5, 6)])
    pictures = {0: "cam1_frame0001.png", 1: "cam1_frame0002.png", 2: "cam1_frame0005.png"}
    found = matched(tmp_path, pictures)
    assert names(found.files) == {0: "depth0001.exr", 1: "depth0002.exr", 2: "depth0005.exr"}
    assert (found.of_no_frame, found.first) == (1, 1)
    assert names(matched(tmp_path, pictures, 0).files) == {1: "depth0001.exr", 2: "depth0002.exr"}


def test_pictures_named_by_times_have_the_truth_that_is_nearest(tmp_path: Path) -> None:
    touched(tmp_path, [f"1305031102.{ms}000.png" for ms in ("090", "214", "390")])  # 10 ms, 14 ms, 90 ms off
    pictures = {0: "1305031102.100000.png", 1: "1305031102.200000.png", 2: "1305031102.300000.png"}
    found = matched(tmp_path, pictures)
    assert names(found.files) == {0: "1305031102.090000.png", 1: "1305031102.214000.png"}
    assert (found.of_no_frame, found.first) == (1, None)
    assert found.spans == "their times are 1305031102.090 to 1305031102.390 s, the pictures' " + (
        "1305031102.100 to 1305031102.300 s"
    )


def test_a_gap_between_pictures_makes_no_truth_nearer(tmp_path: Path) -> None:
    """80 ms off, where pictures are 100 ms apart but for a gap of 5 s."""
    touched(tmp_path, ["1305031102.100.png", "1305031102.380.png"])
    pictures = dict(
        enumerate(f"{time:.3f}.png" for time in (1305031102.1, 1305031102.2, 1305031102.3, 1305031107.3))
    )
    assert names(matched(tmp_path, pictures).files) == {0: "1305031102.100.png"}


def test_half_a_step_off_is_near_enough(tmp_path: Path) -> None:
    touched(tmp_path, ["1305031102.050.png"])
    pictures = {0: "1305031102.100.png", 1: "1305031102.200.png"}
    assert names(matched(tmp_path, pictures).files) == {0: "1305031102.050.png"}


def test_a_truth_between_two_pictures_is_one_file(tmp_path: Path) -> None:
    """It was counted twice: of two files none was said to be of no frame."""
    touched(tmp_path, ["1305031102.150.png", "1305031102.900.png"])
    pictures = {0: "1305031102.100.png", 1: "1305031102.200.png", 2: "1305031102.300.png"}
    found = matched(tmp_path, pictures)
    assert names(found.files) == {0: "1305031102.150.png", 1: "1305031102.150.png"}
    assert found.of_no_frame == 1


def test_numbered_truth_of_pictures_named_by_times_counts_frames(tmp_path: Path) -> None:
    touched(tmp_path, ["000000.png", "000001.png"])
    pictures = {0: "1305031102.1.png", 1: "1305031102.2.png"}
    assert names(matched(tmp_path, pictures).files) == {0: "000000.png", 1: "000001.png"}


def test_truth_of_another_day_is_refused(tmp_path: Path) -> None:
    touched(tmp_path, ["1305031102.1.png"])
    with pytest.raises(BadInput, match=r"half a step of the pictures'.*, got 1305031102\.100 to 1305031102"):
        matched(tmp_path, {0: "1305131102.1.png", 1: "1305131102.2.png"})


def test_a_flight_without_frames_has_no_truth(tmp_path: Path) -> None:
    touched(tmp_path, ["1.png"])
    with pytest.raises(BadInput, match="expected numbers none: no frame"):
        matched(tmp_path, {})
