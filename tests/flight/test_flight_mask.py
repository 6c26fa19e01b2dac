"""Masks as files: what is black, other sizes, other files."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.mask import PictureMask

SHOWN = np.ones((90, 160), np.bool_)
SHOWN[60:, :40] = False


def written(folder, picture, name="mask.png"):
    assert cv2.imwrite(str(folder / name), picture)
    return folder / name


@pytest.mark.parametrize(
    ("picture", "name"),
    [
        (SHOWN * np.uint8(255), "mask.png"),
        (SHOWN * np.uint8(1), "mask.png"),
        (SHOWN * np.uint16(200), "mask.png"),
        (np.repeat(SHOWN[..., None] * np.uint8(255), 3, 2), "mask.png"),
        (SHOWN * np.uint8(255), "mask.bmp"),
    ],
    ids=["grey", "one", "16 bits", "colours", "bmp"],
)
def test_black_alone_is_masked(tmp_path, picture, name):
    """As COLMAP has it; a mask of 0 and 1 looks black, and is none."""
    np.testing.assert_array_equal(PictureMask.read(written(tmp_path, picture, name)).shown, SHOWN)


def test_a_mask_that_tells_more_pixels_than_opencv_takes_is_refused(tmp_path):
    """It ended in OpenCV's own error."""
    path = written(tmp_path, SHOWN * np.uint8(255))
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 40_000, 40_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    path.write_bytes(data)
    with pytest.raises(BadInput, match="expected a picture, such as a PNG"):
        PictureMask.read(path)


@pytest.mark.parametrize("size", [(160, 90), (80, 45), (640, 360), (1920, 1080), (854, 480)])
def test_a_mask_of_another_size_has_the_same_shape(tmp_path, size):
    shown = PictureMask.read(written(tmp_path, SHOWN * np.uint8(255))).at(*size).shown
    assert shown.shape == size[::-1]
    assert 1 - shown.mean() == pytest.approx(1 / 12, abs=0.01)
    assert not shown[-1, 0]
    assert shown[0].all()


def test_a_pixel_that_is_masked_in_part_is_masked(tmp_path):
    """A thin line does not fall between the pixels of a smaller picture."""
    line = np.full((90, 160), 255, np.uint8)
    line[45] = 0
    shown = PictureMask.read(written(tmp_path, line)).at(64, 36).shown
    assert not shown[18].any()
    assert shown.mean() == pytest.approx(35 / 36)


def test_another_mask_has_another_digest(tmp_path):
    one = PictureMask.read(written(tmp_path, SHOWN * np.uint8(255))).digest
    assert one == PictureMask.read(written(tmp_path, SHOWN * np.uint8(9), "other.png")).digest
    assert one != PictureMask.read(written(tmp_path, SHOWN.T * np.uint8(255))).digest
    assert one != PictureMask.read(written(tmp_path, SHOWN[::-1] * np.uint8(255))).digest


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "expected a picture, got No such file"),
        (b"", "expected a picture, such as a PNG, got another file"),
        (b"\x89PNG\r\n", "expected a picture, such as a PNG, got another file"),
        ("black", "expected white where the scene is seen, got black alone"),
    ],
)
def test_what_is_no_mask_is_refused(tmp_path, content, words):
    path = tmp_path / "mask.png"
    if content == "black":
        written(tmp_path, np.zeros((90, 160), np.uint8))
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=words) as caught:
        PictureMask.read(path)
    assert f"--mask {path}" in str(caught.value)


def test_one_of_another_shape_is_refused(tmp_path):
    mask = PictureMask.read(written(tmp_path, SHOWN * np.uint8(255)))
    with pytest.raises(BadInput, match="expected a picture of 640x480, or of its shape, got 160x90"):
        mask.at(640, 480)
