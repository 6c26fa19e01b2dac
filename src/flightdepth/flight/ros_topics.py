"""What each topic of a ROS recording said of the flight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.positions import UNFIXED
from flightdepth.flight.records import LATEST_NS, NS_PER_S, BodyAttitudeSample
from flightdepth.flight.ros1_bag import looks_like_ros1, ros1_messages
from flightdepth.flight.ros2_bag import ros2_messages
from flightdepth.flight.ros_messages import (
    FRD,
    IMAGE_KINDS,
    NED,
    OPTICAL,
    ORIENTATION_KINDS,
    VELOCITY_KINDS,
    Orientation,
    Twist,
    decoded,
    is_depth_map,
    orientation_of,
    stamp_of,
    tells_velocity,
    twist_of,
)
from flightdepth.flight.ros_places import (
    NAV_SAT_FIX,
    PLACE_KINDS,
    Fix,
    Place,
    fix_of,
    place_of,
    velocities_of_fixes,
    velocities_of_places,
)
from flightdepth.flight.ros_px4 import (
    IN_STEP_NS,
    PX4_GIMBAL,
    PX4_KINDS,
    PX4_VELOCITY_KINDS,
    UNDEFINED,
    Px4Rows,
    px4_gate,
    twists_of,
)
from flightdepth.flight.ros_records import DamagedError, RosMessage, Wanted
from flightdepth.flight.ulog import reset_count

ASKED_FOR = ("setpoint", "goal", "target", "cmd")
MOST_UNSET = 100  # first messages of a topic whose time is 0; of more, nobody sets it
BEGINS_NS = 10 * NS_PER_S  # a time before is of a clock that began at 0
UNREADABLE = "messages that cannot be read"
USED = frozenset([*PX4_KINDS, *VELOCITY_KINDS, *ORIENTATION_KINDS, NAV_SAT_FIX, *IMAGE_KINDS])


@dataclass
class Topic:
    """What one topic of a recording said."""

    name: str
    kind: str
    messages: int = 0
    first_ns: int | None = None
    ahead_ns: int = 0  # of the clock of the headers before that of the recording, at first
    of_depth: bool = False  # an image topic that shows no colours
    unset: list[RosMessage] = field(default_factory=list)  # whose time is 0, before any other told one
    unset_ns: int | None = None  # what that 0 means; None is the time of recording
    twists: list[Twist] = field(default_factory=list)
    cameras: list[Orientation] = field(default_factory=list)
    bodies: list[Orientation] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    px4: Px4Rows = field(default_factory=Px4Rows)
    resets: int = 0  # of the attitude
    unsound: Counter[str] = field(default_factory=Counter)  # positions or velocities left out
    by_places: bool = False  # whether the twists are those of the places

    @property
    def root(self) -> str:
        """The first part of its name, where recordings of several vehicles tell these apart; empty of a lone one."""
        first, _, rest = self.name.removeprefix("/").partition("/")
        return first if rest else ""

    @property
    def folder(self) -> str:
        """What a topic has in common with those of the same source: "/fmu/out"."""
        return self.name.rpartition("/")[0]

    @property
    def asked_for(self) -> bool:
        """Whether its name says that it tells how the drone is to fly, not how it does."""
        return any(word in self.name for word in ASKED_FOR)

    @property
    def still(self) -> bool:
        """Whether it never told of any movement."""
        return not any(np.any(twist.velocity) for twist in self.twists)

    def settled(self, message: RosMessage) -> list[RosMessage]:
        """The messages whose times are known once another one has come.

        A header's time of 0 is one that nobody set, or where a simulation begins: the first other one tells.
        """
        if self.first_ns is not None or self.kind in PX4_KINDS:
            return [message]
        time_ns = header_time_ns(message)
        if time_ns == 0 and self.messages <= MOST_UNSET:
            self.unset += [] if self.unset and self.kind in IMAGE_KINDS else [message]
            return []
        unset, self.unset = self.unset, []
        if unset and 0 < time_ns <= BEGINS_NS:
            self.unset_ns, self.ahead_ns = 0, -min(unset[0].log_ns, LATEST_NS)
            unset = [replace(each, log_ns=0) for each in unset]
        return [*unset, message]

    def tell_by_places(self) -> None:
        """Where no twist tells of a movement, and the places do, the velocity is their slope."""
        if self.asked_for or not self.still:
            return
        if self.kind == NAV_SAT_FIX:
            found = velocities_of_fixes(self.fixes, self.unsound)
        else:
            found = velocities_of_places(self.places, self.unsound)
        if np.any(found.velocity_ned):
            self.by_places = True
            self.twists = [
                Twist(each.stamp_ns, each.velocity, each.frame, each.sigma) for each in found.samples()
            ]


def header_time_ns(message: RosMessage) -> int:
    """The time in a message that begins with a header: seconds and nanoseconds behind four bytes, in ROS 1 and 2."""
    seconds, nanoseconds = (int.from_bytes(message.data[at : at + 4], "little") for at in (4, 8))
    return seconds * NS_PER_S + nanoseconds


def ros_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of the wanted types in any ROS recording."""
    reader = ros1_messages if looks_like_ros1(head_of(path, 16), path) else ros2_messages
    return reader(path, wanted, counts)


def topics_of(
    path: Path, counts: Counter[str], used: Collection[str] = USED
) -> tuple[list[Topic], dict[str, str]]:
    """The topics of `used` kinds; and what a recording holds: names of topics with their kinds, and other kinds."""
    kinds: set[str] = set()
    topics: dict[str, Topic] = {}

    def wanted(kind: str) -> bool:
        kinds.add(kind)
        return kind in used

    for message in ros_messages(path, wanted, counts):
        topic = topics.setdefault(message.topic, Topic(message.topic, message.kind))
        topic.messages += 1
        if message.kind == topic.kind:
            for each in topic.settled(message):
                _take(each, topic, counts)
    for topic in topics.values():
        for each in topic.unset:
            _take(each, topic, counts)
    _tell_px4(list(topics.values()), counts)
    named = {topic.name: topic.kind for topic in topics.values()}
    return list(topics.values()), dict.fromkeys(kinds.difference(used), "") | named


def _take(message: RosMessage, topic: Topic, counts: Counter[str]) -> None:
    if message.kind in IMAGE_KINDS and topic.first_ns is not None:
        return
    if message.kind in PX4_KINDS:
        _take_px4(message, topic, counts)
        return
    try:
        content = decoded(message)
        if topic.first_ns is None:
            topic.first_ns = stamp_of(content.header, message.log_ns)
            topic.ahead_ns = topic.ahead_ns or topic.first_ns - min(message.log_ns, LATEST_NS)
        topic.of_depth = message.kind in IMAGE_KINDS and is_depth_map(message, content)
        if message.kind in ORIENTATION_KINDS:
            _take_orientation(orientation_of(message, content), topic)
        if message.kind in PLACE_KINDS and (place := place_of(message, content)):
            topic.places.append(place)
        if message.kind == NAV_SAT_FIX:
            _take_fix(fix_of(message, content), topic)
        if tells_velocity(message):
            twist = twist_of(message, content)
            if twist is None:
                counts[f"velocities of unknown axes (frame {content.header.frame_id[:40]!r})"] += 1
            else:
                topic.twists.append(twist)
    except DamagedError:
        counts[UNREADABLE] += 1


def _take_orientation(turn: Orientation | None, topic: Topic) -> None:
    if turn is not None:
        (topic.cameras if turn.of_camera else topic.bodies).append(turn)


def _take_fix(fix: Fix | None, topic: Topic) -> None:
    if fix is None:
        topic.unsound[UNFIXED] += 1
    else:
        topic.fixes.append(fix)


def _take_px4(message: RosMessage, topic: Topic, counts: Counter[str]) -> None:
    try:
        if message.definition:
            topic.px4.take(message)
        else:
            counts[UNDEFINED] += 1
    except DamagedError:
        counts[UNREADABLE] += 1


def with_pictures(topics: Sequence[Topic]) -> list[Topic]:
    """The topics with pictures, those with most first; depth that a camera measures left aside."""
    images = [topic for topic in topics if topic.kind in IMAGE_KINDS and not topic.of_depth]
    pictures = [topic for topic in images if topic.first_ns is not None]
    return sorted(pictures, key=lambda topic: (-topic.messages, topic.name))


def first_picture(topics: Sequence[Topic]) -> Topic | None:
    """The topic with most pictures, whose first is time 0."""
    return next(iter(with_pictures(topics)), None)


def _tell_px4(topics: Sequence[Topic], counts: Counter[str]) -> None:
    """What PX4's topics say, once all is read; gimbals last, whose yaw may count from the drone's heading."""
    picture = first_picture(topics)
    ahead_ns = picture.ahead_ns if picture else 0
    if abs(ahead_ns) <= IN_STEP_NS:
        ahead_ns = 0  # the same clock: that is the way of a picture
    bodies: dict[str, list[BodyAttitudeSample]] = {}
    told = [topic for topic in topics if topic.px4.rows]
    for topic in sorted(told, key=lambda topic: topic.kind == PX4_GIMBAL):
        of_camera = topic.kind == PX4_GIMBAL
        lost = topic.unsound if topic.kind in PX4_VELOCITY_KINDS else counts
        columns, known = topic.px4.columns(), bodies.get(topic.folder, [])
        gate, topic.fixes = px4_gate(topic.kind, columns, ahead_ns, known if of_camera else [], lost)
        topic.twists = twists_of(gate)
        topic.cameras = [
            Orientation(each.stamp_ns, each.world_from_camera, NED, OPTICAL) for each in gate.cameras
        ]
        if not of_camera:
            topic.bodies = [
                Orientation(each.stamp_ns, each.world_from_body, NED, FRD) for each in gate.bodies
            ]
        topic.resets = reset_count(columns)
        bodies[topic.folder] = max(known, gate.bodies, key=len)
