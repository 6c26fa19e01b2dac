import io

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.files import names_flightdepth
from flightdepth.levels import jpeg
from flightdepth.outputs.encoding import (
    bytes_from_confidence,
    centimetres_from_depth,
    confidence_from_bytes,
    depth_from_centimetres,
    png,
    rgb_png,
    rounded_centimetres,
)


def test_a_jpeg_keeps_red_red():
    red = np.full((16, 16, 3), (250, 20, 40), np.uint8)
    back = cv2.imdecode(np.frombuffer(jpeg(red, 90), np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(back[..., ::-1].astype(int) - red).max() < 12


def stored(depth_m: float) -> int:
    return int(centimetres_from_depth(np.array([[depth_m]], np.float32))[0, 0])


@given(st.floats(0.01, 655.34))
def test_depth_comes_back_within_half_a_centimetre(depth_m):
    back = depth_from_centimetres(np.array([[stored(depth_m)]], np.uint16))[0, 0]
    assert abs(back - depth_m) <= 0.005 + 1e-4


@given(st.integers(0, 65535))
def test_each_stored_value_comes_back_as_itself(value):
    depth_m = depth_from_centimetres(np.array([[value]], np.uint16))
    assert centimetres_from_depth(depth_m)[0, 0] == value


@pytest.mark.parametrize(
    ("depth_m", "value"),
    [
        (float("nan"), 0),
        (12.34, 1234),
        (655.34, 65534),
        (655.35, 65535),
        (5000.0, 65535),
        (float("inf"), 65535),
    ],
)
def test_depth_by_hand(depth_m, value):
    assert stored(depth_m) == value


def test_the_very_near_is_stored_as_one_centimetre_not_as_unknown():
    assert stored(0.002) == 1


@given(st.floats(0.01, 655.3))
def test_a_rounded_sigma_is_within_a_64th_and_half_a_centimetre(sigma_m):
    back = depth_from_centimetres(rounded_centimetres(np.array([[sigma_m]], np.float32)))[0, 0]
    assert abs(back - sigma_m) <= sigma_m / 64 + 0.005 + 1e-4


def test_a_rounded_sigma_has_six_binary_digits():
    """1234 lies between 38 and 39 steps of 32; up to 63 nothing is rounded."""
    stored = rounded_centimetres(np.array([[12.34, 0.63, 0.67, 1.29]], np.float32))
    assert stored.tolist() == [[39 * 32, 63, 34 * 2, 32 * 4]]


def test_a_rounded_sigma_keeps_its_ends():
    stored = rounded_centimetres(np.array([[np.nan, 0.01, 655.35, 9000]], np.float32))
    assert stored.tolist() == [[0, 1, 65535, 65535]]


def test_unknown_comes_back_as_nan():
    assert np.isnan(depth_from_centimetres(np.zeros((1, 1), np.uint16))).all()


@given(st.floats(0, 1, width=32))
def test_confidence_comes_back_within_a_255th(confidence):
    back = confidence_from_bytes(bytes_from_confidence(np.array([[confidence]], np.float32)))[0, 0]
    assert 0 <= back - confidence <= 1 / 255 + 1e-6


def test_a_confidence_that_rounding_put_above_1_is_1():
    """256 would be stored as 0: do not use."""
    assert bytes_from_confidence(np.array([[1.0000001]], np.float32)).tolist() == [[255]]


def test_only_no_confidence_is_stored_as_zero():
    assert bytes_from_confidence(np.array([[0.0, 1e-6, 1.0]], np.float32)).tolist() == [[0, 1, 255]]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_png_is_lossless(kind):
    image = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (33, 47), dtype=kind, endpoint=True)
    read = cv2.imdecode(np.frombuffer(png(image), np.uint8), cv2.IMREAD_UNCHANGED)
    assert read.dtype == kind
    assert np.array_equal(read, image)


def test_a_picture_says_who_wrote_it_and_is_lossless():
    image = np.random.default_rng(0).integers(0, 256, (33, 47, 3), dtype=np.uint8)
    written = rgb_png(image)
    assert names_flightdepth(written[:64])
    with av.open(io.BytesIO(written)) as file:  # which checks sums, as OpenCV does not
        read = next(file.decode(video=0)).to_ndarray(format="rgb24")
    assert np.array_equal(read, image)
    assert np.array_equal(cv2.imdecode(np.frombuffer(written, np.uint8), cv2.IMREAD_COLOR)[..., ::-1], image)
