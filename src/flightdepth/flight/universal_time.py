"""When a flight was: the universal time (UTC) of its time 0, where its log tells it, and by whose clock.

Nanoseconds since 1970 count as Unix counts them: each day has 86,400 s, leap seconds are none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from statistics import median_low
from typing import Literal

# satellites      a receiver in the drone or the camera
# autopilot       its own clock, which satellites set, or a ground station
# ground station  the computer that wrote the tlog
# computer        the one whose clock stamped a recording's messages, or that `live` ran on
# app             the telephone that flew the drone
# track           the times of a GPX file, which some write in local time
# column          that of a CSV
# names           of the pictures of a folder, by the clock of whoever named them
Clock = Literal["satellites", "autopilot", "ground station", "computer", "app", "track", "column", "names"]

NS_PER_S = 1_000_000_000
SINCE = datetime(1970, 1, 1, tzinfo=UTC)
# Clocks that nobody has set begin in 1970, 1980 or 2000, those of simulations at 0; no drone filmed before.
EARLIEST_NS = (datetime(2005, 1, 1, tzinfo=UTC) - SINCE) // timedelta(seconds=1) * NS_PER_S
LAST_UTC_NS = 4 * 10**18  # 2096: beyond is damage
# The time of satellites (GPS) counts seconds since 6 January 1980, and knows no leap seconds: it is ahead by those
# since then, from these dates on (IERS, Bulletin C). The next needs a line more.
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
LEAP_SECONDS = {
    datetime(2017, 1, 1, tzinfo=UTC): 18,
    datetime(2015, 7, 1, tzinfo=UTC): 17,
    datetime(2012, 7, 1, tzinfo=UTC): 16,
    datetime(2009, 1, 1, tzinfo=UTC): 15,
    datetime(2006, 1, 1, tzinfo=UTC): 14,
    GPS_EPOCH: 13,  # right from 1999 on, and none before is of a flight
}


@dataclass(frozen=True)
class UniversalTime:
    """UTC of time 0, nanoseconds since 1970, and whose clock told it.

    As sure as that clock, and as what brought the log's times to the video's.
    """

    ns_at_zero: int
    clock: Clock

    @classmethod
    def of(cls, ns_at_zero: int, clock: Clock) -> UniversalTime | None:
        """None of a clock that was not set, or damaged."""
        return cls(ns_at_zero, clock) if can_be(ns_at_zero) else None

    @classmethod
    def by_readings(cls, readings: Sequence[tuple[int, int]], clock: Clock) -> UniversalTime | None:
        """The median of what readings tell: pairs of a time on the log's clock and its UTC, both ns, in any order."""
        told = [utc_ns - stamp_ns for stamp_ns, utc_ns in readings if can_be(utc_ns)]
        return cls(median_low(told), clock) if told else None

    def at(self, stamp_ns: int) -> int:
        """UTC of a time on the flight's clock, ns since 1970."""
        return self.ns_at_zero + stamp_ns

    def later_by(self, offset_ns: int) -> UniversalTime:
        """The same once `offset_ns` is added to the log's times: what was at 0 is at the offset then."""
        return replace(self, ns_at_zero=self.ns_at_zero - offset_ns)

    def __str__(self) -> str:
        return f"{utc_text(self.ns_at_zero)} by the {self.clock}"


def can_be(utc_ns: int) -> bool:
    """Whether a flight may have been then, so that a clock which says so was set."""
    return EARLIEST_NS <= utc_ns < LAST_UTC_NS


def unix_ns(moment: datetime) -> int:
    """Nanoseconds since 1970 of a moment in a zone, to the microsecond."""
    return (moment - SINCE) // timedelta(microseconds=1) * 1000


def utc_of_iso(text: str) -> int | None:
    """Nanoseconds since 1970 of an ISO 8601 time, UTC where it names no zone; None of anything else, or damage."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    utc_ns = unix_ns(moment if moment.tzinfo else moment.replace(tzinfo=UTC))
    return utc_ns if abs(utc_ns) < LAST_UTC_NS else None


def utc_text(utc_ns: int) -> str:
    """As ISO 8601 has it, to the millisecond below: 2026-05-01T09:30:00.250Z."""
    moment = SINCE + timedelta(microseconds=utc_ns // 1000)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 1000:03d}Z"


def utc_of_gps_ns(week: int, of_week_ms: int) -> int:
    """UTC of a GPS week, counted from 1980 without starting again, and milliseconds in it; ns since 1970."""
    by_satellites = GPS_EPOCH + timedelta(weeks=week, milliseconds=of_week_ms)
    ahead = (timedelta(seconds=seconds) for seconds in LEAP_SECONDS.values())
    known = zip(LEAP_SECONDS, ahead, strict=True)
    return unix_ns(
        by_satellites - next((by for since, by in known if by_satellites >= since + by), timedelta())
    )
