"""Telemetry from the GPMF track inside a video: a Karma drone's velocity or a GoPro's GPS; the gyroscope."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.autopilot import Gate, Velocity
from flightdepth.flight.data_track import DAMAGED, track_packets
from flightdepth.flight.gopro_gps import gps_moments, gps_places, gps_velocities
from flightdepth.flight.gpmf import GpmfError, Stream, streams
from flightdepth.flight.order import rising
from flightdepth.flight.payload_clock import Interval, on_video_clock, spread
from flightdepth.flight.places import SEA_LEVEL, PlaceTrack
from flightdepth.flight.positions import Velocities, place_track
from flightdepth.flight.records import NS_PER_S, GyroscopeTrack, Telemetry, none_of
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.motion import Stamps

TimedStream = tuple[Interval, Stream]
GYROSCOPE, GPS = "GYRO", ("GPS9", "GPS5")
# A Karma's samples, the only ones with a clock, reach the camera by so much later than `on_video_clock` takes for
# granted: by the ways between pictures of one flight, and by the drone's pitch against the camera's accelerometer.
KARMA_LATE_NS = 280_000_000
STEPS_AROUND = 2  # of a position, before a sample and after it
MOST_WRONG_M_S = 2.0  # a position that moves faster than its velocity by more is reset, or damaged


def read_gpmf(path: Path) -> Telemetry | None:
    """What the GPMF track of a video says; None where there is none, as in a folder, or no velocity in it."""
    if path.is_dir():
        return None
    counts: Counter[str] = Counter()
    wanted = frozenset([*VELOCITIES, *PLACES, GYROSCOPE])
    found: dict[str, list[TimedStream]] = {}
    for interval, payload in payloads(path):
        try:
            parsed = streams(payload, wanted)
        except GpmfError:
            counts[DAMAGED] += 1
            continue
        for stream in parsed:
            if stream.values.shape[1] >= LEAST_COLUMNS.get(stream.key, 1):
                found.setdefault(stream.key, []).append((interval, stream))
            else:
                counts[DAMAGED] += 1
    for key, read_velocities in VELOCITIES.items():
        if key in found:
            log = _telemetry(found[key], read_velocities, found.get(GYROSCOPE, []), counts)
            return replace(log, places=_places(found), utc=_utc(found))
    return None


def payloads(path: Path) -> Iterator[tuple[Interval, bytes]]:
    """The payloads of the first GPMF track, with the time each spans since the first picture."""
    for interval, payload, _ in track_packets(path, "data", lambda data: data[:4] == b"DEVC"):
        yield interval, payload


def _telemetry(
    parts: list[TimedStream], read: Reader, gyroscope: list[TimedStream], counts: Counter[str]
) -> Telemetry:
    first = parts[0][1]
    found = read([stream for _, stream in parts], sample_times(parts), counts)
    gate = Gate(counts)
    for stamp_ns, velocity, sigma in zip(
        found.stamps_ns.tolist(), found.velocity_ned, found.sigma.tolist(), strict=True
    ):
        gate.take(stamp_ns, Velocity(velocity, sigma))
    kept = gate.velocities
    name = f"GPMF in the video: {first.name} of {first.device}, {len(kept)} velocities"
    if not kept:
        mend = "Give --telemetry LOG or --speed M_S."
        raise BadInput(
            name, expected="at least one velocity that is a number", got=none_of(counts), mend=mend
        )
    return Telemetry(name, tuple(kept), dict(+counts), _gyroscope(gyroscope))


def _places(found: dict[str, list[TimedStream]]) -> PlaceTrack | None:
    """Where the camera was, whoever tells the velocity; what is left out was counted there."""
    for key, read in PLACES.items():
        if parts := found.get(key):
            return read([stream for _, stream in parts], sample_times(parts), Counter())
    return None


def _utc(found: dict[str, list[TimedStream]]) -> UniversalTime | None:
    """By the camera's own receiver, whoever tells the velocity."""
    parts = next((found[key] for key in GPS if key in found), [])
    if not parts:
        return None
    return UniversalTime.by_readings(
        gps_moments([stream for _, stream in parts], sample_times(parts)), "satellites"
    )


def sample_times(parts: list[TimedStream]) -> Stamps:
    """Time of each sample: by its own clock if the first column is in s, else spread over its payload."""
    if all(stream.units[:1] == ("s",) for _, stream in parts):
        clocks, intervals = [stream.values[:, 0] for _, stream in parts], [interval for interval, _ in parts]
        return on_video_clock(clocks, intervals) - KARMA_LATE_NS
    return np.concatenate([spread(len(stream.values), interval) for interval, stream in parts])


def _gyroscope(parts: list[TimedStream]) -> GyroscopeTrack | None:
    """The camera's gyroscope. Models order its axes differently; the angle turned does not depend on it."""
    sound = [(interval, s) for interval, s in parts if s.values.shape[1] == 3 and np.isfinite(s.values).all()]
    if not sound:
        return None
    return GyroscopeTrack(sample_times(sound), np.concatenate([stream.values for _, stream in sound]))


def local_position_ned(streams: list[Stream], stamps: Stamps, counts: Counter[str]) -> Velocities:
    """Velocity north-east-down of LNED: time, position (3), velocity (3), as its positions move; its error is not told.

    The drone draws its position to the receiver's, while its velocity may stay wrong: by 0.4 m/s and 2 degrees for
    seconds on a Karma's flight. By how much the position moves faster, the median of a second's steps, is added.
    """
    told = np.concatenate([stream.values[:, -6:] for stream in streams])
    position, velocity = told[:, :-3], told[:, -3:]
    sound = np.flatnonzero(np.isfinite(told).all(axis=1))
    sound = sound[rising(stamps[sound].tolist())]
    if len(sound) > 1:
        steps, step_s = np.diff(position[sound], axis=0), np.diff(stamps[sound])[:, None] / NS_PER_S
        faster = steps / step_s - (velocity[sound[1:]] + velocity[sound[:-1]]) / 2
        tells = steps.any(axis=1) & (np.linalg.norm(faster, axis=1) < MOST_WRONG_M_S)
        faster[~tells] = 0.0
        around = [faster[max(i - STEPS_AROUND, 0) : i + STEPS_AROUND] for i in range(len(sound))]
        velocity[sound] += [np.median(each, axis=0) for each in around]
    return Velocities(stamps, velocity, np.full(len(velocity), np.nan))


def karma_places(streams: list[Stream], stamps: Stamps, counts: Counter[str]) -> PlaceTrack | None:
    """Where a Karma was, by GLPI: time, latitude, longitude, altitude above mean sea level, and more."""
    values = np.concatenate([stream.values[:, 1:4] for stream in streams])
    return place_track(stamps, values[:, :2], values[:, 2], SEA_LEVEL, counts)


Reader = Callable[[list[Stream], Stamps, Counter[str]], Velocities]
# The best first. A source of velocity more is a key and a function more.
VELOCITIES: dict[str, Reader] = {"LNED": local_position_ned, **dict.fromkeys(GPS, gps_velocities)}
PLACES = {"GLPI": karma_places, **dict.fromkeys(GPS, gps_places)}
LEAST_COLUMNS = {"LNED": 6, "GLPI": 5, **dict.fromkeys(GPS, 5)}  # fewer are damage
