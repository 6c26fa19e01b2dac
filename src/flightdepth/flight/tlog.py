"""A ground station's MAVLink log (.tlog), through pymavlink: what the autopilot sent while it flew.

Each message stands behind the time it was received, microseconds since 1970, big-endian 64 bit. What it means
`mavlink_messages` knows.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from flightdepth.errors import BadInput, MissingExtra
from flightdepth.flight.autopilot import (
    DAMAGED_BYTES,
    OTHER_GIMBALS,
    BodyAttitude,
    Moment,
    Position,
    Record,
    Velocity,
    autopilot_telemetry,
)
from flightdepth.flight.file_bytes import log_bytes
from flightdepth.flight.gimbal import GimbalAttitude
from flightdepth.flight.mavlink_messages import (
    HEARTBEAT,
    KINDS,
    RANKS,
    VELOCITIES,
    Message,
    Source,
    flies,
)
from flightdepth.flight.power_ups import placed_boots
from flightdepth.flight.records import Telemetry
from flightdepth.flight.universal_time import Clock, can_be

# A time before 2096 and the first byte of a message, MAVLink 1 or 2.
START = re.compile(rb"\x00[\x00-\x0e].{6}[\xfe\xfd]", re.DOTALL)
TIME_BYTES = 8
MAVLINK_1 = 0xFE
SIGNED = 1  # bit of MAVLink 2's incompatibility flags; a signature makes the message longer


@dataclass
class Sender:
    """The records of one source, each with the message that told it, in the order of the log."""

    told: list[tuple[str, Record]] = field(default_factory=list)

    def best(self, kind: type) -> str:
        """The message that tells a kind of value best, of those that come at least half as often as the most frequent.

        A single better one, asked for in flight, tells little.
        """
        often = Counter(name for name, record in self.told if type(record.value) is kind)
        ranks = RANKS.get(kind, tuple(often))
        return min(
            (name for name in often if 2 * often[name] >= max(often.values())), key=ranks.index, default=""
        )

    def of(self, *kinds: type) -> list[Record]:
        """Those with a value of one of these kinds, as the best message tells it."""
        best = {kind: self.best(kind) for kind in kinds}
        return [record for name, record in self.told if best.get(type(record.value)) == name]


def looks_like_tlog(head: bytes, path: Path) -> bool:
    """Whether the file begins with a time and a message, and then another, as far as `head` reaches."""
    size = frame_size(head, 0)
    return size > 0 and (len(head) < size + TIME_BYTES + 1 or START.match(head, size) is not None)


def read_tlog(path: Path) -> Telemetry:
    """Read a tlog; damaged messages and bytes are skipped and counted."""
    counts: Counter[str] = Counter()
    found: dict[Source, Sender] = defaultdict(Sender)
    autopilots = set()
    for received_us, message in messages(path, counts):
        source, name = Source(message.get_srcSystem(), message.get_srcComponent()), message.get_type()
        if name == HEARTBEAT:
            autopilots |= {source} if flies(message) else set()
            continue
        for stamp_ns, value in KINDS[name](message, counts):
            found[source].told.append((name, Record(stamp_ns, value, received_us * 1000)))
    chosen = the_autopilot(found, autopilots, counts)
    if chosen is None:
        got = "none of a vehicle's" + (f" ({sum(counts.values())} damaged)" if counts else "")
        raise BadInput(f"telemetry {path}", expected=f"{' or '.join(VELOCITIES)} messages", got=got)
    return telemetry_of(path.name, chosen, found, counts)


def the_autopilot(
    found: dict[Source, Sender], autopilots: set[Source], counts: Counter[str]
) -> Source | None:
    """The source to believe: one whose heartbeat says autopilot, else any; of several the most talkative."""
    spoken = +Counter({source: len(sender.of(Velocity)) for source, sender in found.items()})
    if not spoken:
        return None
    chosen = max(spoken, key=lambda source: (source in autopilots, spoken[source]))
    counts["velocities of other senders"] += spoken.total() - spoken[chosen]
    return chosen


def telemetry_of(name: str, source: Source, found: dict[Source, Sender], counts: Counter[str]) -> Telemetry:
    """Telemetry of one vehicle: its autopilot's records, and the gimbal's, which has a clock of its own."""
    records = placed_boots(found[source].of(Velocity, BodyAttitude, Position, Moment), counts)
    clock: Clock = "autopilot"
    if not any(isinstance(record.value, Moment) and can_be(record.value.utc_ns) for record in records):
        clock = "ground station"  # whose times the records have
        records += [record._replace(value=Moment(record.stamp_ns)) for record in records[:1]]
    gimbals: dict[tuple[Source, int], list[Record]] = defaultdict(list)
    for sender in sorted(sender for sender in found if sender.system == source.system):
        for record in found[sender].of(GimbalAttitude):
            assert isinstance(record.value, GimbalAttitude)
            gimbals[sender, record.value.device].append(record)
    if gimbals:
        first, *others = gimbals.values()  # the first one carries the camera
        counts[OTHER_GIMBALS] += sum(map(len, others))
        if not any(record.stamp_ns for record in first):  # it has no clock
            first = [record._replace(stamp_ns=record.received_ns) for record in first]
        records += placed_boots(first, counts)
    what = f"tlog {name}, {found[source].best(Velocity)} of vehicle {source.system}"
    return autopilot_telemetry(what, records, counts, told_by=VELOCITIES, clock=clock)


def messages(path: Path, counts: Counter[str]) -> Iterator[tuple[int, Message]]:
    """Time of reception (us) and message, of the kinds in KINDS and heartbeats, with a sound checksum."""
    try:
        from pymavlink.dialects.v20 import common as mavlink
    except ModuleNotFoundError as error:
        raise MissingExtra(f"reading the MAVLink log {path.name}", "ardupilot") from error
    data = log_bytes(path)
    wanted = {number for number, kind in mavlink.mavlink_map.items() if kind.msgname in (HEARTBEAT, *KINDS)}
    decoder = mavlink.MAVLink(None)

    def decode(frame: bytes) -> Message | None:
        try:
            return decoder.decode(bytearray(frame))
        except mavlink.MAVError:
            counts["messages with a wrong checksum"] += 1
            return None

    yield from decoded(data, wanted, decode, counts)


def decoded(
    data: bytes, wanted: set[int], decode: Callable[[bytes], Message | None], counts: Counter[str]
) -> Iterator[tuple[int, Message]]:
    """Walk from message to message; an unwanted one counts as whole if another, or the end, follows."""
    at = 0
    while at < len(data):
        size = frame_size(data, at)
        whole = 0 < size <= len(data) - at
        if whole and message_number(data, at + TIME_BYTES) in wanted:
            message = decode(data[at + TIME_BYTES : at + size])
            whole = message is not None
            if whole:
                yield int.from_bytes(data[at : at + TIME_BYTES], "big"), message
        elif whole:
            left = len(data) - at - size
            whole = left <= TIME_BYTES or START.match(data, at + size) is not None
        if whole:
            at += size
        else:
            found = START.search(data, at + 1)
            next_at = found.start() if found else len(data)
            counts[DAMAGED_BYTES] += next_at - at
            at = next_at


def frame_size(data: bytes, at: int) -> int:
    """Bytes of the time and message that begin at `at`, 0 where none does."""
    if START.match(data, at) is None or len(data) < at + TIME_BYTES + 10:
        return 0
    first, length, flags = data[at + TIME_BYTES : at + TIME_BYTES + 3]
    if first == MAVLINK_1:
        return TIME_BYTES + 8 + length
    return TIME_BYTES + 12 + length + (13 if flags & SIGNED else 0)


def message_number(data: bytes, at: int) -> int:
    """The number of the message that begins at `at`."""
    return data[at + 5] if data[at] == MAVLINK_1 else int.from_bytes(data[at + 7 : at + 10], "little")
