"""Positions in ROS messages, in metres of a map or as latitudes and longitudes, and the velocities that they tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightdepth.flight.metric_positions import FARTHEST_M
from flightdepth.flight.places import AltitudeAbove, PlaceTrack
from flightdepth.flight.positions import (
    JUMPING,
    Velocities,
    place_track,
    velocities,
    velocities_by_fixes,
    without_jumps,
)
from flightdepth.flight.ros_messages import (
    ODOMETRY,
    POSE,
    POSE_WITH_COVARIANCE,
    axes_of,
    ned_from_map,
    stamp_of,
)
from flightdepth.flight.ros_records import RosMessage
from flightdepth.motion import Stamps, Vector

NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
PLACE_KINDS = (ODOMETRY, POSE, POSE_WITH_COVARIANCE)  # best first, and before NAV_SAT_FIX
NO_FIX = -1  # of NavSatStatus; newer drivers that tell none leave it at -2
HIGHEST_M = 1e5
FINEST_M = 1e-4  # what positions are rounded to at least
LEAST_PLACES = 5  # that tell a velocity


@dataclass(frozen=True, eq=False)
class Place:
    """A position [3] in NED, metres from where its map begins."""

    stamp_ns: int
    ned: Vector


@dataclass(frozen=True)
class Fix:
    """A position on Earth; the altitude is NaN where it is not told."""

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float


def place_of(message: RosMessage, content: Any) -> Place | None:
    """The position in a message; None where it is none on Earth, or one that the drone itself sees."""
    if axes_of(content.header.frame_id) in ("body", "camera"):
        return None
    given = (content.pose if message.kind == POSE else content.pose.pose).position
    place = np.array([given.x, given.y, given.z], dtype=np.float64)
    if not np.abs(place).max() < FARTHEST_M:
        return None
    return Place(stamp_of(content.header, message.log_ns), ned_from_map(content.header.frame_id) @ place)


def fix_of(message: RosMessage, content: Any) -> Fix | None:
    """The position of a satellite receiver; None where it has no fix.

    Its covariance says how far off the place may be, which neighbours share, not how far off their difference is.
    """
    latitude_deg, longitude_deg = float(content.latitude), float(content.longitude)
    on_earth = abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180  # False for NaN too
    # DJI's driver tells no status, and 0, 0 before the first fix.
    if content.status.status == NO_FIX or not on_earth or latitude_deg == longitude_deg == 0:
        return None
    told = abs(content.altitude) < HIGHEST_M
    altitude_m = float(content.altitude) if told else np.nan
    return Fix(stamp_of(content.header, message.log_ns), latitude_deg, longitude_deg, altitude_m)


def velocities_of_places(places: Sequence[Place], counts: Counter[str]) -> Velocities:
    """Slopes of positions in any order; none where there are too few. Those that jump are left out and counted."""
    placed = {place.stamp_ns: place.ned for place in places}
    if len(placed) < LEAST_PLACES:
        return Velocities.none()
    stamps_ns = np.array(sorted(placed), dtype=np.int64)
    ned = np.stack([placed[stamp_ns] for stamp_ns in stamps_ns.tolist()])
    kept = without_jumps(ned)
    counts[JUMPING] += int((~kept).sum())
    return velocities(stamps_ns[kept], ned[kept], steps_m=(FINEST_M, FINEST_M))


def velocities_of_fixes(fixes: Sequence[Fix], counts: Counter[str]) -> Velocities:
    """Slopes of fixes in any order; one without an altitude is as high as those around it, or all are level."""
    stamps_ns, places_deg, altitudes_m = columns_of(fixes)
    if len(stamps_ns) < LEAST_PLACES:
        return Velocities.none()
    return velocities_by_fixes(stamps_ns, places_deg, altitudes_m, counts)


def track_of_fixes(
    fixes: Sequence[Fix], zero_ns: int, above: AltitudeAbove, counts: Counter[str]
) -> PlaceTrack | None:
    """Where the drone was, by fixes in any order, on a clock whose 0 is `zero_ns`."""
    stamps_ns, places_deg, altitudes_m = columns_of(fixes)
    return place_track(stamps_ns - zero_ns, places_deg, altitudes_m, above, counts)


def columns_of(fixes: Sequence[Fix]) -> tuple[Stamps, Vector, Vector]:
    """Rising stamps [n], latitudes and longitudes [n, 2] and altitudes [n] of fixes in any order."""
    fixed = {fix.stamp_ns: fix for fix in fixes}
    rising = [fixed[stamp_ns] for stamp_ns in sorted(fixed)]
    places_deg = np.array([(fix.latitude_deg, fix.longitude_deg) for fix in rising]).reshape(-1, 2)
    altitudes_m = np.array([fix.altitude_m for fix in rising], dtype=np.float64)
    return np.array([fix.stamp_ns for fix in rising], dtype=np.int64), places_deg, altitudes_m
