"""A line of a telemetry CSV: what its cells tell, or what is wrong with them and in which line."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.csv_columns import (
    ALONG,
    ALTITUDE,
    ATTITUDE,
    BY_PLACES,
    METRES,
    PLACE,
    SIGMA,
    SPEED,
    STAMP,
    TIME,
    UTC,
    VELOCITY,
    Columns,
)
from flightdepth.flight.gimbal import looking_along
from flightdepth.flight.metric_positions import FARTHEST_M
from flightdepth.flight.records import (
    FASTEST_M_S,
    LATEST_NS,
    NS_PER_S,
    AttitudeSample,
    Sample,
    VelocityFrame,
    VelocitySample,
    northwards,
    seconds,
)
from flightdepth.flight.universal_time import can_be
from flightdepth.motion import Vector, is_rotation


class Row(NamedTuple):
    """Time, the velocity and the attitude that a line itself tells, where it is and its universal time.

    metres  north, east, down; NaN where they are not read
    place   latitude and longitude (degrees), altitude (m); NaN where they are not told
    utc_ns  since 1970; None where it is not told
    """

    stamp_ns: int
    samples: list[Sample]
    metres: list[float]
    place: list[float]
    utc_ns: int | None

    @classmethod
    def of(cls, where: str, columns: Columns, cells: Sequence[str]) -> Row:
        """Read the cells of the line that `where` names."""
        if len(cells) != len(columns.header):
            raise BadInput(where, expected=f"{len(columns.header)} cells", got=str(len(cells)))
        line = _Line(where, columns, dict(zip(columns.header, cells, strict=True)))
        stamp_ns = line.stamp_ns()
        return cls(stamp_ns, line.samples(stamp_ns), line.metres(), line.place(), line.utc_ns())


@dataclass(frozen=True)
class _Line:
    """Cells by the names of their columns; each is read when it is asked for, and refused where it is wrong."""

    where: str
    columns: Columns
    cells: Mapping[str, str]

    def stamp_ns(self) -> int:
        try:
            told = int(self.cells[STAMP]) if self.columns.time == STAMP else self._number(TIME) * NS_PER_S
        except ValueError as error:
            expected = f"{STAMP} as a whole number"
            raise BadInput(self.where, expected=expected, got=repr(self.cells[STAMP])) from error
        if abs(told) > LATEST_NS:
            got = self.cells[self.columns.time].strip()
            raise BadInput(self.where, expected=f"a time within {seconds(LATEST_NS)}", got=got)
        return round(told)

    def samples(self, stamp_ns: int) -> list[Sample]:
        velocity = None if self.columns.frame in (ALONG, BY_PLACES) else self._velocity()
        sigma = self._optional(SIGMA)
        try:
            samples: list[Sample] = []
            if velocity is not None:
                frame: VelocityFrame = "camera" if self.columns.frame == "camera" else "world"
                samples.append(VelocitySample(stamp_ns, velocity, frame, sigma))
            if self.columns.attitude:
                numbers = self._numbers(ATTITUDE[self.columns.attitude])
                angles = self.columns.attitude == "angles"
                samples.append(
                    AttitudeSample(stamp_ns, looking_along(*numbers) if angles else _unit(numbers))
                )
        except BadInput as error:
            raise BadInput(f"{self.where}: {error}") from error
        return samples

    def metres(self) -> list[float]:
        if self.columns.frame != ALONG:
            return [math.nan] * len(METRES)
        metres = [self._number(name) for name in METRES]
        if (farthest := max(map(abs, metres))) >= FARTHEST_M:
            expected = f"a position within {FARTHEST_M:g} m"
            raise BadInput(self.where, expected=expected, got=f"{farthest:g}")
        return metres

    def place(self) -> list[float]:
        told = [self._optional(name) for name in (*PLACE, ALTITUDE)]
        place = [math.nan if number is None else number for number in told]
        if abs(place[0]) > 90 or abs(place[1]) > 180:
            got = ", ".join(f"{number:g}" for number in place[:2])
            expected = "a latitude within 90 degrees and a longitude within 180"
            raise BadInput(self.where, expected=expected, got=got)
        return place

    def utc_ns(self) -> int | None:
        cell = self.cells[UTC].strip() if UTC in self.columns.optional else ""
        if not cell:
            return None
        told = int(cell) if re.fullmatch(r"\d{1,19}", cell, re.ASCII) else 0
        if not can_be(told):
            raise BadInput(self.where, expected=f"{UTC} as whole nanoseconds since 1970", got=repr(cell))
        return told

    def _velocity(self) -> Vector:
        velocity = self._numbers(VELOCITY[self.columns.frame])
        if self.columns.frame == SPEED:
            if velocity[0] < 0:
                raise BadInput(self.where, expected="a speed of 0 m/s or more", got=f"{velocity[0]:g}")
            velocity = northwards(velocity[0])
        if (speed := float(np.linalg.norm(velocity))) > FASTEST_M_S:
            expected, mend = f"at most {FASTEST_M_S:g} m/s", "Velocities are in m/s."
            raise BadInput(self.where, expected=expected, got=f"{speed:.0f}", mend=mend)
        return velocity

    def _numbers(self, names: Sequence[str]) -> Vector:
        return np.array([self._number(name) for name in names])

    def _optional(self, name: str) -> float | None:
        told = name in self.columns.optional and self.cells[name].strip()
        return self._number(name) if told else None

    def _number(self, name: str) -> float:
        try:
            number = float(self.cells[name])
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            got = repr(self.cells[name].strip())
            raise BadInput(self.where, expected=f"a finite number for {name}", got=got)
        return number


def _unit(quaternion: Vector) -> Vector:
    if not is_rotation(quaternion):
        got = ", ".join(f"{number:g}" for number in quaternion)
        raise BadInput("attitude", expected="a quaternion qw, qx, qy, qz of length 1", got=got)
    return quaternion
