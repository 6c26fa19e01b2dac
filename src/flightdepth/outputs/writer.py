"""One flight's output folder: depth and confidence a frame, the table, the record, the preview."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType

import numpy as np

from flightdepth import __version__
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.files import NEW, bring_to_the_disk, folder_in_progress, move_folder, names_in, write_atomic
from flightdepth.flight.records import Frame
from flightdepth.flight.still_parts import StillPart
from flightdepth.outputs.background import Background
from flightdepth.outputs.encoding import png
from flightdepth.outputs.film import Film
from flightdepth.outputs.frame_table import COLUMNS, FrameRow, cells_of, rows_from_csv
from flightdepth.outputs.interrupted import RECORDING, interrupted_name
from flightdepth.outputs.maps import DEPTH, KINDS, MapFiles
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
from flightdepth.runtimes.arrays import Flags

TABLE, POSES, RECORD, PREVIEW = "frames.csv", "poses.csv", "flight.json", "preview.mp4"
MASK, PROPOSED_MASK = "mask.png", "mask-proposed.png"
LOST = "could not be written"
OWN_NAMES = frozenset({*KINDS, TABLE, POSES, RECORD, PREVIEW, MASK, PROPOSED_MASK})


class FlightWriter:
    """Writes one flight into `target`, which appears when all of it stands; after an error nothing does.

    Depth files and preview are encoded on a thread each, at most a few frames behind `add`. An older result
    in `target` is replaced; a folder that holds anything else is refused.

    once     the flight cannot be flown again: a frame whose maps cannot be written is left out and counted, a preview
             that cannot be is left out, and what another error leaves is kept
    stopped  whether what Ctrl-C leaves is kept, too; what a kill leaves then waits for `interrupted.keep_interrupted`
    kept     where that then stands, once the writer is closed; None where all of it or nothing does
    lost     frames left out so far; `loss` is why the last one was
    """

    def __init__(
        self,
        target: Path,
        source: Source,
        preview: Preview,
        *,
        depth_format: DepthFormat = "png",
        once: bool = False,
        stopped: bool = False,
    ) -> None:
        check_target(target)
        self._target = target.resolve()  # a link stays, and what it leads to is written
        self._source, self._preview, self._format = source, preview, depth_format
        self._once, self._stopped, self._filmed = once, once or stopped, True
        self.kept: Path | None = None
        self.lost, self.loss = 0, ""
        self._notes, self._doubts = ReasonTally(), ReasonTally()  # of all frames
        self._dropped: dict[str, int] = {}
        self._warnings: list[str] = []  # that came up in flight

    def __enter__(self) -> FlightWriter:
        kind = RECORDING if self._stopped else NEW
        with ExitStack() as stack:
            self._folder = stack.enter_context(folder_in_progress(self._target, kind=kind))
            self._maps = MapFiles(self._folder, self._format)
            self._film = Film(self._folder / PREVIEW, *self._preview.size)
            self._rows = TableFile(self._folder / TABLE, COLUMNS)
            self._poses = TableFile(self._folder / POSES, POSE_COLUMNS)
            if self._stopped:
                self._write_record(Counts.of([], {}, 0), whole=False)  # for what a kill leaves
            self._files = Background(self._write_frame, name="depth files")
            self._pictures = Background(self._write_picture, name="preview")
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:  # renames the folder, or removes what stands there when an error passes through
            try:
                if error is not None:
                    raise error
                self._finish()
            except BaseException as failure:
                wanted = self._once or (self._stopped and isinstance(failure, KeyboardInterrupt))
                finished = wanted and failure is error and self._finished_early()
                try:
                    if not finished:
                        self._abandon()
                finally:
                    if (finished or self._once) and names_in(self._folder / DEPTH):
                        self._keep(failure)
                raise

    @property
    def summary(self) -> Summary:
        """Figures of the whole flight, once it is written."""
        return self._summary

    def add(self, frame: Frame, result: RangedDepth, pose: FramePose | None = None) -> None:
        """Write one frame; its arrays must not change afterwards."""
        written = self._files.put(frame, result, pose)
        self._pictures.put(frame, result, written)

    def note_dropped(self, dropped: Mapping[str, int]) -> None:
        """Record how much of the input could not be used, by reason."""
        self._dropped = dict(dropped)

    def warn(self, line: str) -> None:
        """Record what the user should know and only the flight itself showed."""
        self._warnings.append(line)

    def keep_mask(self, shown: Flags) -> None:
        """Write the mask that was given, [H, W]: its own file may be one of the result that this one replaces."""
        self._write_mask(MASK, shown)

    def propose_mask(self, part: StillPart) -> None:
        """Write a mask of what stands still, and warn of it."""
        self._write_mask(PROPOSED_MASK, part.shown)
        self.warn(
            f"{part.share:.1%} of the picture stands still while the camera turns, as landing gear and burned-in text"
            f" do: what is told there is wrong; look at {PROPOSED_MASK} beside the result, and give it as --mask"
        )

    def _write_mask(self, name: str, shown: Flags) -> None:
        write_atomic(self._folder / name, png(np.where(shown, np.uint8(255), np.uint8(0))))

    def _write_frame(self, frame: Frame, result: RangedDepth, pose: FramePose | None) -> bool:
        """Its maps, then its row: what has one is whole. False where it was left out."""
        try:
            self._maps.add(frame.index, result)
        except Exception as error:
            if not self._once:
                raise
            self._lose(frame, error)
            return False
        self._rows.add(cells_of(FrameRow.of(frame, result, self._source.utc)))
        if pose is not None:
            self._poses.add(pose_cells(pose))
        for note in result.notes:
            self._notes.add(note)
        if result.doubt is not None:
            self._doubts.add(result.doubt)
        return True

    def _lose(self, frame: Frame, error: Exception) -> None:
        if self.lost == 0:
            self.warn(f"frames that could not be written are left out: {error}")
        self.lost, self.loss = self.lost + 1, str(error)
        self._maps.remove(frame.index)

    def _write_picture(self, frame: Frame, result: RangedDepth, written: Future[bool]) -> None:
        if written.result() and self._filmed:
            with self._filming():
                self._film.add(frame.stamp_ns, self._preview.draw(frame, result))

    @contextmanager
    def _filming(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            if not self._once:
                raise
            self._filmed = False
            self.warn(f"no preview, which `view` and `convert` need, but for a .bt: {error}")

    def _finished_early(self) -> bool:
        """Finish what came so far; whether it could be."""
        try:
            self._finish(whole=False)
        except BaseException:  # a second Ctrl-C among them
            return False
        return True

    def _finish(self, *, whole: bool = True) -> None:
        self._files.finish()
        self._pictures.finish()
        if self.lost:
            self._dropped[LOST] = self.lost
        if self._filmed:
            with self._filming():
                self._film.close()
        if not self._filmed:
            with suppress(Exception):
                self._film.abandon()
            with suppress(OSError):  # Windows removes none that is still open
                (self._folder / PREVIEW).unlink(missing_ok=True)
        self._rows.finish()
        self._poses.finish()
        self._warnings += self._doubts.with_frames()
        rows = rows_from_csv((self._folder / TABLE).read_text(encoding="utf-8"))
        counts = Counts.of(rows, self._dropped, self._maps.saturated_pixels)
        self._summary = Summary.of(rows, counts, self._notes.with_frames(), tuple(self._warnings))
        bring_to_the_disk()  # else a loss of power soon after leaves empty maps in what is called whole
        self._write_record(counts, whole=whole)

    def _write_record(self, counts: Counts, *, whole: bool) -> None:
        warnings = (*self._source.warnings, *self._warnings)
        record = FlightRecord(
            flightdepth=__version__,
            source=self._source.model_copy(update={"warnings": warnings}),
            depth=DepthScaleNote(format=self._format),
            counts=counts,
            notes=self._notes.with_frames(),
            whole=whole,
        )
        write_atomic(self._folder / RECORD, (record.model_dump_json(indent=2) + "\n").encode())

    def _abandon(self) -> None:
        self._files.abandon()
        self._pictures.abandon()
        self._rows.abandon()
        self._poses.abandon()
        self._film.abandon()  # the last: on a full disk it fails once more

    def _keep(self, failure: BaseException) -> None:
        self.kept = move_folder(self._folder, interrupted_name(self._target))
        if isinstance(failure, Exception):
            raise FlightDepthError(f"{failure}; what was written stands in {self.kept}") from failure


def check_target(target: Path) -> None:
    """Refuse to replace a folder that holds anything but an older result, and one that cannot be made or replaced."""
    place = target.resolve()
    mounted = os.path.ismount(place)  # Path's own is not there on Windows before Python 3.12
    if mounted or Path.cwd().is_relative_to(place):
        raise BadInput(
            f"output folder {target}",
            expected="a folder that can be replaced",
            got="a mount point" if mounted else f"{place}, where you are",
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
    foreign = sorted(names_in(target) - OWN_NAMES)
    if foreign:
        raise BadInput(
            f"output folder {target}",
            expected="a new folder, an empty one or an older result",
            got=f"one that holds {foreign[0]}",
            mend="Give another --out, so that nothing of yours is replaced.",
        )
