"""A sink that writes what `flightdepth run` writes; results that come while the disk is busy are missed."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from flightdepth.errors import BadInput
from flightdepth.flight.records import Frame
from flightdepth.live.status import LiveResult
from flightdepth.outputs.preview import Preview
from flightdepth.outputs.record import Source
from flightdepth.outputs.writer import FlightWriter, check_target
from flightdepth.weights.card import NetworkCard


class Recorder:
    """Writes results into `target`, which appears when `close` has finished it. Times begin with the first."""

    def __init__(
        self, target: Path, network: NetworkCard, settings: dict[str, bool | int | float | str | None]
    ) -> None:
        check_target(target)  # now, not after the flight
        self._target, self._network, self._settings = target, network, settings
        self._stack = ExitStack()
        self._writer: FlightWriter | None = None
        self._size = (0, 0)
        self._first_ns = 0
        self._count = 0

    def __call__(self, result: LiveResult) -> None:
        """Write one result."""
        writer = self._writer or self._begin(result)
        size = (result.camera.width, result.camera.height)
        if size != self._size:
            raise BadInput("recording", expected=f"pictures of {self._size}", got=str(size))
        frame = Frame(self._count, result.stamp_ns - self._first_ns, result.image)
        writer.add(frame, result.depth)
        self._count += 1

    def close(self, dropped: dict[str, int]) -> None:
        """Finish the folder; `dropped`: pictures that are missing from it, by reason."""
        if self._writer is not None:
            self._writer.note_dropped(dropped)
        self._stack.close()

    def _begin(self, result: LiveResult) -> FlightWriter:
        source = Source(
            flight=str(self._settings["video"]),
            telemetry=str(self._settings["mavlink"] or self._settings["telemetry"]),
            camera=result.camera,
            network=self._network,
            settings=self._settings,
        )
        self._size, self._first_ns = (result.camera.width, result.camera.height), result.stamp_ns
        writer = FlightWriter(self._target, source, Preview(*self._size))
        self._writer = self._stack.enter_context(writer)
        return self._writer
