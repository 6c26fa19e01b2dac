"""The Blender that is installed, and one process of it that answers requests for scenes."""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightdepth.errors import BadInput, FlightDepthError

SCRIPT = Path(__file__).with_name("blender_script.py")
VARIABLE = "FLIGHTDEPTH_BLENDER"
ENVIRONMENT = Path(".venv-blender/bin/python")  # what `make blender-env` makes
SOURCES = Path(__file__).parents[3]  # the checkout, where this is one
PREFIX = "flightdepth "  # of an answer
START_TIMEOUT_S, END_TIMEOUT_S = 120.0, 2.0
MEND = f"`make blender-env`, or install Blender, or name one in {VARIABLE} (docs/stillbox-blender.md)."
LAST_LINES = 4  # of Blender's output in an error


@dataclass(frozen=True)
class Program:
    """A Blender: the program, or a Python that has bpy; and how it was found."""

    path: Path
    found_by: str

    @property
    def command(self) -> tuple[str, ...]:
        """What runs our script."""
        if self.path.name.startswith("python"):
            return (str(self.path), "-u", str(SCRIPT))
        quiet = ("--background", "--factory-startup", "--python-exit-code", "3")
        return (str(self.path), *quiet, "--python", str(SCRIPT))


def find_blender() -> Program | None:
    """The Blender that the environment variable names, else .venv-blender, else `blender` on the PATH.

    Raises:
        BadInput: the variable names no program.
    """
    named = os.environ.get(VARIABLE)
    if named:
        path = shutil.which(named)
        if path is None:
            raise BadInput(VARIABLE, expected="Blender, or a Python that has bpy", got=named)
        return Program(Path(path), VARIABLE)
    for folder in (Path.cwd(), SOURCES):
        if (folder / ENVIRONMENT).is_file():
            return Program(folder / ENVIRONMENT, str(ENVIRONMENT.parents[1]))
    path = shutil.which("blender")
    return Program(Path(path), "PATH") if path else None


def needed_blender() -> Program:
    """As `find_blender`; an error that says what to do where there is none."""
    program = find_blender()
    if program is None:
        raise FlightDepthError(f"Blender is not installed: {MEND}")
    return program


class BlenderProcess:
    """Blender with our script, ready when it has greeted; one that failed is of no more use. `close` ends it."""

    def __init__(self, program: Program, folder: Path) -> None:
        """`folder` takes Blender's output; it is the caller's to remove."""
        self.program = program
        self.processor_s = 0.0  # that Blender has used, on all cores
        self._log = folder / "blender.log"
        with self._log.open("wb") as log:
            try:
                self._process = subprocess.Popen(
                    program.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log,
                    env=os.environ | {"PYTHONUNBUFFERED": "1"},
                )  # fmt: skip
            except OSError as error:
                raise FlightDepthError(f"{program.path} does not start: {error}") from error
        self._answers: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, name="blender", daemon=True)
        self._reader.start()
        try:
            self.version = str(self._next(START_TIMEOUT_S)["ready"])
        except BaseException:
            self.close()
            raise

    def ask(self, request: dict[str, Any], frames: int, timeout_s: float) -> Iterator[int]:
        """Send a request; the number of each frame as its file stands. Each may take `timeout_s`.

        Raises:
            FlightDepthError: Blender failed, ended or took too long.
        """
        pipe = self._process.stdin
        assert pipe is not None
        try:
            pipe.write(json.dumps(request).encode() + b"\n")
            pipe.flush()
        except (OSError, ValueError) as error:  # ended by itself, or closed after another thread's failure
            raise self._ended() from error
        for _ in range(frames):
            answer = self._next(timeout_s)
            self.processor_s = float(answer["processor_s"])
            yield int(answer["frame"])

    def close(self) -> None:
        """End Blender, by force where it does not end by itself."""
        pipe = self._process.stdin
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
        try:
            self._process.wait(timeout=END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _read(self) -> None:
        """Hand over answers as they come; None at the end."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(PREFIX.encode()):
                self._answers.put(json.loads(line[len(PREFIX) :]))
        self._answers.put(None)

    def _next(self, timeout_s: float) -> dict[str, Any]:
        try:
            answer = self._answers.get(timeout=timeout_s)
        except queue.Empty:
            raise FlightDepthError(
                f"Blender ({self.program.path}) gave no answer in {timeout_s:g} s"
            ) from None
        if answer is None:
            raise self._ended()
        if "error" in answer:
            raise FlightDepthError(f"Blender could not render the scene: {answer['error']}")
        return answer

    def _ended(self) -> FlightDepthError:
        """The process is gone: why, in its own last words."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5)
        lines = self._log.read_text(errors="replace").split("\n") if self._log.exists() else []
        said = " | ".join([line.strip() for line in lines if line.strip()][-LAST_LINES:])
        code = self._process.returncode
        return FlightDepthError(
            f"Blender ({self.program.path}) ended with code {code}: {said or 'it said nothing'}"
        )
