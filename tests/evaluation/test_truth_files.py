"""Files of true depth, each kind written by its usual writer."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from flightdepth.errors import BadInput
from flightdepth.evaluation.truth_files import ENDINGS, one_channel, read_stored

WHOLE = np.array([[0, 1, 700], [42, 65535, 9]], np.uint16)
FLOATS = np.array([[0.5, np.nan, np.inf], [-1, 0, 1234]], np.float32)


def picture(path: Path, stored: np.ndarray) -> None:
    assert cv2.imwrite(str(path), stored)


def exr(
    path: Path, compression: OpenEXR.Compression = OpenEXR.ZIP_COMPRESSION, **channels: np.ndarray
) -> None:
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def npy_of(stored: np.ndarray) -> bytes:
    written = io.BytesIO()
    np.save(written, stored)
    return written.getvalue()


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
    "grey.exr": lambda path: exr(path, OpenEXR.NO_COMPRESSION, Y=FLOATS),
    "rgb.exr": lambda path: exr(path, R=FLOATS, G=FLOATS, B=FLOATS),
    "rgba.exr": lambda path: exr(path, R=FLOATS, G=FLOATS, B=FLOATS, A=np.ones_like(FLOATS)),
    "red_alone.exr": lambda path: exr(path, R=FLOATS, G=np.zeros_like(FLOATS), B=np.zeros_like(FLOATS)),
    "only_red.exr": lambda path: exr(path, R=FLOATS),
    "blender.exr": lambda path: exr(path, V=FLOATS),
    "blender_z.exr": lambda path: exr(path, OpenEXR.PIZ_COMPRESSION, Z=FLOATS),
    "blender_layer.exr": lambda path: exr(path, **{"View Layer.Depth.Z": FLOATS}),
    "blender_layers.exr": lambda path: exr(path, **{"L.Depth.Z": FLOATS, "L.Combined.R": FLOATS + 1}),
    "half.exr": lambda path: exr(path, Y=FLOATS.astype(np.float16)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_was_written_comes_back(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name)
    stored = read_stored(tmp_path / name)
    np.testing.assert_array_equal(stored, WHOLE if name.startswith("whole") else FLOATS)
    assert (stored.dtype.kind == "u") == name.startswith("whole")


def test_every_kind_that_is_read_is_looked_for() -> None:
    assert {Path(name).suffix.lower() for name in WRITERS} == set(ENDINGS)


def test_signed_whole_numbers_come_back(tmp_path: Path) -> None:
    np.save(tmp_path / "1.npy", WHOLE.astype(np.int32))
    np.testing.assert_array_equal(read_stored(tmp_path / "1.npy"), WHOLE)


def test_colours_of_nothing_but_0_are_a_map_of_0() -> None:
    np.testing.assert_array_equal(one_channel(np.zeros((2, 3, 3), np.float32)), np.zeros((2, 3)))


OTHERS = {
    "colours.png": lambda path: picture(path, np.dstack([WHOLE, WHOLE, WHOLE + 1])),
    "green.png": lambda path: picture(path, np.dstack([WHOLE, WHOLE + 1, WHOLE])),
    "bytes.png": lambda path: picture(path, WHOLE.astype(np.uint8)),
    "colours.exr": lambda path: exr(path, R=FLOATS, G=FLOATS, B=FLOATS + 1),
    "flags.npy": lambda path: np.save(path, WHOLE > 1),
    "nothing.npy": lambda path: np.save(path, FLOATS[:0]),
    "no_channel.npy": lambda path: np.save(path, np.zeros((3, 4, 0), np.float32)),
    "row.npy": lambda path: np.save(path, FLOATS[0]),
    "objects.npy": lambda path: np.save(path, np.array([{}, None]), allow_pickle=True),
    "several.npz": lambda path: np.savez(path, a=FLOATS, b=FLOATS),
    "an_npy.npz": lambda path: path.write_bytes(npy_of(FLOATS)),
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


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("green.png", r"uint16 \[2, 3, 3\]"),
        ("several.npz", "2 arrays, none named depth_m"),
        ("an_npy.npz", r"an \.npy under this name"),
    ],
)
def test_what_a_refused_file_holds_is_told(tmp_path: Path, name: str, told: str) -> None:
    OTHERS[name](tmp_path / name)
    with pytest.raises(BadInput, match=rf"got {told}$"):
        read_stored(tmp_path / name)


@pytest.mark.parametrize("scale", [-1.0, 1.0, -0.5, 1000.0, -0.00390625])
def test_the_scale_in_the_head_of_a_pfm_changes_no_number(tmp_path: Path, scale: float) -> None:
    kind = "<f4" if scale < 0 else ">f4"
    stored = FLOATS[::-1].astype(kind).tobytes()  # from the lowest row up
    (tmp_path / "1.pfm").write_bytes(f"Pf\n3 2\n{scale}\n".encode() + stored)
    np.testing.assert_allclose(read_stored(tmp_path / "1.pfm"), FLOATS, rtol=1e-6)


def test_an_exr_without_depth_is_refused_by_its_channels(tmp_path: Path) -> None:
    path = tmp_path / "1.exr"
    exr(path, **{"View Layer.Mist.W": FLOATS})
    with pytest.raises(
        BadInput, match=r"with the channels View Layer\.Mist\.W: one of depth is called V, Z or Y"
    ):
        read_stored(path)


def test_two_depths_in_an_exr_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "1.exr"
    exr(path, **{"Left.Depth.Z": FLOATS, "Right.Depth.Z": FLOATS, "B": FLOATS})
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
