"""A CSV that goes to the disk row by row, so that a long flight takes no memory."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path


class TableFile:
    """Writes `path` as rows come: a killed process leaves those before.

    For a folder that nobody looks into before it is complete.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(columns)

    def add(self, cells: Sequence[object]) -> None:
        """Append one row; one that the disk refuses waits for the next, or for `finish`."""
        self._writer.writerow(cells)
        with suppress(OSError):
            self._file.flush()

    def finish(self) -> None:
        """Bring all rows to the disk."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it stands; for one that will be removed."""
        with suppress(OSError):  # a full disk refuses the last rows once more
            self._file.close()
