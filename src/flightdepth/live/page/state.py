"""What the page shows besides pictures, as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.obstacle_messages import UNKNOWN, distances_cm
from flightdepth.live.obstacle_sender import ObstacleFeed
from flightdepth.live.obstacles import ObstacleSettings, Sectors
from flightdepth.live.status import LiveResult, LiveStatus
from flightdepth.motion import Vector
from flightdepth.outputs.palette import (
    FARTHER_HATCH,
    NEARER_HATCH,
    UNKNOWN_HATCH,
    DepthScale,
    coloured,
    steps_of,
)

Json = dict[str, Any]


def state(status: LiveStatus, result: LiveResult | None, obstacles: ObstacleFeed | None) -> Json:
    """All that changes: health, ages, counts, the fan."""
    return {
        "health": {
            "state": status.health.state.value,
            "reason": status.health.reason,
            "since_s": max(0.0, (status.stamp_ns - status.health.since_ns) / NS_PER_S),
        },
        "age": {
            "ms": status.age_ms,
            "p95_ms": status.age_p95_ms,
            "from": status.age_from,
            "distrusted": status.distrusted,
        },
        "fps": {"in": status.fps_in, "out": status.fps},
        "frames": {
            "received": status.frames.received,
            "used": status.frames.used,
            "dropped": dict(status.frames.dropped),
        },
        "ranges": [
            {"shift": shift, "displacement_m": length}
            for shift, length in zip(status.shifts, status.displacements_m, strict=False)
        ],
        "ranges_in_use": status.ranges,
        "lens": None
        if status.lens is None
        else {
            "denied": status.lens.doubt is not None,
            "agrees": status.lens.agrees,
            "says": str(status.lens),
        },
        "telemetry": {"hz": status.telemetry_hz, "age_ms": status.telemetry_age_ms},
        "reconnects": status.reconnects,
        "uptime_s": status.uptime_s,
        "no_depth": None if result is None else result.depth.reason,
        "speed_m_s": None if result is None else speed(result.motion.velocity_ned),
        "fan": None if obstacles is None else fan(obstacles, status.stamp_ns),
    }


def fan(feed: ObstacleFeed, now_ns: int) -> Json:
    """The sectors as they would be sent now: distance in metres, or why there is none."""
    settings, fresh = feed.settings, feed.fresh(now_ns)
    sectors = Sectors.unknown() if fresh is None else fresh.sectors
    values = distances_cm(sectors, settings)
    obstacles = sectors.obstacle_m <= settings.max_m
    return {
        "max_m": settings.max_m,
        "min_m": settings.min_m,
        "lacking": feed.lacking,
        "sectors": [
            {"kind": kind(int(value), bool(seen), settings), "m": metres(int(value)), "old": bool(old)}
            for value, seen, old in zip(values, obstacles, sectors.remembered, strict=True)
        ],
    }


def kind(value: int, obstacle: bool, settings: ObstacleSettings) -> str:
    """What one value of OBSTACLE_DISTANCE means: obstacle, free, clear up to a bound, or unknown."""
    if value == UNKNOWN:
        return "unknown"
    if value > math.floor(settings.max_m * 100):
        return "free"
    return "obstacle" if obstacle else "clear"


def metres(value: int) -> float | None:
    """A value of OBSTACLE_DISTANCE in metres."""
    return None if value == UNKNOWN else value / 100


def speed(velocity_ned: Vector | None) -> float | None:
    """m/s."""
    return None if velocity_ned is None else float(np.linalg.norm(velocity_ned))


def scale(depth_scale: DepthScale) -> Json:
    """What never changes: the colours of depth from near to far, the ticks and the hatches."""
    shares = np.linspace(1, 0, 33)
    colours = coloured(steps_of(shares)[:, None])[:, 0]
    hatches = {"unknown": UNKNOWN_HATCH, "farther": FARTHER_HATCH, "nearer": NEARER_HATCH}
    return {
        "near_m": depth_scale.near_m,
        "far_m": depth_scale.far_m,
        "colours": [css(colour.tolist()) for colour in colours],
        "ticks": [{"m": tick, "position": 1 - depth_scale.position(tick)} for tick in depth_scale.ticks_m],
        "hatches": {
            name: {"ground": css(hatch.ground_rgb), "line": css(hatch.line_rgb), "falling": hatch.falling}
            for name, hatch in hatches.items()
        },
    }


def css(rgb: Sequence[int]) -> str:
    """A colour as style sheets write it."""
    return f"rgb({rgb[0]} {rgb[1]} {rgb[2]})"
