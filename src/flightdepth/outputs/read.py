"""Reading back what `flightdepth run` wrote."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.levels import picture_in
from flightdepth.outputs.encoding import Map, confidence_from_bytes, depth_from_centimetres
from flightdepth.outputs.frame_table import FrameRow, rows_from_csv
from flightdepth.outputs.maps import CONFIDENCE, DEPTH, FARTHER, NEARER, SIGMA, map_file
from flightdepth.outputs.poses import FramePose, poses_from_csv
from flightdepth.outputs.record import Counts, FlightRecord
from flightdepth.outputs.writer import POSES, RECORD, TABLE

# RuntimeError: of one damaged byte `zipfile` says that it needs a later version, another compression or a password.
DAMAGED_NPZ = (BadZipFile, OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError)
OUT = "First `flightdepth run VIDEO --out DIR`, then give DIR."
Table = TypeVar("Table")
Unsigned = TypeVar("Unsigned", np.uint8, np.uint16)


def read_depth(path: Path) -> Map:
    """Depth in metres, float32 [H, W], NaN = unknown, of a .png (whole centimetres) or .npz (float32)."""
    if path.suffix == ".npz":
        return _read_npz(path, "depth_m")
    return depth_from_centimetres(_read_png(path, np.uint16))


def read_confidence(path: Path) -> Map:
    """Confidence 0..1, float32 [H, W], 0 = do not use."""
    return confidence_from_bytes(_read_png(path, np.uint8))


class FlightFolder:
    """An output folder: `record` (flight.json), `rows` (frames.csv), and the maps and pose of each frame.

    One that was interrupted (`record.whole` is False) ends before the first frame whose files are not all there.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.record = self._read_record()
        self.rows = self._read_table(TABLE, rows_from_csv)
        if not self.record.whole:
            self.rows = list(takewhile(self._stands, self.rows))
            dropped, saturated = self.record.counts.dropped, self.record.counts.pixels_at_655_m_or_farther
            counts = Counts.of(self.rows, dropped, saturated)
            self.record = self.record.model_copy(update={"counts": counts})
        self.poses: dict[int, FramePose] = {}  # by frame index
        if (self.folder / POSES).exists():  # older versions wrote none
            self.poses = self._read_table(POSES, poses_from_csv)
        self._focals_px = {row.index: row.focal_px for row in self.rows if row.focal_px is not None}

    def __repr__(self) -> str:
        return f"FlightFolder({str(self.folder)!r}: {len(self.rows)} frames)"

    def camera(self, index: int) -> Camera:
        """The camera of the frame with this index: that of `record`, zoomed as its picture was."""
        camera = self.record.source.camera
        return camera.zoomed(self._focals_px.get(index, camera.fx) / camera.fx)

    def depth_m(self, index: int) -> Map:
        """Depth in metres, float32 [H, W], NaN = unknown, of the frame with this index."""
        return self._map(self._file(DEPTH, index, self.record.depth.format), read_depth)

    def confidence(self, index: int) -> Map:
        """Confidence 0..1, float32 [H, W], of the frame with this index."""
        return self._map(self._file(CONFIDENCE, index), read_confidence)

    def sigma_m(self, index: int) -> Map | None:
        """Standard deviation in metres, float32 [H, W]; None without depth, or of a network that tells none."""
        path = self._file(SIGMA, index, self.record.depth.format)
        return self._map(path, _read_sigma) if path.exists() else None

    def farther_than_m(self, index: int) -> Map | None:
        """What is at least so far, metres, float32 [H, W], NaN where that is not told; None where it is nowhere."""
        return self._bound_m(FARTHER, index)

    def nearer_than_m(self, index: int) -> Map | None:
        """What is at most so far, metres, float32 [H, W], NaN where that is not told; None where it is nowhere."""
        return self._bound_m(NEARER, index)

    def _stands(self, row: FrameRow) -> bool:
        """Whether its maps came to the disk; a loss of power leaves empty files."""
        i, kind = row.index, self.record.depth.format
        files = [self._file(DEPTH, i, kind), self._file(CONFIDENCE, i)]
        others = self._file(SIGMA, i, kind), self._file(FARTHER, i), self._file(NEARER, i)
        files += [file for file in others if file.exists()]  # not each frame has them
        return all(file.exists() and file.stat().st_size for file in files)

    def _bound_m(self, folder: str, index: int) -> Map | None:
        path = self._file(folder, index)
        return self._map(path, read_depth) if path.exists() else None

    def _map(self, path: Path, read: Callable[[Path], Map]) -> Map:
        """What `read` makes of a file, [H, W] as the camera's pictures."""
        found, camera = read(path), self.record.source.camera
        if found.shape != (camera.height, camera.width):
            expected = f"{[camera.height, camera.width]}, as the camera of flight.json"
            raise BadInput(f"map {path}", expected=expected, got=str(list(found.shape)))
        return found

    def _file(self, folder: str, index: int, ending: str = "png") -> Path:
        return map_file(self.folder, folder, index, ending)

    def _read_record(self) -> FlightRecord:
        path = self.folder / RECORD
        if self.folder.is_file():
            raise _not_ours(self.folder, "a file", mend=OUT)
        try:
            return FlightRecord.model_validate_json(path.read_bytes())
        except OSError as error:
            raise _not_ours(path, error.strerror or str(error), mend=OUT) from error
        except ValidationError as error:
            raise _not_ours(path, error.errors()[0]["msg"]) from error

    def _read_table(self, name: str, parse: Callable[[str], Table]) -> Table:
        path = self.folder / name
        try:
            text = path.read_text(encoding="utf-8")
            if not self.record.whole:  # a last line may be cut off
                text = text[: text.rfind("\n") + 1]
            return parse(text)
        except OSError as error:
            raise _not_ours(path, error.strerror or str(error)) from error
        except (csv.Error, KeyError, ValueError, AttributeError, TypeError) as error:
            raise _not_ours(path, f"a broken table ({error})") from error


def _read_png(path: Path, kind: type[Unsigned]) -> NDArray[Unsigned]:
    image = picture_in(_read_bytes(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise BadInput(f"map {path}", expected="a PNG", got="something else")
    if image.dtype != kind or image.ndim != 2:
        expected = f"a grey {8 * np.dtype(kind).itemsize}-bit PNG"
        raise BadInput(f"map {path}", expected=expected, got=f"{image.dtype} {list(image.shape)}")
    return np.asarray(image, kind)


def _read_sigma(path: Path) -> Map:
    return _read_npz(path, "sigma_m") if path.suffix == ".npz" else read_depth(path)


def _read_npz(path: Path, name: str) -> Map:
    data = _read_bytes(path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return np.asarray(arrays[name], dtype=np.float32)
    except DAMAGED_NPZ as error:
        raise BadInput(f"map {path}", expected=f"an .npz with {name}", got="something else") from error


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"map {path}", expected="a file", got=error.strerror or str(error)) from error


def _not_ours(path: Path, got: str, *, mend: str | None = None) -> BadInput:
    return BadInput(f"flight folder {path}", expected="what `flightdepth run` writes", got=got, mend=mend)
