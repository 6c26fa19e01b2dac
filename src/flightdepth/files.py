"""Writing files and folders so that a crash never leaves a half-written one under its final name."""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

from flightdepth.errors import BadInput, FlightDepthError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

HEAD_BYTES = 512
NEW, OLD = "partial", "old"  # in the names of folders on their way in and out
LEFT_BY_A_LOOK = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})  # by Finder and Explorer
# Windows moves nothing that a program has open, and virus scanners and indexers open what is new, for a moment.
PATIENCE_S = (0.1, 0.2, 0.4, 0.8, 1.6) if os.name == "nt" else ()


def write_atomic(path: Path, data: bytes) -> None:
    """Write `data` to a temporary neighbour, flush it to the disk, then rename it over `path`."""
    with file_in_progress(path) as file:
        file.write(data)


@contextmanager
def file_in_progress(path: Path) -> Iterator[BinaryIO]:
    """Yield a temporary neighbour of `path` to write into; on success it takes its place, on any error it goes."""
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        Path(name).chmod(0o644)  # a temporary file is its owner's alone
        _patiently(Path(name).replace, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def bring_to_the_disk() -> None:
    """All that was written so far, many files at once; Windows has no call for that."""
    if hasattr(os, "sync"):
        os.sync()


def make_folder(option: str, path: Path) -> None:
    """The folder that an option of the command line names, made where it is missing."""
    if path.exists() and not path.is_dir():
        raise BadInput(option, expected="a folder", got=f"the file {path}")
    path.mkdir(parents=True, exist_ok=True)


def names_in(folder: Path) -> set[str]:
    """Names of what lies in a folder, but for what one look with Finder or Explorer leaves there."""
    return {entry.name for entry in folder.iterdir()} - LEFT_BY_A_LOOK


def check_parent(option: str, path: Path | None) -> None:
    """Refuse, before the work, a file named on the command line whose folder is missing or closed, or that is one."""
    if path is None:
        return
    if path.is_dir():
        raise BadInput(option, expected="a file", got=f"the folder {path}")
    if not path.parent.is_dir():
        raise BadInput(option, expected="a file in an existing folder", got=str(path))
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise BadInput(option, expected="a folder that may be written to", got=str(path.parent))


def names_flightdepth(head: bytes) -> bool:
    """Whether the first bytes of a PLY, LAS, MCAP or Rerun file say that flightdepth wrote it."""
    return b"flightdepth" in head


def refuse_to_replace(option: str, path: Path, is_own: Callable[[bytes], bool] = names_flightdepth) -> None:
    """Refuse a file, named on the command line, that stands already and is no older result; before the work.

    is_own  tells an older result by its first bytes
    """
    if not path.is_file():
        return
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head and not is_own(head):
        raise BadInput(
            f"{option} {path}",
            expected="a new file, or an older one of the same that flightdepth wrote",
            got="another file, which it would replace",
        )


def write_json(path: Path, value: Any) -> None:
    """Write `value` as indented JSON, atomically; NaN is refused because JSON has none: see `without_nan`."""
    write_atomic(path, (json.dumps(value, indent=2, allow_nan=False) + "\n").encode())


def without_nan(value: Any) -> Any:
    """The same nested value with None for NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def folder_in_progress(target: Path, *, kind: str = NEW) -> Iterator[Path]:
    """Yield a new folder beside `target`; on success it takes its place, on any error it is removed, and
    so are the parents made for it.

    An existing `target` stays untouched until the new one stands complete. What a killed process left here is cleared,
    where the system has locks that tell what is left.

    kind  stands in the new folder's name; only those of NEW are cleared

    Raises:
        FlightDepthError: `target` cannot be moved out of the way, as where Windows has a file of it open; the new
            folder stands beside it then.
    """
    target = target.absolute()
    new_parents = [parent for parent in target.parents if not parent.exists()]
    target.parent.mkdir(parents=True, exist_ok=True)
    _clear_up_after_the_killed(target)
    partial = _hidden_folder(target, kind)
    partial.chmod(0o755)
    lock = _lock(partial)
    try:
        yield partial
        if target.exists():
            _replace_folder(partial, target)
        else:
            move_folder(partial, target)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        for parent in new_parents:
            with suppress(OSError):  # somebody else put something there
                parent.rmdir()
        raise
    finally:
        if lock is not None:
            os.close(lock)


def free_name(target: Path, kind: str) -> Path:
    """NAME.KIND-N beside `target`, with the first N that is free."""
    names = (target.with_name(f"{target.name}.{kind}-{number}") for number in count(1))
    return next(name for name in names if not name.exists())


def move_folder(folder: Path, place: Path) -> Path:
    """Rename a folder, waiting a little where Windows forbids it for a moment; where it stands now."""
    _patiently(folder.rename, place)
    return place


def _patiently(move: Callable[[Path], object], place: Path) -> None:
    for pause_s in PATIENCE_S:
        try:
            move(place)
        except PermissionError:
            time.sleep(pause_s)
        else:
            return
    move(place)


def _hidden_folder(target: Path, kind: str) -> Path:
    """A new one beside `target`. Those of `tempfile` would be their owner's alone on Windows, by a list that stays."""
    while True:
        folder = target.with_name(f".{target.name}.{kind}-{secrets.token_hex(4)}")
        with suppress(FileExistsError):
            folder.mkdir()
            return folder


def _replace_folder(partial: Path, target: Path) -> None:
    old = _hidden_folder(target, OLD)
    try:
        move_folder(target, old / target.name)
    except OSError as error:
        old.rmdir()
        raise _beside(partial, target, error) from error
    move_folder(partial, target)
    # The new one stands: what cannot be removed (on NFS what a viewer has open) is no error of it, and goes next time.
    shutil.rmtree(old, ignore_errors=True)


def _beside(partial: Path, target: Path, error: OSError) -> FlightDepthError:
    """Name what is complete, and cannot take its place; the error that tells where it stands."""
    place = move_folder(partial, free_name(target, "new"))
    return FlightDepthError(
        f"{target} could not be replaced ({error.strerror or error}): is a file of it open in another program?"
        f" The new one stands in {place}"
    )


def _clear_up_after_the_killed(target: Path) -> None:
    """Put an older result back that was on its way out, and remove new ones that nobody works on any more."""
    for kind in (OLD, NEW):
        pattern = re.compile(rf"\.{re.escape(target.name)}\.{kind}-[a-z0-9_]{{8}}")
        for left in [path for path in target.parent.iterdir() if pattern.fullmatch(path.name)]:
            try:
                lock = _lock(left)
            except BlockingIOError:
                continue
            if lock is None:
                continue
            if kind == OLD and (left / target.name).exists() and not target.exists():
                (left / target.name).rename(target)
            shutil.rmtree(left, ignore_errors=True)
            os.close(lock)


def _lock(folder: Path) -> int | None:
    """A descriptor that keeps others from locking this folder until it is closed, or its process ends; None where the
    system has no such locks.

    Raises:
        BlockingIOError: another holds it.
    """
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


@contextmanager
def held(folder: Path, what: str, work: str, otherwise: str) -> Iterator[None]:
    """Let no other process do its work in a folder meanwhile, where the system has such locks; a killed one lets go.

    what, work, otherwise   for the refusal: what the folder is, what is done in it, and what else to do

    Raises:
        BadInput: one does already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        descriptor = _lock(folder)
    except BlockingIOError as error:
        raise BadInput(
            f"{what} {folder}",
            expected=f"no other {work} in it",
            got="one that is running",
            mend=f"Wait for it, stop it, or {otherwise}.",
        ) from error
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)
