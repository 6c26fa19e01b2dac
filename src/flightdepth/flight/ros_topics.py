"""What each topic of a ROS recording said of the flight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.ros1_bag import looks_like_ros1, ros1_messages
from flightdepth.flight.ros2_bag import ros2_messages
from flightdepth.flight.ros_messages import (
    IMAGE_KINDS,
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
    UNFIXED,
    Fix,
    Place,
    fix_of,
    place_of,
    velocities_of_fixes,
    velocities_of_places,
)
from flightdepth.flight.ros_records import DamagedError, RosMessage, Wanted

ASKED_FOR = ("setpoint", "goal", "target", "cmd")
UNREADABLE = "messages that cannot be read"
USED = frozenset([*VELOCITY_KINDS, *ORIENTATION_KINDS, NAV_SAT_FIX, *IMAGE_KINDS])


@dataclass
class Topic:
    """What one topic of a recording said."""

    name: str
    kind: str
    messages: int = 0
    first_ns: int | None = None
    of_depth: bool = False  # an image topic that shows no colours
    twists: list[Twist] = field(default_factory=list)
    orientations: list[Orientation] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    unsound: Counter[str] = field(default_factory=Counter)  # positions left out
    by_places: bool = False  # whether the twists are those of the places

    @property
    def asked_for(self) -> bool:
        """Whether its name says that it tells how the drone is to fly, not how it does."""
        return any(word in self.name for word in ASKED_FOR)

    @property
    def still(self) -> bool:
        """Whether it never told of any movement."""
        return not any(np.any(twist.velocity) for twist in self.twists)

    def tell_by_places(self) -> None:
        """Where no twist tells of a movement, and the places do, the velocity is their slope."""
        if self.asked_for or not self.still:
            return
        found = velocities_of_places(self.places)
        if self.fixes:
            found = velocities_of_fixes(self.fixes, self.unsound)
        if np.any(found.velocity_ned):
            self.by_places = True
            self.twists = [
                Twist(each.stamp_ns, each.velocity, each.frame, each.sigma) for each in found.samples()
            ]


def ros_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of the wanted types in any ROS recording."""
    reader = ros1_messages if looks_like_ros1(head_of(path, 16), path) else ros2_messages
    return reader(path, wanted, counts)


def topics_of(path: Path, counts: Counter[str]) -> tuple[list[Topic], dict[str, str]]:
    """The topics that are of use; and what a recording holds: names of topics with their kinds, and other kinds."""
    kinds: set[str] = set()
    topics: dict[str, Topic] = {}

    def wanted(kind: str) -> bool:
        kinds.add(kind)
        return kind in USED

    for message in ros_messages(path, wanted, counts):
        topic = topics.setdefault(message.topic, Topic(message.topic, message.kind))
        topic.messages += 1
        if message.kind == topic.kind:
            _take(message, topic, counts)
    named = {topic.name: topic.kind for topic in topics.values()}
    return list(topics.values()), dict.fromkeys(kinds - USED, "") | named


def _take(message: RosMessage, topic: Topic, counts: Counter[str]) -> None:
    if message.kind in IMAGE_KINDS and topic.first_ns is not None:
        return
    try:
        content = decoded(message)
        topic.first_ns = topic.first_ns or stamp_of(content.header, message.log_ns)
        topic.of_depth = message.kind in IMAGE_KINDS and is_depth_map(message, content)
        if message.kind in ORIENTATION_KINDS and (turn := orientation_of(message, content)):
            topic.orientations.append(turn)
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


def _take_fix(fix: Fix | None, topic: Topic) -> None:
    if fix is None:
        topic.unsound[UNFIXED] += 1
    else:
        topic.fixes.append(fix)
