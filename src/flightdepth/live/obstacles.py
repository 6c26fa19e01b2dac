"""What is known of the obstacles round the drone: a horizontal distance in each of 72 sectors.

The level frame: x where the drone's nose points, y to its right, z down; MAVLink's BODY_FRD with roll and pitch
taken out, as PX4's collision prevention and ArduPilot's simple avoidance use the distances. Sector i lies round the
azimuth 5 i degrees, clockwise from the nose, from 2.5 degrees before it to 2.5 after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.motion import Vector, rotation_from_quaternion
from flightdepth.ranges.fusion import RIGHT_WITHIN, ends
from flightdepth.weights.card import NetworkCard

Flags = NDArray[np.bool_]

SECTORS = 72
SECTOR_DEG = 5
NOISE_PX = 0.25  # of matching two compressed pictures
LEAST_PARALLAX_PX = NOISE_PX / RIGHT_WITHIN
BODY_HEIGHT_M = 0.3  # of the corridor stays below the camera however low the drone flies
GROUND_MARGIN_M = 0.5


@dataclass(frozen=True)
class ObstacleSettings:
    """Which points count.

    min_m, max_m      nearer than `min_m` is reported as `min_m`; farther than `max_m` is not reported
    above_m, below_m  the corridor's edges over and under the camera; the lower one stays above the ground
    least_confidence  of a pixel's depth (RangedDepth.confidence) that says "clear up to here"
    hit_confidence    of one that says "obstacle": less, since a missed obstacle is worse than a false one
    hit_share         share of a sector's rays that makes an obstacle: less is taken for noise
    known_share       share of a degree's rays that must be known for it to be free
    memory_s          how long an older result may stand in where the newest knows nothing
    stale_s           no result is used when it is older; autopilots give up at half a second themselves
    """

    min_m: float = 1.0
    max_m: float = 40.0
    above_m: float = 1.5
    below_m: float = 1.5
    least_confidence: float = 0.5
    hit_confidence: float = 0.25
    hit_share: float = 0.03
    known_share: float = 0.7
    memory_s: float = 1.0
    stale_s: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.min_m < self.max_m <= 650:  # centimetres in 16 bits, with two values to spare
            got = f"{self.min_m} to {self.max_m} m"
            raise BadInput("obstacle distances", expected="0 < min < max <= 650 m", got=got)
        if not (self.above_m > 0 and self.below_m > 0):
            got = f"{self.above_m} m above and {self.below_m} m below"
            raise BadInput("corridor of obstacles", expected="more than 0 m each", got=got)
        shares = (self.least_confidence, self.hit_confidence, self.hit_share, self.known_share)
        if not all(0 <= share <= 1 for share in shares):
            raise BadInput("shares of obstacles", expected="0 to 1", got=str(shares))

    def reach_m(self, speed_m_s: float) -> float:
        """How far a sector must be clear to be called free until its result is too old."""
        return self.max_m + speed_m_s * self.stale_s

    def over_ground(self, height_m: float | None) -> ObstacleSettings:
        """With a corridor that ends above the ground, `height_m` below the camera where that is known."""
        if height_m is None or not math.isfinite(height_m):
            return self
        lowest = max(BODY_HEIGHT_M, height_m - GROUND_MARGIN_M)
        return replace(self, below_m=min(self.below_m, lowest))


@dataclass(frozen=True)
class Sight:
    """What a network can see: its focal length in pixels, and the least depth per metre of displacement."""

    focal_px: float
    least_depth_per_m: float = 0.0

    @classmethod
    def of(cls, card: NetworkCard, focal_px: float) -> Sight:
        """Of a network whose pictures have this focal length (NetworkGrid.camera.fx)."""
        return cls(focal_px, card.at_focal(focal_px).alpha * ends(card)[0])


@dataclass(frozen=True, eq=False)
class Pose:
    """The camera in the level frame, and how it moves there: rotation [3, 3] and velocity [3] in m/s."""

    level_from_camera: Vector
    velocity_level: Vector

    @classmethod
    def of(cls, world_from_camera: Vector, heading_rad: float, velocity_ned: Vector) -> Pose:
        """From the camera's quaternion (w, x, y, z), the nose's heading from north and the velocity NED."""
        turn = level_from_world(heading_rad)
        return cls(turn @ rotation_from_quaternion(world_from_camera), turn @ np.asarray(velocity_ned))


@dataclass(frozen=True, eq=False)
class Sectors:
    """What is known of each sector at one time.

    obstacle_m   [72]  horizontal distance of the nearest obstacle; NaN where none was seen
    clear_m      [72]  no obstacle up to here, known for each degree of the sector; 0 where unknown
    remembered   [72]  taken from older results, moved by the motion
    """

    obstacle_m: Vector
    clear_m: Vector
    remembered: Flags

    @classmethod
    def unknown(cls) -> Sectors:
        """Nothing known anywhere."""
        return cls(np.full(SECTORS, np.nan), np.zeros(SECTORS), np.zeros(SECTORS, np.bool_))

    def __post_init__(self) -> None:
        if not len(self.obstacle_m) == len(self.clear_m) == SECTORS:
            raise ValueError(f"expected {SECTORS} sectors")


def level_from_world(heading_rad: float) -> Vector:
    """Rotation (3, 3) from north-east-down to the level frame."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def heading_rad(world_from_body: Vector) -> float:
    """Heading of the nose from north, clockwise, of a quaternion (w, x, y, z)."""
    nose = rotation_from_quaternion(world_from_body)[:, 0]
    return math.atan2(nose[1], nose[0])
