"""Velocity from a GoPro's own GPS: GPS5 (HERO5 to HERO10) and GPS9 (HERO11 on) of its GPMF track.

Columns after GoPro's public description (github.com/gopro/gpmf-parser, README): latitude, longitude in degrees,
height in metres, speed over ground and in space in m/s; GPS9 goes on with days, seconds, dilution of precision and
fix (0 none, 2 or 3 dimensions). Beside GPS5 stand GPSF, the fix, and GPSU, the time. The direction comes from the
positions, the speed from the receiver, which measures it by the Doppler shift and so better than positions tell.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.gpmf import Stream
from flightdepth.flight.order import rising_counted
from flightdepth.flight.places import ELLIPSOID, SEA_LEVEL, PlaceTrack
from flightdepth.flight.positions import Velocities, place_track, velocities_by_places
from flightdepth.flight.universal_time import unix_ns
from flightdepth.motion import Stamps, Vector

LEAST_FIX = 2
BY_THE_SEA = "MSLV"
FIX_COLUMN, SPEED_COLUMN, DAYS_COLUMN = 8, 4, 5
DAY_NS = 86_400_000_000_000
YEAR_2000_NS = unix_ns(datetime(2000, 1, 1, tzinfo=UTC))
SLOWEST_M_S = 0.5  # below it the receiver's speed is not spread over a direction that positions hardly tell
NO_FIX = "GPS samples without a fix"


def gps_velocities(streams: list[Stream], stamps_ns: Stamps, counts: Counter[str]) -> Velocities:
    """Velocity north-east-down at the fixes of streams whose samples have `stamps_ns`; none where none has a fix."""
    stamps_ns, values = _fixed(streams, stamps_ns, counts)
    if not len(values):
        return Velocities.none()
    found = velocities_by_places(stamps_ns, values[:, :2], values[:, 2], counts)
    speed = np.interp(found.stamps_ns, stamps_ns, values[:, SPEED_COLUMN])
    return replace(found, velocity_ned=_at_speed(found.velocity_ned, speed))


def gps_places(streams: list[Stream], stamps_ns: Stamps, counts: Counter[str]) -> PlaceTrack | None:
    """Where the camera was; heights count from the ellipsoid, but where a newer model says from the sea level."""
    stamps_ns, values = _fixed(streams, stamps_ns, counts)
    above = SEA_LEVEL if streams[0].altitude == BY_THE_SEA else ELLIPSOID
    return place_track(stamps_ns, values[:, :2], values[:, 2], above, counts)


def gps_moments(streams: list[Stream], stamps_ns: Stamps) -> list[tuple[int, int]]:
    """Pairs of a stamp and its UTC, both ns: of each sample with a fix in GPS9, of the first of a payload in GPS5."""
    pairs: list[tuple[int, int]] = []
    first = 0
    for stream in streams:
        stamps, fixed = stamps_ns[first : first + len(stream.values)].tolist(), _has_fix(stream)
        first += len(stream.values)
        if stream.values.shape[1] > FIX_COLUMN:
            days_s = stream.values[:, DAYS_COLUMN : DAYS_COLUMN + 2]
            told = fixed & np.isfinite(days_s).all(axis=1)
            pairs += [(stamps[i], _of_days_ns(*days_s[i].tolist())) for i in np.flatnonzero(told)]
        elif fixed.all() and (utc_ns := _of_text_ns(stream.utc)) is not None:
            pairs.append((stamps[0], utc_ns))
    return pairs


def _of_days_ns(days: float, of_day_s: float) -> int:
    """Nanoseconds since 1970 of days since 2000 and seconds in the day, which come in milliseconds."""
    return int(days) * DAY_NS + round(of_day_s * 1000) * 1_000_000 + YEAR_2000_NS


def _of_text_ns(told: str) -> int | None:
    """Nanoseconds since 1970 of "yymmddhhmmss.sss"; None of anything else."""
    try:
        return unix_ns(datetime.strptime(told, "%y%m%d%H%M%S.%f").replace(tzinfo=UTC))
    except ValueError:
        return None


def _fixed(streams: list[Stream], stamps_ns: Stamps, counts: Counter[str]) -> tuple[Stamps, Vector]:
    """Those of the streams' samples that have a fix, at rising stamps, and their stamps."""
    # A payload may have columns that its neighbours lack.
    values = np.concatenate([stream.values[:, : SPEED_COLUMN + 1] for stream in streams])
    good = np.concatenate([_has_fix(stream) for stream in streams]) & np.isfinite(values).all(axis=1)
    if not good.all():
        counts[NO_FIX] += int((~good).sum())
    stamps_ns, values = stamps_ns[good], values[good]
    later = rising_counted(stamps_ns.tolist(), counts, "GPS samples")
    return stamps_ns[later], values[later]


def _has_fix(stream: Stream) -> NDArray[np.bool_]:
    if stream.values.shape[1] > FIX_COLUMN:
        return np.asarray(stream.values[:, FIX_COLUMN] >= LEAST_FIX)
    return np.full(len(stream.values), stream.fix is None or stream.fix >= LEAST_FIX)


def _at_speed(velocity: Vector, speed: Vector) -> Vector:
    """Velocities [n, 3] brought to the receiver's speed [n] where positions tell their direction."""
    length = np.linalg.norm(velocity, axis=1)
    told = (length > SLOWEST_M_S) & (speed > SLOWEST_M_S)
    return np.asarray(velocity * np.where(told, speed / np.maximum(length, SLOWEST_M_S), 1.0)[:, None])
