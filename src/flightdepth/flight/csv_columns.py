"""The columns of a telemetry CSV by their names, and which of them one file has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from flightdepth.errors import BadInput
from flightdepth.flight.records import VelocityFrame

STAMP, TIME, SIGMA, UTC = "stamp_ns", "time_s", "sigma_m_s", "utc_ns"
SPEED: Literal["any direction"] = "any direction"
BY_PLACES: Literal["by its positions"] = "by its positions"  # where it tells nothing better
ALONG: Literal["by its positions in metres"] = "by its positions in metres"
VelocityColumns = VelocityFrame | Literal["any direction", "by its positions", "by its positions in metres"]
METRES = ("north_m", "east_m", "down_m")
PLACE, ALTITUDE = ("latitude_deg", "longitude_deg"), "altitude_m"
VELOCITY: dict[VelocityColumns, tuple[str, ...]] = {
    "world": ("vn_m_s", "ve_m_s", "vd_m_s"),
    "camera": ("vx_camera_m_s", "vy_camera_m_s", "vz_camera_m_s"),
    SPEED: ("speed_m_s",),
}
ANGLES = ("roll", "pitch", "yaw")
AttitudeColumns = Literal["quaternion", "angles"]
ATTITUDE: dict[AttitudeColumns, tuple[str, ...]] = {
    "quaternion": ("qw", "qx", "qy", "qz"),
    "angles": ("camera_yaw_deg", "camera_pitch_deg", "camera_roll_deg"),
}
CHOICES = " or ".join(", ".join(names) for names in (*VELOCITY.values(), METRES, PLACE))
MEND = f"The columns are {STAMP} or {TIME}, then {CHOICES}."


@dataclass(frozen=True)
class Columns:
    """Which columns a file has, checked: one of time, one set of velocity or of positions, at most one of attitude.

    `header` is all of them as they stand in the file; cells of `optional` ones may stay empty.
    """

    header: tuple[str, ...]
    time: Literal["stamp_ns", "time_s"]
    frame: VelocityColumns
    attitude: AttitudeColumns | None
    optional: tuple[str, ...]
    ignored: tuple[str, ...]

    @classmethod
    def of(cls, what: str, header: Sequence[str]) -> Columns:
        """Recognise the header line of the file `what`."""
        if len(set(header)) != len(header):
            raise BadInput(f"{what}, line 1", expected="each column once", got=", ".join(header))
        times = [name for name in (STAMP, TIME) if name in header]
        frames = [frame for frame, names in VELOCITY.items() if _all_or_none(what, header, names)]
        place = (*PLACE, ALTITUDE) if _all_or_none(what, header, PLACE) else ()
        metres = METRES if _all_or_none(what, header, METRES) and not frames else ()
        if not frames:
            frames = [ALONG] if metres else [BY_PLACES] if place else []
        if len(times) != 1 or len(frames) != 1:
            expected = "one time column and one set of velocity columns"
            raise BadInput(f"{what}, line 1", expected=expected, got=", ".join(header)[:200], mend=MEND)
        attitudes = [name for name, columns in ATTITUDE.items() if _all_or_none(what, header, columns)]
        if len(attitudes) > 1:
            raise BadInput(f"{what}, line 1", expected="one attitude", got="a quaternion and angles")
        # Without a direction an attitude would turn one that nobody told.
        attitude = attitudes[0] if attitudes and frames[0] != SPEED else None
        velocity = VELOCITY.get(frames[0], ())
        optional = tuple(name for name in (*([SIGMA] if velocity else []), *place, UTC) if name in header)
        known = {times[0], *velocity, *metres, *(ATTITUDE[attitude] if attitude else ()), *optional}
        ignored = tuple(name for name in header if name not in known)
        time: Literal["stamp_ns", "time_s"] = "stamp_ns" if times[0] == STAMP else "time_s"
        return cls(tuple(header), time, frames[0], attitude, optional, ignored)


def _all_or_none(what: str, header: Sequence[str], names: Sequence[str]) -> bool:
    missing = [name for name in names if name not in header]
    if missing and len(missing) < len(names):
        raise BadInput(
            f"{what}, line 1", expected=f"all of {', '.join(names)}", got=f"no {', '.join(missing)}"
        )
    return not missing
