"""PX4's ULog (.ulg) through pyulog, which trusts the bytes of a file: here damage costs neither hours nor gigabytes."""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
from io import BufferedReader, StringIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

from flightdepth.errors import BadInput, MissingExtra

MAGIC = b"ULog\x01\x12\x35"
# A message's size is a 16-bit number, so no honest format describes more fields.
MAX_FIELDS = 65535
# pyulog searches damaged stretches byte by byte, and may read 64 kB for each; a sound log is read once.
MAX_REREADS = 30


def load(path: Path, topics: list[str]) -> tuple[Any, bool, bool]:
    """pyulog's view of the file, whether it ends in the middle of a message, and whether another log follows in it.

    Its prints go nowhere.
    """
    try:
        from pyulog import ULog
    except ModuleNotFoundError as error:
        raise MissingExtra(f"reading the ULog {path.name}", "px4") from error
    try:
        size = path.stat().st_size
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()), path.open("rb") as file:
            refuse_bombs(ULog(BoundedFile(file, size, size), parse_header_only=True).message_formats)
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                end = data.find(MAGIC, 1)
            file.seek(0)
            bounded = BoundedFile(file, size, end if end > 0 else size)
            return ULog(bounded, topics), bounded.cut, end > 0
    except Exception as error:  # pyulog raises whatever a damaged byte leads to
        got = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        got = got or type(error).__name__
        raise BadInput(f"telemetry {path}", expected="a ULog that can be read", got=got) from error


class BoundedFile:
    """A file that ends early, at `end` or for a reader which never comes to an end; notes a read past the end."""

    def __init__(self, file: BufferedReader, size: int, end: int) -> None:
        self._file, self._at, self._end = file, file.tell(), end
        self._left = MAX_REREADS * size + 65536
        self.cut = False

    def read(self, size: int) -> bytes:
        """Up to `size` bytes; none once too much was read."""
        data = self._file.read(min(size, max(0, self._end - self._at))) if self._left > 0 else b""
        self._at += len(data)
        self._left -= len(data) + 3
        self.cut |= 0 < len(data) < size or (not data and size > 3) or self._left <= 0
        return data

    def seek(self, offset: int, whence: int = 0) -> int:
        """As any file, but before the beginning is an error that pyulog takes for damage and goes on."""
        try:
            self._at = self._file.seek(offset, whence)
        except OSError as error:
            raise ValueError(f"no such place in the file: {offset}") from error
        return self._at

    def tell(self) -> int:
        """As any file."""
        return self._at

    def close(self) -> None:
        """Nothing: who opened the file closes it, also after an error."""


def refuse_bombs(formats: dict[str, Any]) -> None:
    """Refuse formats that unfold to more fields than a message can hold, or hold themselves."""
    sizes: dict[str, int] = {}

    def size(name: str, inside: tuple[str, ...]) -> int:
        if name not in formats:
            return 1
        if name in inside:
            raise ValueError(f"a format that holds itself ({name})")
        if name not in sizes:
            fields = formats[name].fields
            sizes[name] = sum(max(count, 1) * size(kind, (*inside, name)) for kind, count, _ in fields)
        if sizes[name] > MAX_FIELDS:
            raise ValueError(f"a format of {sizes[name]} fields ({name})")
        return sizes[name]

    for name in formats:
        size(name, ())
