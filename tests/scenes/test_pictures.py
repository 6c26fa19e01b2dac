"""Pictures read from files: whole or not at all."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from flightdepth import levels
from flightdepth.errors import FlightDepthError
from flightdepth.scenes.pictures import is_whole, read_picture

NOISE = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)
BASELINE, PROGRESSIVE, RESTARTS = (
    [cv2.IMWRITE_JPEG_PROGRESSIVE, 0],
    [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
    [cv2.IMWRITE_JPEG_RST_INTERVAL, 1],
)


def jpeg(*options):
    return cv2.imencode(".jpg", NOISE, options)[1].tobytes()


def with_preview(data, preview):
    """A JPEG whose head holds another one, as a camera's does."""
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(preview) + 2) + preview + data[2:]


@pytest.mark.parametrize("options", [BASELINE, PROGRESSIVE, RESTARTS])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_the_beginning_of_a_jpeg_is_no_picture(options, share, tmp_path):
    """OpenCV made the rest grey, and a texture or a stored set's picture was half of one without a word."""
    data, path = jpeg(*options), tmp_path / "cut.jpg"
    path.write_bytes(data)
    np.testing.assert_array_equal(read_picture(path), cv2.imread(str(path))[..., ::-1])
    path.write_bytes(data[: int(share * len(data))])
    assert read_picture(path) is None


def test_opencv_is_given_no_name(tmp_path, monkeypatch):
    """On Windows it opens no file whose name holds letters of another language."""
    path = tmp_path / "\u03a9.jpg"
    path.write_bytes(jpeg())
    monkeypatch.setattr(cv2, "imread", lambda *_: None)
    assert read_picture(path).shape == NOISE.shape
    path.write_bytes(b"")
    assert read_picture(path) is None


def test_a_preview_s_end_is_not_the_picture_s():
    data = with_preview(jpeg(), jpeg())
    assert is_whole(data)
    assert not is_whole(data[: len(data) * 3 // 4])


def test_what_a_camera_writes_behind_a_picture_does_not_matter():
    assert is_whole(jpeg() + b"a film of a second")


def test_a_cut_at_any_byte_is_seen():
    data = with_preview(jpeg(*PROGRESSIVE), jpeg())
    assert not any(is_whole(data[:size]) for size in range(3, len(data)))


@pytest.mark.parametrize("suffix", ["png", "webp", "bmp", "tif"])
def test_the_beginning_of_another_file_is_no_picture(suffix, tmp_path):
    path = tmp_path / f"cut.{suffix}"
    cv2.imwrite(str(path), NOISE)
    assert read_picture(path) is not None
    path.write_bytes(path.read_bytes()[:-200])
    assert read_picture(path) is None


def test_more_pixels_than_opencv_takes_are_no_picture(tmp_path):
    """It raised an error of its own."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    size = struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(b"\0" * 100))
    path = tmp_path / "huge.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + pixels + chunk(b"IEND", b""))
    assert read_picture(path) is None


def test_16_bits_and_alpha_become_8_bits_of_colour(tmp_path):
    path = tmp_path / "picture.png"
    alpha = np.zeros((40, 60), np.uint8)
    for image in (NOISE.astype(np.uint16) * 257, np.dstack([NOISE, alpha])):
        cv2.imwrite(str(path), image)
        np.testing.assert_array_equal(read_picture(path), NOISE[..., ::-1])


def test_a_picture_becomes_a_jpeg_file_of_the_quality():
    smooth = cv2.GaussianBlur(NOISE, (0, 0), 5)
    back = [
        cv2.imdecode(np.frombuffer(levels.jpeg(smooth, q), np.uint8), cv2.IMREAD_COLOR_RGB) for q in (95, 20)
    ]
    errors = [np.abs(each.astype(float) - smooth).mean() for each in back]
    assert errors[0] < 1.5 < errors[1]


def test_a_jpeg_that_opencv_does_not_write_is_told(monkeypatch):
    """Its flag was not looked at: an empty file was stored."""
    monkeypatch.setattr(levels.cv2, "imencode", lambda *_: (False, np.empty(0, np.uint8)))
    with pytest.raises(FlightDepthError, match=r"could not encode a 60x40 picture as \.jpg"):
        levels.jpeg(NOISE, 95)
