"""poses.csv: where the camera was at each frame, and where it looked.

Positions are summed velocities, so they drift; across a gap in the log nothing is summed, and a new segment
starts at 0. Attitudes come from the log ("log"); where it has none, from the direction of motion in the pictures
of a camera that a gimbal holds level ("pictures", see `level.py`); or they are "assumed": a camera that never
turns, where velocities came in its own axes. Where the log tells a speed alone, all is seen in the pictures from a
first frame on (`seen_path.py`), whose attitude is assumed.

Latitude, longitude and altitude are the log's own at that time: positions do not come from them, and drift away.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from flightdepth.flight import Frame
from flightdepth.flight.places import PlaceTrack
from flightdepth.flight.records import NS_PER_S, Sample, give
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.motion import (
    ENU_FROM_NED,
    NED_FROM_CAMERA,
    Vector,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from flightdepth.outputs.level import LevelCamera, SeenMotion
from flightdepth.outputs.seen_path import REMEMBERED, SeenPath
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.result import RangedDepth

AttitudeFrom = Literal["log", "pictures", "assumed", "unknown"]
COLUMNS = (
    *("index", "stamp_ns", "segment", "north_m", "east_m", "down_m"),
    *("qw", "qx", "qy", "qz", "attitude"),
    *("latitude_deg", "longitude_deg", "altitude_m", "utc_ns"),
)


@dataclass(frozen=True, eq=False)
class FramePose:
    """The camera at one frame.

    segment            frames of one segment share an origin, the first of them
    position_ned       (3,) metres north, east, down
    world_from_camera  (4,) quaternion (w, x, y, z), NED from right-down-forward; NaN where unknown
    attitude           where the quaternion comes from
    place              (3,) latitude, longitude in degrees (WGS 84), altitude in metres; NaN where the log tells none
    utc_ns             universal time, since 1970; None where the log does not tell it
    """

    index: int
    stamp_ns: int
    segment: int
    position_ned: Vector
    world_from_camera: Vector
    attitude: AttitudeFrom
    place: Vector = field(default_factory=lambda: np.full(3, np.nan))
    utc_ns: int | None = None

    @property
    def ned_from_camera(self) -> Vector:
        """Rotation (3, 3); the attitude must be known."""
        return rotation_from_quaternion(self.world_from_camera)


class PoseTrack:
    """Listens to a flight's samples and results, and says where the camera was at each frame.

    `places` is where the log says that it was on Earth, `utc` when.
    """

    def __init__(
        self,
        places: PlaceTrack | None = None,
        utc: UniversalTime | None = None,
        *,
        any_direction: bool = False,
    ) -> None:
        """`any_direction`: of the samples only the speed counts, so the way is seen in the pictures."""
        self._places, self._utc = places, utc
        self._path = SeenPath() if any_direction else None
        self._trajectory = Trajectory()
        self._level = LevelCamera()
        self._last: tuple[int, Vector, int] | None = None  # stamp, position, segment of the frame before
        self._segments = 0
        self._positions: dict[int, tuple[Vector, int]] = {}

    def add(self, sample: Sample) -> None:
        """Take a sample; those needed at a frame come before it."""
        give(sample, self._trajectory)

    def at(self, frame: Frame, result: RangedDepth) -> FramePose | None:
        """The pose at a frame, whose result tells which way the camera moved; None where no log says where it is."""
        if self._path is not None:
            seen = self._path.at(frame.index, result)
            return None if seen is None else self._pose(frame, *seen, "assumed")
        position, segment, turn = self._step(frame.stamp_ns)
        if segment < 0:
            return None
        self._positions[frame.index] = position, segment
        if len(self._positions) > REMEMBERED:
            del self._positions[next(iter(self._positions))]
        attitude: AttitudeFrom = "log"
        if self._trajectory.non_rotating:
            turn, attitude = NED_FROM_CAMERA, "assumed"
        elif turn is None:
            turn, attitude = self._seen(frame, result, position, segment), "pictures"
        return self._pose(frame, position, segment, turn, attitude)

    def _pose(
        self, frame: Frame, position: Vector, segment: int, turn: Vector | None, attitude: AttitudeFrom
    ) -> FramePose:
        quaternion = np.full(4, np.nan) if turn is None else quaternion_from_rotation(turn)
        attitude = "unknown" if turn is None else attitude
        place = np.full(3, np.nan) if self._places is None else self._places.at(frame.stamp_ns)
        utc_ns = None if self._utc is None else self._utc.at(frame.stamp_ns)
        return FramePose(frame.index, frame.stamp_ns, segment, position, quaternion, attitude, place, utc_ns)

    def _step(self, stamp_ns: int) -> tuple[Vector, int, Vector | None]:
        """Position, segment (-1: unknown) and rotation at a time later than the last."""
        before_ns = stamp_ns if self._last is None else self._last[0]
        states = self._trajectory.at(np.array([before_ns, stamp_ns], dtype=np.int64))
        self._trajectory.forget(stamp_ns)
        turn = states.world_from_camera[1] if states.oriented[1] else None
        if states.segment[1] < 0:
            self._last = None
            return np.zeros(3), -1, turn
        step = states.position_m[1] - states.position_m[0]
        if self._trajectory.non_rotating:
            step = NED_FROM_CAMERA @ step
        if self._last is None or states.segment[0] != states.segment[1]:
            position, segment = np.zeros(3), self._segments
            self._segments += 1
        else:
            position, segment = self._last[1] + step, self._last[2]
        self._last = stamp_ns, position, segment
        return position, segment, turn

    def _seen(self, frame: Frame, result: RangedDepth, position: Vector, segment: int) -> Vector | None:
        """The attitude that turns and the longest pair's direction tell."""
        moved_m, aside_rad, orientation = result.moved_m, result.aside_rad, result.orientation
        if moved_m is not None and aside_rad is not None and orientation is not None:
            earlier = self._positions.get(frame.index - int(result.shifts[-1]))
            if earlier is not None and earlier[1] == segment:
                told = moved_m[-1], position - earlier[0], float(aside_rad[-1])
                self._level.add(SeenMotion(frame.stamp_ns, orientation, *told))
        return self._level.at(frame.stamp_ns)


def pose_cells(pose: FramePose) -> list[object]:
    """What stands in the table for one frame; an unknown attitude leaves its cells empty, and so does a place."""
    known = pose.attitude != "unknown"
    position = [f"{metres:.4f}" for metres in pose.position_ned]
    quaternion = [f"{part:.9f}" if known else "" for part in pose.world_from_camera]
    place = [
        f"{part:.{decimals}f}" if np.isfinite(part) else ""
        for part, decimals in zip(pose.place, (9, 9, 3), strict=True)
    ]
    utc_ns = "" if pose.utc_ns is None else pose.utc_ns
    return [pose.index, pose.stamp_ns, pose.segment, *position, *quaternion, pose.attitude, *place, utc_ns]


def poses_from_csv(text: str) -> dict[int, FramePose]:
    """The poses of a table whose lines are those of `pose_cells`, by frame index."""
    poses = {}
    for cells in csv.DictReader(io.StringIO(text)):
        if cells["attitude"] not in get_args(AttitudeFrom):
            raise ValueError(f"attitude {cells['attitude']!r}")
        attitude: AttitudeFrom = cells["attitude"]  # type: ignore[assignment]
        position = np.array([float(cells[column]) for column in COLUMNS[3:6]])
        quaternion = np.array([float(cells[column] or "nan") for column in COLUMNS[6:10]])
        # Older versions wrote no places and no universal time.
        place = np.array([float(cells.get(column) or "nan") for column in COLUMNS[11:14]])
        utc_ns = int(told) if (told := cells.get("utc_ns")) else None
        index, stamp_ns, segment = (int(cells[column]) for column in COLUMNS[:3])
        poses[index] = FramePose(index, stamp_ns, segment, position, quaternion, attitude, place, utc_ns)
    return poses


def tum_trajectory(poses: Iterable[FramePose], zero_ns: int = 0) -> str:
    """A trajectory in TUM's format, poses with an attitude and of one segment: lines of `time x y z qx qy qz qw`.

    Times are seconds, `zero_ns` being the video's first picture; east, north and up in metres, the camera's axes right,
    down and forward.
    """
    lines = ["# flightdepth: time_s east_m north_m up_m qx qy qz qw"]
    for pose in poses:
        seconds, ns = divmod(zero_ns + pose.stamp_ns, NS_PER_S)
        place = ENU_FROM_NED @ pose.position_ned
        w, x, y, z = quaternion_from_rotation(ENU_FROM_NED @ pose.ned_from_camera)
        numbers = [*(f"{metres:.4f}" for metres in place), *(f"{part:.9f}" for part in (x, y, z, w))]
        lines.append(" ".join([f"{seconds}.{ns:09d}", *numbers]))
    return "\n".join(lines) + "\n"
