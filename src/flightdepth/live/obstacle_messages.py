"""Sectors as MAVLink: OBSTACLE_DISTANCE (330) and the heartbeat of its sender.

OBSTACLE_DISTANCE in the way that PX4 and ArduPilot both read: MAV_FRAME_BODY_FRD, 72 distances, `increment` 5 and
`increment_f` 0, so that index i is the direction 5 i degrees clockwise from the nose in either. Both drop 0 or
what is below `min_distance`, so the nearest is `min_distance`. `max_distance` + 1 says free. 65535 says unknown: PX4
then does not fly there unless CP_GO_NO_DATA says so; ArduPilot makes no difference between unknown and free.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import MissingExtra
from flightdepth.live.obstacles import SECTOR_DEG, ObstacleSettings, Sectors

UNKNOWN = 65535  # UINT16_MAX
COMPONENT = 196  # MAV_COMP_ID_OBSTACLE_AVOIDANCE
DEFAULT_SYSTEM = 1  # of an autopilot that nobody numbered; in a dry run there is none to ask

Message = Any


def distances_cm(sectors: Sectors, settings: ObstacleSettings) -> NDArray[np.uint16]:
    """The 72 values of OBSTACLE_DISTANCE.

    Where no obstacle was seen and it is clear up to some bound below `max_m`, that bound is reported as a distance:
    free up to it, not beyond.
    """
    obstacle_m, clear_m = sectors.obstacle_m, sectors.clear_m
    free = settings.max_m + 0.01
    # NaN compares as false: no obstacle.
    told_m = np.where(
        obstacle_m <= settings.max_m,
        np.maximum(obstacle_m, settings.min_m),
        np.where(clear_m >= settings.max_m, free, np.where(clear_m >= settings.min_m, clear_m, np.nan)),
    )
    return np.asarray(np.where(np.isnan(told_m), UNKNOWN, _centimetres(told_m)), np.uint16)


def _centimetres(metres: float | NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Rounded down, never farther than known; the ends of the range as what lies on them."""
    return np.asarray(np.floor(np.multiply(metres, 100) + 1e-6), np.float64)


class ObstaclePacker:
    """MAVLink 2 messages as bytes, from a component of the vehicle's own system.

    `system` tells the vehicle's number, asked before each message; None until its autopilot was heard. A companion
    computer shares that number (https://mavlink.io/en/guide/routing.html). ArduPilot takes obstacle distances of any
    sender, PX4 too, but routers and ground stations take another number for another vehicle.
    """

    def __init__(
        self,
        settings: ObstacleSettings,
        *,
        system: Callable[[], int | None] = lambda: None,
    ) -> None:
        try:
            from pymavlink.dialects.v20 import ardupilotmega as mavlink
        except ModuleNotFoundError as error:
            raise MissingExtra("sending obstacle distances", "live") from error
        self.settings, self._system = settings, system
        self._mavlink = mavlink.MAVLink(None, srcSystem=DEFAULT_SYSTEM, srcComponent=COMPONENT)
        self._dialect = mavlink

    def heartbeat(self, *, usable: bool) -> bytes:
        """Once a second; `usable`: whether obstacle distances are being sent."""
        known = self._dialect
        kind, nobody = known.MAV_TYPE_ONBOARD_CONTROLLER, known.MAV_AUTOPILOT_INVALID
        state = known.MAV_STATE_ACTIVE if usable else known.MAV_STATE_CRITICAL
        return self._packed(known.MAVLink_heartbeat_message(kind, nobody, 0, 0, state, 3))

    def distances(self, sectors: Sectors, time_us: int) -> bytes:
        """OBSTACLE_DISTANCE; `time_us` is when the picture was taken, since power-up or since 1970."""
        return self._packed(
            self._dialect.MAVLink_obstacle_distance_message(
                time_us,
                self._dialect.MAV_DISTANCE_SENSOR_UNKNOWN,
                distances_cm(sectors, self.settings).tolist(),
                SECTOR_DEG,
                int(_centimetres(self.settings.min_m)),
                int(_centimetres(self.settings.max_m)),
                0.0,
                0.0,
                self._dialect.MAV_FRAME_BODY_FRD,
            )
        )

    def _packed(self, message: Message) -> bytes:
        self._mavlink.srcSystem = self._system() or self._mavlink.srcSystem
        data = bytes(message.pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return data


def is_own_log(head: bytes) -> bool:
    """Whether a log begins with a MAVLink 2 message by this component, as `in_tlog` makes them."""
    return len(head) > 14 and head[8] == 0xFD and head[14] == COMPONENT


def in_tlog(time_us: int, message: bytes) -> bytes:
    """A message as it stands in a ground station's log: behind its time, microseconds since 1970."""
    return time_us.to_bytes(8, "big") + message
