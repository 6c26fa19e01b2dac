"""One flight's output folder: depth and confidence a frame, the table, the record, the preview."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np

from flightdepth import __version__
from flightdepth.errors import BadInput
from flightdepth.files import folder_in_progress, write_atomic
from flightdepth.flight.records import Frame
from flightdepth.outputs.background import Background
from flightdepth.outputs.encoding import (
    FARTHEST,
    Map,
    bytes_from_confidence,
    centimetres_from_depth,
    png,
    rounded_centimetres,
)
from flightdepth.outputs.film import Film
from flightdepth.outputs.frame_table import COLUMNS, FrameRow, cells_of, rows_from_csv
from flightdepth.outputs.poses import COLUMNS as POSE_COLUMNS
from flightdepth.outputs.poses import FramePose, pose_cells
from flightdepth.outputs.preview import Preview
from flightdepth.outputs.record import (
    Counts,
    DepthFormat,
    DepthScaleNote,
    FlightRecord,
    ReasonTally,
    Source,
    Summary,
)
from flightdepth.outputs.table_file import TableFile
from flightdepth.ranges.result import RangedDepth

DEPTH, CONFIDENCE, SIGMA = "depth", "confidence", "sigma"
FARTHER, NEARER = "farther_than", "nearer_than"  # bounds of what has no depth
TABLE, POSES, RECORD, PREVIEW = "frames.csv", "poses.csv", "flight.json", "preview.mp4"
OWN_NAMES = frozenset({DEPTH, CONFIDENCE, SIGMA, FARTHER, NEARER, TABLE, POSES, RECORD, PREVIEW})


class FlightWriter:
    """Writes one flight into `target`, which appears when all of it stands; after an error nothing does.

    Depth files and preview are encoded on a thread each, at most a few frames behind `add`. An older result
    in `target` is replaced; a folder that holds anything else is refused.
    """

    def __init__(
        self,
        target: Path,
        source: Source,
        preview: Preview,
        *,
        depth_format: DepthFormat = "png",
    ) -> None:
        check_target(target)
        self._target = target.resolve()  # a link stays, and what it leads to is written
        self._source, self._preview, self._format = source, preview, depth_format
        self._notes = ReasonTally()  # of all frames
        self._dropped: dict[str, int] = {}
        self._warnings: list[str] = []  # that came up in flight
        self._saturated_pixels = 0

    def __enter__(self) -> FlightWriter:
        with ExitStack() as stack:
            self._folder = stack.enter_context(folder_in_progress(self._target))
            for name in (DEPTH, CONFIDENCE):
                (self._folder / name).mkdir()
            self._film = Film(self._folder / PREVIEW, *self._preview.size)
            self._rows = TableFile(self._folder / TABLE, COLUMNS)
            self._poses = TableFile(self._folder / POSES, POSE_COLUMNS)
            self._threads = (
                Background(self._write_maps, name="depth files"),
                Background(self._write_picture, name="preview"),
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:  # renames the folder, or removes it when an error passes through
            if error is not None:
                self._abandon()
                raise error
            try:
                self._finish()
            except BaseException:
                self._abandon()
                raise

    @property
    def summary(self) -> Summary:
        """Figures of the whole flight, once it is written."""
        return self._summary

    def add(self, frame: Frame, result: RangedDepth, pose: FramePose | None = None) -> None:
        """Write one frame; its arrays must not change afterwards."""
        self._rows.add(cells_of(FrameRow.of(frame, result)))
        if pose is not None:
            self._poses.add(pose_cells(pose))
        for note in result.notes if result.doubt is None else (*result.notes, result.doubt):
            self._notes.add(note)
        for thread in self._threads:
            thread.put(frame, result)

    def note_dropped(self, dropped: Mapping[str, int]) -> None:
        """Record how much of the input could not be used, by reason."""
        self._dropped = dict(dropped)

    def warn(self, line: str) -> None:
        """Record what the user should know and only the flight itself showed."""
        self._warnings.append(line)

    def _write_maps(self, frame: Frame, result: RangedDepth) -> None:
        name = f"{frame.index:06d}"
        confidence = png(bytes_from_confidence(result.confidence))
        (self._folder / CONFIDENCE / f"{name}.png").write_bytes(confidence)
        self._write_sigma(name, result.sigma_m)
        self._write_bound(FARTHER, name, result.farther_than_m)
        self._write_bound(NEARER, name, result.nearer_than_m)
        if self._format == "npz":
            (self._folder / DEPTH / f"{name}.npz").write_bytes(npz(depth_m=result.depth_m))
            return
        centimetres = centimetres_from_depth(result.depth_m)
        self._saturated_pixels += int(np.count_nonzero(centimetres == FARTHEST))
        (self._folder / DEPTH / f"{name}.png").write_bytes(png(centimetres))

    def _write_sigma(self, name: str, sigma_m: Map | None) -> None:
        if sigma_m is None:
            return
        (self._folder / SIGMA).mkdir(exist_ok=True)
        data = npz(sigma_m=sigma_m) if self._format == "npz" else png(rounded_centimetres(sigma_m))
        (self._folder / SIGMA / f"{name}.{self._format}").write_bytes(data)

    def _write_bound(self, folder: str, name: str, bound_m: Map) -> None:
        """In centimetres whatever the format: a bound is one value over wide areas, and small so."""
        if np.isfinite(bound_m).any():
            (self._folder / folder).mkdir(exist_ok=True)
            (self._folder / folder / f"{name}.png").write_bytes(png(centimetres_from_depth(bound_m)))

    def _write_picture(self, frame: Frame, result: RangedDepth) -> None:
        self._film.add(frame.stamp_ns, self._preview.draw(frame, result))

    def _finish(self) -> None:
        for thread in self._threads:
            thread.finish()
        self._film.close()
        self._rows.finish()
        self._poses.finish()
        rows = rows_from_csv((self._folder / TABLE).read_text(encoding="utf-8"))
        counts = Counts.of(rows, self._dropped, self._saturated_pixels)
        notes = self._notes.with_frames()
        self._summary = Summary.of(rows, counts, notes, tuple(self._warnings))
        warnings = (*self._source.warnings, *self._warnings)
        record = FlightRecord(
            flightdepth=__version__,
            source=self._source.model_copy(update={"warnings": warnings}),
            depth=DepthScaleNote(format=self._format),
            counts=counts,
            notes=notes,
        )
        write_atomic(self._folder / RECORD, (record.model_dump_json(indent=2) + "\n").encode())

    def _abandon(self) -> None:
        for thread in self._threads:
            thread.abandon()
        self._rows.abandon()
        self._poses.abandon()
        self._film.abandon()  # the last: on a full disk it fails once more


def npz(**maps: Map) -> bytes:
    """Maps float32 [H, W] under their names, not compressed: the last bits are noise."""
    file = io.BytesIO()
    np.savez(file, **maps)  # type: ignore[arg-type]
    return file.getvalue()


def check_target(target: Path) -> None:
    """Refuse to replace a folder that holds anything but an older result, and one that cannot be made or replaced."""
    place = target.resolve()
    if place.is_mount() or Path.cwd().is_relative_to(place):
        raise BadInput(
            f"output folder {target}",
            expected="a folder that can be replaced",
            got="a mount point" if place.is_mount() else f"{place}, where you are",
            mend="Give one inside it.",
        )
    parent = next((folder for folder in place.parents if folder.exists()), target)
    try:
        tempfile.TemporaryDirectory(dir=parent, prefix=f".{target.name}.").cleanup()
    except OSError as error:
        raise BadInput(
            f"output folder {target}", expected="a place to write", got=f"{parent}: {error.strerror}"
        ) from error
    if not target.exists():
        return
    if not target.is_dir():
        raise BadInput(
            f"output folder {target}", expected="a folder", got="a file", mend="Give another --out."
        )
    foreign = sorted(entry.name for entry in target.iterdir() if entry.name not in OWN_NAMES)
    if foreign:
        raise BadInput(
            f"output folder {target}",
            expected="a new folder, an empty one or an older result",
            got=f"one that holds {foreign[0]}",
            mend="Give another --out, so that nothing of yours is replaced.",
        )
