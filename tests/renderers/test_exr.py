"""OpenEXR files, by the library's own writer."""

import numpy as np
import OpenEXR
import pytest

from flightdepth.errors import FlightDepthError
from flightdepth.renderers.exr import read_exr

DEPTH = np.arange(12, dtype=np.float32).reshape(3, 4) / 3
HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


@pytest.mark.parametrize("compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIP_COMPRESSION])
def test_channels_come_back_by_name(tmp_path, compression):
    written = {"V.Depth.Z": DEPTH, "V.Combined.R": -DEPTH.astype(np.float16)}
    with OpenEXR.File(HEADER | {"compression": compression}, dict(written)) as file:
        file.write(str(tmp_path / "a.exr"))
    read = read_exr(tmp_path / "a.exr")
    assert set(read) == set(written)
    for name, values in written.items():
        np.testing.assert_array_equal(read[name], values)
        assert read[name].dtype == values.dtype


def test_several_parts_are_refused(tmp_path):
    parts = [OpenEXR.Part({"name": name}, {"Z": DEPTH}) for name in ("a", "b")]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.raises(FlightDepthError, match="of one part, got 2"):
        read_exr(tmp_path / "a.exr")


def test_a_file_cut_anywhere_is_refused(tmp_path):
    with OpenEXR.File(HEADER, {"Z": DEPTH}) as file:
        file.write(str(tmp_path / "a.exr"))
    whole = (tmp_path / "a.exr").read_bytes()
    for length in range(len(whole)):
        (tmp_path / "a.exr").write_bytes(whole[:length])
        with pytest.raises(FlightDepthError):
            read_exr(tmp_path / "a.exr")


def test_no_file_is_refused(tmp_path):
    with pytest.raises(FlightDepthError):
        read_exr(tmp_path / "none.exr")
