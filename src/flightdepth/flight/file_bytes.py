"""Files as bytes and as text; a log that cannot be read is refused with the reason."""

from __future__ import annotations

from pathlib import Path

from flightdepth.errors import BadInput


def log_bytes(path: Path, limit: int = -1) -> bytes:
    """The first `limit` bytes of a log, all of them by default."""
    try:
        with path.open("rb") as file:
            return file.read(limit)
    except OSError as error:
        got = error.strerror or str(error)
        raise BadInput(f"telemetry {path}", expected="a log that can be read", got=got) from error


def head_of(path: Path, size: int) -> bytes:
    """The first `size` bytes of a file; none of a folder, or of what cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(size)
    except OSError:
        return b""


def as_text(data: bytes) -> str:
    """UTF-8, or UTF-16 where the first bytes say so; of another encoding only what is not ASCII is lost."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    return data.decode(encoding, errors="replace")
