"""Files of true depth, each kind written by its usual writer."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.evaluation.truth_files import read_stored

WHOLE = np.array([[0, 1, 700], [42, 65535, 9]], np.uint16)
FLOATS = np.array([[0.5, np.nan, np.inf], [-1, 0, 1234]], np.float32)


def picture(path: Path, stored: np.ndarray) -> None:
    assert cv2.imwrite(str(path), stored)


def exr(path: Path, planes: list[np.ndarray], pixels: str, **options: str) -> None:
    """As FFmpeg writes it: planes [h, w] of one size, in the order of the pixel format."""
    height, width = planes[0].shape
    with av.open(str(path), "w", format="image2") as file:
        stream = file.add_stream("exr", rate=1, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        frame = av.VideoFrame(width, height, pixels)
        for plane, values in zip(frame.planes, planes, strict=True):
            lines = np.zeros((height, plane.line_size // 4), np.float32)
            lines[:, :width] = values
            plane.update(lines.tobytes())
        for packet in (*stream.encode(frame), *stream.encode()):
            file.mux(packet)


def renamed(path: Path, names: dict[bytes, bytes]) -> None:
    """Other names for an EXR's channels, as Blender gives them."""
    exr = path.read_bytes()
    start = exr.index(b"channels\0chlist\0") + len(b"channels\0chlist\0")
    size = int.from_bytes(exr[start : start + 4], "little")
    listed, rest = exr[start + 4 : start + 4 + size], exr[start + 4 + size :]
    channels = [(listed[at : at + 1], listed[at + 1 : at + 18]) for at in range(0, size - 1, 18)]
    changed = b"".join(names[name] + after for name, after in channels) + b"\0"
    longer, table = len(changed) - size, len(exr) - len(rest)
    while exr[table] != 0:  # the other attributes
        table = exr.index(b"\0", exr.index(b"\0", table) + 1) + 1
        table += 4 + int.from_bytes(exr[table : table + 4], "little")
    first = int.from_bytes(exr[table + 1 : table + 9], "little")
    places = np.frombuffer(exr[table + 1 : first], "<u8") + np.uint64(longer)
    header = exr[:start] + len(changed).to_bytes(4, "little") + changed + exr[start + 4 + size : table + 1]
    path.write_bytes(header + places.tobytes() + exr[first:])


def grey_exr(path: Path, name: bytes) -> None:
    """Depth in a channel of this name alone."""
    exr(path, [FLOATS], "grayf32le", compression="zip16")
    renamed(path, {b"Y": name})


def layers_exr(path: Path) -> None:
    """Depth beside a picture, as in Blender's layers."""
    exr(path, [FLOATS + 1, FLOATS + 2, FLOATS], "gbrpf32le", compression="zip1")  # its planes: G, B, R
    names = {b"R": b"View Layer.Depth.Z", b"G": b"View Layer.Combined.G", b"B": b"View Layer.Combined.B"}
    renamed(path, names)


WRITERS = {
    "whole.png": lambda path: picture(path, WHOLE),
    "whole.PNG": lambda path: picture(path, WHOLE),
    "whole.tif": lambda path: picture(path, WHOLE),
    "whole.npy": lambda path: np.save(path, WHOLE),
    "float.tiff": lambda path: picture(path, FLOATS),
    "double.tif": lambda path: picture(path, FLOATS.astype(np.float64)),
    "float.pfm": lambda path: picture(path, FLOATS),
    "three_alike.pfm": lambda path: picture(path, np.dstack([FLOATS] * 3)),
    "float.npy": lambda path: np.save(path, FLOATS),
    "column.npy": lambda path: np.save(path, FLOATS[..., None]),
    "half.npy": lambda path: np.save(path, FLOATS.astype(np.float16)),
    "alone.npz": lambda path: np.savez(path, FLOATS),
    "packed.npz": lambda path: np.savez_compressed(path, whatever=FLOATS),
    "named.npz": lambda path: np.savez(path, sigma_m=WHOLE, depth_m=FLOATS),
    "grey.exr": lambda path: exr(path, [FLOATS], "grayf32le"),
    "rgb.exr": lambda path: exr(path, [FLOATS] * 3, "gbrpf32le", compression="zip16"),
    "rgba.exr": lambda path: exr(path, [*[FLOATS] * 3, np.ones_like(FLOATS)], "gbrapf32le"),
    "red_alone.exr": lambda path: exr(path, [0 * WHOLE, 0 * WHOLE, FLOATS], "gbrpf32le"),
    "blender.exr": lambda path: grey_exr(path, b"V"),
    "blender_z.exr": lambda path: grey_exr(path, b"Z"),
    "blender_layer.exr": lambda path: grey_exr(path, b"View Layer.Depth.Z"),
    "blender_layers.exr": layers_exr,
    "half.exr": lambda path: exr(path, [FLOATS], "grayf32le", format="half"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_was_written_comes_back(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name)
    stored = read_stored(tmp_path / name)
    np.testing.assert_array_equal(stored, WHOLE if name.startswith("whole") else FLOATS)
    assert (stored.dtype.kind == "u") == name.startswith("whole")


OTHERS = {
    "colours.png": lambda path: picture(path, np.dstack([WHOLE, WHOLE, WHOLE + 1])),
    "bytes.png": lambda path: picture(path, WHOLE.astype(np.uint8)),
    "colours.exr": lambda path: exr(path, [FLOATS, FLOATS, FLOATS + 1], "gbrpf32le"),
    "flags.npy": lambda path: np.save(path, WHOLE > 1),
    "row.npy": lambda path: np.save(path, FLOATS[0]),
    "objects.npy": lambda path: np.save(path, np.array([{}, None]), allow_pickle=True),
    "several.npz": lambda path: np.savez(path, a=FLOATS, b=FLOATS),
    "empty.png": lambda path: path.touch(),
    "empty.npy": lambda path: path.touch(),
    "empty.exr": lambda path: path.touch(),
    "a_photo.npz": lambda path: path.write_bytes(cv2.imencode(".png", WHOLE)[1].tobytes()),
    "a_photo.exr": lambda path: path.write_bytes(cv2.imencode(".png", WHOLE)[1].tobytes()),
    "missing.tif": lambda path: None,
    "missing.exr": lambda path: None,
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_tells_no_depth_is_refused_by_its_name(tmp_path: Path, name: str) -> None:
    OTHERS[name](tmp_path / name)
    with pytest.raises(BadInput, match=rf"^truth .*{name}: expected a map .*, got .+") as refused:
        read_stored(tmp_path / name)
    assert len(str(refused.value).splitlines()) == 1


def test_an_exr_without_depth_is_refused_by_its_channels(tmp_path: Path) -> None:
    path = tmp_path / "1.exr"
    grey_exr(path, b"View Layer.Mist.W")
    with pytest.raises(
        BadInput, match=r"with the channels View Layer\.Mist\.W: one of depth is called V, Z or Y"
    ):
        read_stored(path)


def test_two_depths_in_an_exr_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "1.exr"
    exr(path, [FLOATS] * 3, "gbrpf32le")
    renamed(path, {b"R": b"Left.Depth.Z", b"G": b"Right.Depth.Z", b"B": b"B"})
    with pytest.raises(BadInput, match=r"Left\.Depth\.Z"):
        read_stored(path)


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_cut_or_trashed_anywhere_is_read_or_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for length in range(0, len(whole), max(1, len(whole) // 60)):
        path.write_bytes(whole[:length])
        read_or_refuse(path)
    # OpenCV makes room for whatever size a PNG tells: gigabytes, of trash there.
    part = (41, len(whole) - 16) if path.suffix.lower() == ".png" else (0, len(whole))
    for _ in range(60):
        trash = bytearray(whole)
        for place in rng.integers(*part, 4):
            trash[place] = rng.integers(256)
        path.write_bytes(trash)
        read_or_refuse(path)


def read_or_refuse(path: Path) -> None:
    try:
        read_stored(path)
    except BadInput as error:
        assert path.name in str(error)
