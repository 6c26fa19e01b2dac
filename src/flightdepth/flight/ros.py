"""Telemetry from ROS recordings: ROS 1 bags, ROS 2 folders (MCAP or SQLite) and MCAP files.

One topic gives the velocity: the one asked for, else the best kind (PX4's own VehicleLocalPosition and
VehicleOdometry, Odometry, TwistWithCovarianceStamped, TwistStamped, Vector3Stamped) with the most messages. One that
is zero throughout comes after those that move: many lidar odometries never fill in their twist. Where no velocity
moves, but positions do (Odometry, poses, at last NavSatFix), it is their slope. Other topics with an orientation turn
a body-frame velocity into the world, or are the attitude of the camera if their frame's name says so ("optical"). The
orientation of the body is not taken for the camera's: nobody tells how the camera is mounted, or whether a gimbal
turns it; the one that PX4 reports of a gimbal is the camera's.

Times are those of the messages' headers (`ros_px4` knows those of PX4's messages), counted from the first picture in
the recording, so that its own pictures (`ros_frames`) are on the same clock; from the first velocity where it holds no
pictures.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.order import in_time_order, rising
from flightdepth.flight.places import ELLIPSOID, SEA_LEVEL, PlaceTrack
from flightdepth.flight.records import (
    BodyAttitudeSample,
    Telemetry,
    VelocitySample,
    by_time,
    time_0_is,
)
from flightdepth.flight.ros1_bag import looks_like_ros1
from flightdepth.flight.ros2_bag import looks_like_ros2
from flightdepth.flight.ros_messages import (
    IMU,
    MAVROS_GLOBAL,
    OPTICAL_FROM_FRD,
    VECTOR,
    VELOCITY_KINDS,
    Twist,
    body_attitudes,
    camera_attitudes,
)
from flightdepth.flight.ros_places import NAV_SAT_FIX, PLACE_KINDS, track_of_fixes
from flightdepth.flight.ros_px4 import DEFINE, PX4_PLACE, PX4_POSITION, PX4_VELOCITY_KINDS, UNDEFINED
from flightdepth.flight.ros_topics import Topic, first_picture, topics_of
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.motion import (
    Stamps,
    Vector,
    mixed_quaternions,
    rotations_from_quaternions,
)

NEAR_NS = 100_000_000  # an orientation farther away says nothing of a velocity
TOLD_KINDS = (*PX4_VELOCITY_KINDS, *VELOCITY_KINDS)  # PX4's are fused, and say when they are not valid
OTHER_VEHICLES = "messages of other vehicles"
MAVROS = "mavros"  # in the name of its topics, whose map is east-north-up
# Others begin their map in any direction.
NORTHWARD_KINDS = (PX4_POSITION, VECTOR, NAV_SAT_FIX)
KINDS = (*TOLD_KINDS, *PLACE_KINDS, NAV_SAT_FIX)  # that tell a velocity, the best first


def looks_like_ros(head: bytes, path: Path) -> bool:
    """A recording of ROS 1 or ROS 2."""
    return looks_like_ros1(head, path) or looks_like_ros2(head, path)


def read_ros(path: Path, topic: str | None = None) -> Telemetry:
    """Read a recording; `topic` chooses the velocity where the best guess is not the right one."""
    counts: Counter[str] = Counter()
    topics, kinds = topics_of(path, counts)
    picture = first_picture(topics)
    shown = picture if topic is None else None
    if shown is not None:
        topics = _of_vehicle(topics, shown, counts)
    chosen = _choose(path, topics, kinds, topic, counts)
    if shown is None:
        topics = _of_vehicle(topics, chosen, counts)
    oriented = max(topics, key=lambda known: _knows_turns(known, chosen))
    first_ns = None if picture is None else picture.first_ns
    stamps_ns = [twist.stamp_ns for twist in chosen.twists]
    zero_ns = stamps_ns[rising(stamps_ns)[0]] if first_ns is None else first_ns
    turned = body_attitudes(oriented.bodies, zero_ns)
    samples = in_time_order(_velocities(chosen.twists, turned, zero_ns, counts), counts)
    most = max((topic.cameras for topic in topics), key=len, default=[])
    attitudes = in_time_order(camera_attitudes(most, zero_ns), counts)
    name = f"ROS recording {path.name}: {len(samples)} velocities of {chosen.name}"
    if chosen.by_places:
        name += ", by its positions"
    counts += chosen.unsound
    name += ", attitude of the camera" if attitudes else ""
    name += f" ({oriented.resets} resets of the attitude)" if oriented.resets else ""
    name += time_0_is(zero_ns)
    bodies = in_time_order(turned, Counter())  # not counted: an Odometry's velocity has been
    places = _places(topics, zero_ns, chosen, counts)
    true_north = chosen.kind in NORTHWARD_KINDS or MAVROS in chosen.name
    return Telemetry(
        name,
        by_time(samples, attitudes),
        dict(+counts),
        body_attitudes=tuple(bodies),
        places=places,
        true_north=true_north,
        time_0_told=first_ns is not None,
        utc=UniversalTime.of(zero_ns, "computer"),  # stamps of a simulation begin at 0
    )


def _of_vehicle(topics: Sequence[Topic], one: Topic, counts: Counter[str]) -> list[Topic]:
    """Without topics of vehicles named as that of `one` but for a number (/uav1/..., /uav2/...), if others tell motion.

    Two cameras of a drone may be named so too, of which one tells it.
    """

    def is_other(topic: Topic) -> bool:
        unnumbered = (re.sub(r"\d+", "", each.root) for each in (topic, one))
        return topic.root != one.root and len(set(unnumbered)) == 1

    own = [each for each in topics if not is_other(each)]
    if not any(each.twists or each.places or each.fixes for each in own):
        return list(topics)
    counts[OTHER_VEHICLES] += sum(each.messages for each in topics if is_other(each))
    return own


def _places(topics: Sequence[Topic], zero_ns: int, chosen: Topic, counts: Counter[str]) -> PlaceTrack | None:
    """Where on Earth the drone was: by what PX4 flies by, else by the receiver with most fixes."""
    fixed = [topic for topic in topics if topic.fixes and not topic.asked_for]
    if not fixed:
        return None
    told = max(fixed, key=lambda topic: (topic.kind == PX4_PLACE, len(topic.fixes)))
    above = SEA_LEVEL if told.kind == PX4_PLACE else ELLIPSOID
    # Those that jump have been counted where the velocities are the slopes of the same.
    return track_of_fixes(told.fixes, zero_ns, above, Counter() if told is chosen else counts)


def _knows_turns(topic: Topic, chosen: Topic) -> tuple[bool, bool, bool, bool, bool, int]:
    """What ranks the topics that tell how the body is turned: the velocity's own, one that tells how it is and not how
    it is to be, a pose before a mere gyroscope's, one of the velocity's source, whose north is the same.
    """
    count, of_its_source = len(topic.bodies), topic.folder == chosen.folder
    return count > 0, topic is chosen, not topic.asked_for, topic.kind != IMU, of_its_source, count


def _choose(
    path: Path, topics: Sequence[Topic], kinds: dict[str, str], name: str | None, counts: Counter[str]
) -> Topic:
    asked = [known for known in topics if name in (None, known.name)]
    # Else the slopes, which take time, are not needed.
    if all(known.asked_for or known.still for known in asked):
        for known in asked:
            known.tell_by_places()
    fit = [known for known in asked if known.twists]
    if fit:

        def rank(known: Topic) -> tuple[bool, bool, bool, int, int, str]:
            first = known.asked_for, known.still, known.name.endswith(MAVROS_GLOBAL)
            return *first, KINDS.index(known.kind), -len(known.twists), known.name

        return min(fit, key=rank)
    listed = ", ".join(f"{known} ({kind})" if kind else known for known, kind in sorted(kinds.items()))
    expected = f"a velocity in {name}" if name else f"a topic with a velocity ({', '.join(TOLD_KINDS)})"
    lost = sum((known.unsound for known in asked), counts)
    why = "".join(f"; {count} {reason}" for reason, count in (+lost).items())
    raise BadInput(
        f"telemetry {path}",
        expected=expected,
        got=(listed or "no message")[:1000] + why,
        mend=DEFINE if counts[UNDEFINED] else None,
    )


def _velocities(
    twists: Sequence[Twist], bodies: Sequence[BodyAttitudeSample], zero_ns: int, counts: Counter[str]
) -> list[VelocitySample]:
    """In the world frame where the body's attitudes are told; else of a camera that looks forward."""
    of_body = [twist.stamp_ns - zero_ns for twist in twists if twist.frame == "body"]
    at_ns = np.array(of_body, dtype=np.int64)
    turns = iter(_turns(sorted(bodies, key=lambda body: body.stamp_ns), at_ns))
    samples = []
    for twist in twists:
        stamp_ns = twist.stamp_ns - zero_ns
        ned_from_body = next(turns) if twist.frame == "body" else None
        if twist.frame == "world":
            samples.append(VelocitySample(stamp_ns, twist.velocity, "world", twist.sigma))
        elif ned_from_body is not None:
            samples.append(VelocitySample(stamp_ns, ned_from_body @ twist.velocity, "world", twist.sigma))
        elif twist.frame == "body" and bodies:  # a flight has one frame
            counts["velocities without an orientation near them"] += 1
        else:
            turn = OPTICAL_FROM_FRD if twist.frame == "body" else np.eye(3)
            samples.append(VelocitySample(stamp_ns, turn @ twist.velocity, "camera", twist.sigma))
    return samples


def _turns(bodies: Sequence[BodyAttitudeSample], at_ns: Stamps) -> list[Vector | None]:
    """Rotations between the orientations before and after, in time order; of the near one where these are far apart."""
    if not bodies or not len(at_ns):
        return [None] * len(at_ns)
    stamps_ns = np.array([body.stamp_ns for body in bodies], dtype=np.int64)
    quaternions = np.array([body.world_from_body for body in bodies])
    after = np.searchsorted(stamps_ns, at_ns)
    before, after = (after - 1).clip(min=0), after.clip(max=len(bodies) - 1)
    since_ns, apart_ns = at_ns - stamps_ns[before], stamps_ns[after] - stamps_ns[before]
    between = (apart_ns > 0) & (apart_ns <= 2 * NEAR_NS)
    near_before, near_after = np.abs(since_ns) <= NEAR_NS, np.abs(stamps_ns[after] - at_ns) <= NEAR_NS
    share = np.where(between, since_ns / np.maximum(apart_ns, 1), ~near_before)
    turns = rotations_from_quaternions(mixed_quaternions(quaternions[before], quaternions[after], share))
    known = between | near_before | near_after
    return [turn if told else None for turn, told in zip(turns, known, strict=True)]
