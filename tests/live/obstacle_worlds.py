"""Depth maps of simple worlds, exact, from any camera pose: planes and what the sky leaves."""

from __future__ import annotations

import math

import numpy as np

from flightdepth.camera import Camera
from flightdepth.live.obstacle_rays import rays_of, sectors_of
from flightdepth.live.obstacles import LEAST_PARALLAX_PX, ObstacleSettings, Pose, Sectors, Sight
from flightdepth.motion import (
    NED_FROM_CAMERA,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)
from flightdepth.ranges.result import RangedDepth

CAMERA = Camera.from_fov(320, 240, 80)
SIGHT = Sight(focal_px=200.0)
SIDEWAYS = (0.0, 3.0, 0.0)  # m/s NED: parallax is best ahead
SETTINGS = ObstacleSettings()


def blind_cone_deg(range_m: float, displacement_m: float, sight: Sight) -> float:
    """Half the angle of the cone round the direction of travel in which nothing is seen at `range_m`."""
    sine = LEAST_PARALLAX_PX * range_m / (sight.focal_px * displacement_m)
    return math.degrees(math.asin(min(1.0, sine)))


def camera_attitude(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """Quaternion world_from_camera of a camera whose mount has these angles, degrees."""
    mount = rotation_from_euler(*(math.radians(angle) for angle in (roll, pitch, yaw)))
    return quaternion_from_rotation(mount @ NED_FROM_CAMERA)


def wall(
    attitude: np.ndarray, distance_m: float, *, bearing_deg: float = 0.0, camera: Camera = CAMERA
) -> np.ndarray:
    """z-depth [H, W] of a vertical plane whose nearest point lies at that distance and bearing from north."""
    world_rays = camera.rays() @ rotation_from_quaternion(attitude).T
    bearing = math.radians(bearing_deg)
    toward = world_rays @ np.array([math.cos(bearing), math.sin(bearing), 0.0])
    with np.errstate(divide="ignore"):
        return np.where(toward > 1e-9, distance_m / toward, np.nan).astype(np.float32)


def ground(attitude: np.ndarray, height_m: float, *, camera: Camera = CAMERA) -> np.ndarray:
    """z-depth of level ground so far below; NaN above the horizon."""
    down = (camera.rays() @ rotation_from_quaternion(attitude).T)[..., 2]
    with np.errstate(divide="ignore"):
        return np.where(down > 1e-9, height_m / down, np.nan).astype(np.float32)


def result(
    depth_m: np.ndarray,
    *,
    confidence: np.ndarray | float = 0.9,
    farther_m: np.ndarray | float = np.nan,
    displacements_m: tuple[float, ...] = (1.0,),
) -> RangedDepth:
    """A result with this depth; NaN in it is unknown but for `farther_m`."""
    n = len(displacements_m)
    depth = np.asarray(depth_m, np.float32)
    told = np.broadcast_to(np.asarray(farther_m, np.float32), depth.shape)
    sure = np.broadcast_to(np.asarray(confidence, np.float32), depth.shape)
    return RangedDepth(
        depth_m=depth,
        confidence=np.where(np.isfinite(depth), sure, np.float32(0)),
        sigma_m=None,
        range_depths_m=np.zeros((n, 1, 1), np.float32),
        shifts=np.arange(1, n + 1),
        displacements_m=np.array(displacements_m),
        centroids_m=np.full(n, np.nan),
        farther_than_m=np.where(np.isnan(depth), told, np.float32(np.nan)),
        nearer_than_m=np.full(depth.shape, np.nan, np.float32),
        latency_ms=1.0,
    )


def nothing(bound_m: float = math.nan, camera: Camera = CAMERA) -> RangedDepth:
    """No depth at any pixel, only a bound."""
    return result(np.full((camera.height, camera.width), np.nan), farther_m=bound_m)


def looked(
    depth: RangedDepth,
    attitude: np.ndarray | None = None,
    *,
    heading_deg: float = 0.0,
    velocity: tuple[float, float, float] = SIDEWAYS,
    sight: Sight = SIGHT,
    settings: ObstacleSettings = SETTINGS,
    camera: Camera = CAMERA,
) -> Sectors:
    """The sectors of one depth map."""
    towards = camera_attitude() if attitude is None else attitude
    pose = Pose.of(towards, math.radians(heading_deg), np.array(velocity))
    return sectors_of(rays_of(depth, camera, pose, sight, settings), settings)
