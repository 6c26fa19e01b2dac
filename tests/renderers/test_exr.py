"""Uncompressed EXR files, written here by hand from the file format's description."""

import struct

import numpy as np
import pytest

from flightdepth.errors import FlightDepthError
from flightdepth.renderers.exr import read_exr

ROWS, COLUMNS = 3, 4
DEPTH = np.arange(ROWS * COLUMNS, dtype=np.float32).reshape(ROWS, COLUMNS) / 3


def attribute(name, kind, value) -> bytes:
    return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value


def channel(name, kind=2) -> bytes:
    return f"{name}\0".encode() + struct.pack("<iB3xii", kind, 0, 1, 1)


def exr(channels, *, kind=2, compression=b"\0", top=0) -> bytes:
    """Lines of `channels` (name -> [H, W]), last line first, as any order is allowed."""
    listed = b"".join(channel(name, kind) for name in sorted(channels)) + b"\0"
    head = struct.pack("<II", 20000630, 2) + attribute("channels", "chlist", listed)
    head += attribute("compression", "compression", compression)
    head += attribute("dataWindow", "box2i", struct.pack("<4i", 0, top, COLUMNS - 1, top + ROWS - 1)) + b"\0"
    lines = b""
    for row in reversed(range(ROWS)):
        values = b"".join(channels[name][row].tobytes() for name in sorted(channels))
        lines += struct.pack("<ii", top + row, len(values)) + values
    return head + bytes(8 * ROWS) + lines


def test_channels_come_back_by_name(tmp_path):
    (tmp_path / "a.exr").write_bytes(exr({"V.Depth.Z": DEPTH, "V.Combined.R": -DEPTH}, top=5))
    read = read_exr(tmp_path / "a.exr")
    assert set(read) == {"V.Depth.Z", "V.Combined.R"}
    np.testing.assert_array_equal(read["V.Depth.Z"], DEPTH)
    np.testing.assert_array_equal(read["V.Combined.R"], -DEPTH)


@pytest.mark.parametrize("change", [{"kind": 1}, {"compression": b"\3"}])
def test_other_kinds_are_refused(tmp_path, change):
    (tmp_path / "a.exr").write_bytes(exr({"Z": DEPTH}, **change))
    with pytest.raises(FlightDepthError, match="expected an uncompressed 32-bit EXR"):
        read_exr(tmp_path / "a.exr")


def test_a_file_cut_anywhere_is_refused(tmp_path):
    whole = exr({"Z": DEPTH})
    for length in range(len(whole)):
        (tmp_path / "a.exr").write_bytes(whole[:length])
        with pytest.raises(FlightDepthError):
            read_exr(tmp_path / "a.exr")
