"""Where a flight's cloud lies on Earth: its local frame, brought to the positions that the log tells.

The local frame is summed velocities, so its origin is anywhere; one shift brings it to the positions. Where its north
is no true one, one rotation about the vertical comes with it. Both leave the least sum of distances, not of their
squares, so that a receiver that strays for a while pulls little. All is fitted in metres about the first position
(azimuthal equidistant); what lies on the level plane of a drone that flies over a curved Earth stays at its height.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flightdepth.flight.places import AltitudeAbove
from flightdepth.flight.way_length import fitted, longer, said_longer
from flightdepth.motion import Vector
from flightdepth.outputs.poses import FramePose
from flightdepth.outputs.voxels import Cloud

TURN_TOLD = 0.05  # rad: half of the positions may lie so far aside, seen over the way's spread
# Half of the positions farther off than both: the way flown is not theirs.
RECEIVER_M, STRAYING = 5.0, 0.1  # beyond a receiver's error; of the way's spread


class LocalOnlyError(ValueError):
    """Why nobody knows where on Earth a flight was."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """How points east, north, up become UTM's.

    centre_deg  latitude and longitude of the plane's origin
    turn, shift_m  plane = turn * local + shift
    up_m        what is added to heights; None where the log tells no altitude, and they stay local
    crs         of the UTM zone, a pyproj.CRS
    apart_m     distances between the flown way, so placed, and the log's positions: median and 95 %
    apart_up_m  the same of heights; None with `up_m`
    spread_m    mean distance of the flown way from its middle
    longer      by what share the flown way is longer than the positions'; 0 where their error may hide it
    frames      how many have a position, and of how many
    """

    centre_deg: tuple[float, float]
    turn: complex
    shift_m: complex
    up_m: float | None
    crs: Any
    apart_m: tuple[float, float]
    apart_up_m: tuple[float, float] | None
    spread_m: float
    longer: float
    frames: tuple[int, int]

    @property
    def follows(self) -> bool:
        """Whether the way flown may be that of the log's positions."""
        return self.apart_m[0] <= max(RECEIVER_M, STRAYING * self.spread_m)

    def in_utm(self, cloud: Cloud) -> Cloud:
        """The cloud in UTM."""
        import pyproj

        east_m, north_m = pyproj.Proj(self.crs)(*self._longitude_latitude(cloud.points_m[:, :2]))
        return replace(cloud, points_m=np.c_[east_m, north_m, cloud.points_m[:, 2] + (self.up_m or 0.0)])

    def described(self, above: AltitudeAbove | None) -> str:
        """The frame for people, a line each; `above` is what the log's altitudes count from."""
        heights = "the first camera, since the log tells no altitude" if self.up_m is None else above
        longitude, latitude = self._longitude_latitude(np.zeros((1, 2)))
        height = "" if self.up_m is None else f", height {self.up_m:.1f} m"
        turned = "" if self.turn == 1 else f", turned by {np.degrees(np.angle(self.turn)):.1f} degrees,"
        up = "" if self.apart_up_m is None else ", in height {:.2f} m ({:.2f} m)".format(*self.apart_up_m)
        lines = (
            f"{self.crs.name} (EPSG:{self.crs.to_epsg()}), heights above {heights}",
            f"first camera at latitude {latitude[0]:.6f}, longitude {longitude[0]:.6f}{height}",
            f"the way flown{turned} lies {self.apart_m[0]:.2f} m from the log's positions"
            f" (95 % within {self.apart_m[1]:.2f} m){up}, at {self.frames[0]:,} of {self.frames[1]:,} frames",
            *said_longer(self.longer),
        )
        return "\n".join(lines)

    def _longitude_latitude(self, points_m: Vector) -> tuple[Vector, Vector]:
        """Degrees [N] of points east, north [N, 2]."""
        plane = self.turn * (points_m[:, 0] + 1j * points_m[:, 1]) + self.shift_m
        longitude, latitude = plane_about(self.centre_deg)(plane.real, plane.imag, inverse=True)
        return longitude, latitude


def georeference(poses: Iterable[FramePose], *, true_north: bool) -> Georeference:
    """From poses of one segment. Where their north is not true, the way flown must tell it.

    Raises:
        LocalOnlyError: they cannot be placed.
    """
    poses = list(poses)
    known = [pose for pose in poses if np.isfinite(pose.place[:2]).all()]
    if not known:
        raise LocalOnlyError("poses.csv tells no latitude and longitude")
    if any(pose.attitude == "assumed" for pose in known):
        raise LocalOnlyError("the log tells no attitude, so north and up are only assumed")
    ned, places = np.stack([pose.position_ned for pose in known]), np.stack([pose.place for pose in known])
    centre_deg = float(places[0, 0]), float(places[0, 1])
    crs = utm_crs(*centre_deg)
    east_m, north_m = plane_about(centre_deg)(places[:, 1], places[:, 0])
    told, flown = east_m + 1j * north_m, ned[:, 1] + 1j * ned[:, 0]
    turn, shift_m = fitted(flown, told, turns=not true_north)
    apart_m, spread_m = np.abs(turn * flown + shift_m - told), float(np.abs(flown - flown.mean()).mean())
    if not true_north and np.median(apart_m) >= TURN_TOLD * spread_m:
        raise LocalOnlyError(
            "north may be any direction, and the way flown is too short, or too unlike the log's positions, to tell"
        )
    heights_m = (places[:, 2] + ned[:, 2])[np.isfinite(places[:, 2])]
    up_m = float(np.median(heights_m)) if len(heights_m) else None
    apart_up_m = None if up_m is None else median_and_most(np.abs(heights_m - up_m))
    return Georeference(
        centre_deg,
        turn,
        shift_m,
        up_m,
        crs,
        apart_m=median_and_most(apart_m),
        apart_up_m=apart_up_m,
        spread_m=spread_m,
        longer=longer(flown, told),
        frames=(len(known), len(poses)),
    )


def median_and_most(distances_m: Vector) -> tuple[float, float]:
    """The median and 95 % of distances [n]."""
    median_m, most_m = np.percentile(distances_m, [50, 95]).tolist()
    return median_m, most_m


def plane_about(centre_deg: tuple[float, float]) -> Any:
    """A pyproj.Proj: longitude and latitude to metres east and north of a latitude and longitude."""
    import pyproj

    latitude, longitude = centre_deg
    return pyproj.Proj(proj="aeqd", lat_0=latitude, lon_0=longitude, datum="WGS84")


def utm_crs(latitude: float, longitude: float) -> Any:
    """The CRS of the UTM zone, WGS 84; where two meet, either."""
    import pyproj
    from pyproj.aoi import AreaOfInterest
    from pyproj.database import query_utm_crs_info

    area = AreaOfInterest(longitude, latitude, longitude, latitude)
    zones = query_utm_crs_info(datum_name="WGS 84", area_of_interest=area)
    if not zones:
        raise LocalOnlyError(f"UTM does not reach latitude {latitude:.1f}")
    return pyproj.CRS.from_epsg(int(zones[0].code))
