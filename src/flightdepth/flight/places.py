"""Where on Earth a drone was, at any time between two fixes of its log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flightdepth.motion import Stamps, Vector

AltitudeAbove = Literal["mean sea level", "the WGS 84 ellipsoid"]
SEA_LEVEL: AltitudeAbove = "mean sea level"
ELLIPSOID: AltitudeAbove = "the WGS 84 ellipsoid"
BRIDGED_NS = 5_000_000_000  # between two fixes; a receiver that rounds to 11 m has one every few seconds


@dataclass(frozen=True, eq=False)
class PlaceTrack:
    """Fixes of a drone: stamps int64 [n], rising; latitude and longitude (degrees, WGS 84) and altitude (m) [n, 3].

    An altitude is NaN where it is not told; `above` is what all of them count from, None where none is told.
    """

    stamps_ns: Stamps
    places: Vector
    above: AltitudeAbove | None

    def at(self, stamp_ns: int) -> Vector:
        """Latitude, longitude and altitude (3,), straight between the fixes before and after; NaN where one lacks."""
        after = int(np.searchsorted(self.stamps_ns, stamp_ns))
        around = self.stamps_ns[max(after - 1, 0) : after + 1]
        if len(around) and around[-1] == stamp_ns:
            return np.array(self.places[after])
        if len(around) < 2 or around[1] - around[0] > BRIDGED_NS:
            return np.full(3, np.nan)
        step = self.places[after] - self.places[after - 1]
        step[1] = _signed_deg(step[1])  # across the date line too
        place: Vector = self.places[after - 1] + step * ((stamp_ns - around[0]) / (around[1] - around[0]))
        place[1] = _signed_deg(place[1])
        return place

    def later_by(self, offset_ns: int) -> PlaceTrack:
        """The same fixes with `offset_ns` added to their times."""
        return replace(self, stamps_ns=self.stamps_ns + offset_ns)


def _signed_deg(longitude: float) -> float:
    return (longitude + 180) % 360 - 180
