"""Telemetry from ROS recordings: ROS 1 bags, ROS 2 folders (MCAP or SQLite) and MCAP files.

One topic gives the velocity: the one asked for, else the best kind (Odometry, TwistWithCovarianceStamped,
TwistStamped) with the most messages. One that is zero throughout comes after those that move: many lidar odometries
never fill in their twist. Where no velocity moves, but positions do (Odometry, poses), it is their slope. Other topics
with an orientation turn a body-frame velocity into the world, or are the attitude of the camera if their frame's name
says so ("optical"). The orientation of the body is not taken for the camera's: nobody tells how the camera is mounted,
or whether a gimbal turns it.

Times are those of the messages' headers, counted from the first picture in the recording, so that its own
pictures (`ros_frames`) are on the same clock; from the first velocity where it holds no pictures.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.order import in_time_order
from flightdepth.flight.positions import velocities, without_jumps
from flightdepth.flight.records import (
    NS_PER_S,
    AttitudeSample,
    BodyAttitudeSample,
    Telemetry,
    VelocitySample,
    by_time,
)
from flightdepth.flight.ros1_bag import looks_like_ros1, ros1_messages
from flightdepth.flight.ros2_bag import looks_like_ros2, ros2_messages
from flightdepth.flight.ros_messages import (
    FLU_FROM_OPTICAL,
    FRD_FROM_FLU,
    IMAGE_KINDS,
    IMU,
    MAVROS_GLOBAL,
    ORIENTATION_KINDS,
    PLACE_KINDS,
    VELOCITY_KINDS,
    Orientation,
    Place,
    Twist,
    decoded,
    orientation_of,
    place_of,
    stamp_of,
    twist_of,
)
from flightdepth.flight.ros_records import DamagedError, RosMessage, Wanted
from flightdepth.motion import (
    Vector,
    mixed_quaternions,
    quaternion_from_rotation,
    rotation_from_quaternion,
)

LEAST_PLACES, FINEST_M = 5, 1e-4  # positions that tell a velocity, and their rounding at least
NEAR_NS = 100_000_000  # an orientation farther away says nothing of a velocity
ASKED_FOR = ("setpoint", "goal", "target", "cmd")
UNREADABLE = "messages that cannot be read"
USED = frozenset([*VELOCITY_KINDS, *ORIENTATION_KINDS, *IMAGE_KINDS])


@dataclass
class Topic:
    """What one topic of a recording said."""

    name: str
    kind: str
    messages: int = 0
    first_ns: int | None = None
    twists: list[Twist] = field(default_factory=list)
    orientations: list[Orientation] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
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
        placed = {place.stamp_ns: place.ned for place in self.places}
        if self.asked_for or not self.still or len(placed) < LEAST_PLACES:
            return
        stamps_ns = np.array(sorted(placed), dtype=np.int64)
        ned = np.stack([placed[stamp_ns] for stamp_ns in stamps_ns.tolist()])
        kept = without_jumps(ned)
        found = velocities(stamps_ns[kept], ned[kept], steps_m=(FINEST_M, FINEST_M))
        if np.any(found.velocity_ned):
            self.by_places = True
            self.twists = [
                Twist(each.stamp_ns, each.velocity, each.frame, each.sigma) for each in found.samples()
            ]


def looks_like_ros(head: bytes, path: Path) -> bool:
    """A recording of ROS 1 or ROS 2."""
    return looks_like_ros1(head, path) or looks_like_ros2(head, path)


def ros_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of the wanted types in any ROS recording."""
    reader = ros1_messages if looks_like_ros1(head_of(path, 16), path) else ros2_messages
    return reader(path, wanted, counts)


def read_ros(path: Path, topic: str | None = None) -> Telemetry:
    """Read a recording; `topic` chooses the velocity where the best guess is not the right one."""
    counts: Counter[str] = Counter()
    topics, kinds = _topics(path, counts)
    chosen = _choose(path, topics, kinds, topic)
    oriented = max(topics, key=lambda known: _knows_turns(known, chosen))
    first_ns = _first_picture_ns(topics)
    zero_ns = chosen.twists[0].stamp_ns if first_ns is None else first_ns
    samples = in_time_order(_velocities(chosen.twists, oriented.orientations, zero_ns, counts), counts)
    attitudes = in_time_order(_camera_attitudes(topics, zero_ns), counts)
    name = f"ROS recording {path.name}: {len(samples)} velocities of {chosen.name}"
    name += ", by its positions" if chosen.by_places else ""
    name += ", attitude of the camera" if attitudes else ""
    name += f"; its time 0 is {zero_ns / NS_PER_S:.3f} s of its clock"
    # Not counted: an Odometry's velocity has been.
    bodies = in_time_order(_body_attitudes(oriented.orientations, zero_ns), Counter())
    return Telemetry(name, by_time(samples, attitudes), dict(+counts), body_attitudes=tuple(bodies))


def _knows_turns(topic: Topic, chosen: Topic) -> tuple[bool, bool, bool, bool, int]:
    """What ranks the topics that tell how the body is turned: the velocity's own, one that tells how it is and not how
    it is to be, a pose before a mere gyroscope's.
    """
    count = sum(not turn.of_camera for turn in topic.orientations)
    return count > 0, topic is chosen, not topic.asked_for, topic.kind != IMU, count


def _topics(path: Path, counts: Counter[str]) -> tuple[list[Topic], dict[str, str]]:
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
        if message.kind in ORIENTATION_KINDS and (turn := orientation_of(message, content)):
            topic.orientations.append(turn)
        if message.kind in PLACE_KINDS and (place := place_of(message, content)):
            topic.places.append(place)
        if message.kind in VELOCITY_KINDS:
            twist = twist_of(message, content)
            if twist is None:
                counts[f"velocities of unknown axes (frame {content.header.frame_id[:40]!r})"] += 1
            else:
                topic.twists.append(twist)
    except DamagedError:
        counts[UNREADABLE] += 1


def _choose(path: Path, topics: Sequence[Topic], kinds: dict[str, str], name: str | None) -> Topic:
    asked = [known for known in topics if name in (None, known.name)]
    # Else the slopes, which take time, are not needed.
    if all(known.asked_for or known.still for known in asked):
        for known in asked:
            known.tell_by_places()
    fit = [known for known in asked if known.twists]
    if fit:

        def rank(known: Topic) -> tuple[bool, bool, bool, int, int, str]:
            first = known.asked_for, known.still, known.name.endswith(MAVROS_GLOBAL)
            return *first, (*VELOCITY_KINDS, *PLACE_KINDS).index(known.kind), -len(known.twists), known.name

        return min(fit, key=rank)
    listed = ", ".join(f"{known} ({kind})" if kind else known for known, kind in sorted(kinds.items()))
    expected = f"a velocity in {name}" if name else f"a topic with a velocity ({', '.join(VELOCITY_KINDS)})"
    raise BadInput(f"telemetry {path}", expected=expected, got=(listed or "no message")[:1000])


def _first_picture_ns(topics: Sequence[Topic]) -> int | None:
    pictures = [topic for topic in topics if topic.kind in IMAGE_KINDS and topic.first_ns is not None]
    best = min(pictures, key=lambda topic: (-topic.messages, topic.name), default=None)
    return None if best is None else best.first_ns


def _velocities(
    twists: Sequence[Twist], orientations: Sequence[Orientation], zero_ns: int, counts: Counter[str]
) -> list[VelocitySample]:
    """In the world frame where orientations are told, else the camera's: that of a camera which looks forward."""
    bodies = sorted((o for o in orientations if not o.of_camera), key=lambda o: o.stamp_ns)
    stamps = np.array([orientation.stamp_ns for orientation in bodies], dtype=np.int64)
    samples = []
    for twist in twists:
        stamp_ns = twist.stamp_ns - zero_ns
        ned_from_body = _turned(bodies, stamps, twist.stamp_ns) if twist.frame == "body" else None
        if twist.frame == "world":
            samples.append(VelocitySample(stamp_ns, twist.velocity, "world", twist.sigma))
        elif ned_from_body is not None:
            samples.append(VelocitySample(stamp_ns, ned_from_body @ twist.velocity, "world", twist.sigma))
        elif twist.frame == "body" and bodies:  # a flight has one frame
            counts["velocities without an orientation near them"] += 1
        else:
            turn = FLU_FROM_OPTICAL.T if twist.frame == "body" else np.eye(3)
            samples.append(VelocitySample(stamp_ns, turn @ twist.velocity, "camera", twist.sigma))
    return samples


def _turned(
    bodies: Sequence[Orientation], stamps: np.ndarray[tuple[int], np.dtype[np.int64]], stamp_ns: int
) -> Vector | None:
    """The rotation between the orientations before and after; that of the near one where these are far apart."""
    after = int(np.searchsorted(stamps, stamp_ns))
    around = bodies[max(after - 1, 0) : after + 1]
    apart_ns = around[-1].stamp_ns - around[0].stamp_ns if around else 0
    if not 0 < apart_ns <= 2 * NEAR_NS:
        near = (body.ned_from_frame for body in around if abs(body.stamp_ns - stamp_ns) <= NEAR_NS)
        return next(near, None)
    share = (stamp_ns - around[0].stamp_ns) / apart_ns
    start, end = (quaternion_from_rotation(body.ned_from_frame) for body in around)
    return rotation_from_quaternion(mixed_quaternions(start, end, share))


def _body_attitudes(orientations: Sequence[Orientation], zero_ns: int) -> list[BodyAttitudeSample]:
    bodies = [orientation for orientation in orientations if not orientation.of_camera]
    return [
        BodyAttitudeSample(
            body.stamp_ns - zero_ns, quaternion_from_rotation(body.ned_from_frame @ FRD_FROM_FLU)
        )
        for body in bodies
    ]


def _camera_attitudes(topics: Sequence[Topic], zero_ns: int) -> list[AttitudeSample]:
    found = [[o for o in topic.orientations if o.of_camera] for topic in topics]
    most = max(found, key=len, default=[])
    return [AttitudeSample(o.stamp_ns - zero_ns, quaternion_from_rotation(o.ned_from_frame)) for o in most]
