"""OBSTACLE_DISTANCE as autopilots read it: packed, written to a tlog or a link, read back by pymavlink."""

from __future__ import annotations

import math
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live_peers import PATIENCE_S, until
from obstacle_worlds import CAMERA, SETTINGS, SIGHT, camera_attitude, ground, looked, nothing, result, wall

from flightdepth.flight.records import NS_PER_S
from flightdepth.live import obstacle_sender
from flightdepth.live.motion_store import MotionAt
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import (
    COMPONENT,
    UNKNOWN,
    ObstaclePacker,
    distances_cm,
    in_tlog,
    is_own_log,
)
from flightdepth.live.obstacle_sender import ObstacleFeed, ObstacleSender
from flightdepth.live.obstacles import SECTORS, Sectors
from flightdepth.live.status import Health, LiveResult, LiveStatus, State
from flightdepth.motion import quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges.result import RangedDepth

mavutil = pytest.importorskip("pymavlink.mavutil")
from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: E402

FREE = 4001
DISTANCE, HEARTBEAT = "OBSTACLE_DISTANCE", "HEARTBEAT"


def live_result(
    stamp_ns: int, depth: RangedDepth, *, body: tuple[float, ...] | None = (0, 0, 0)
) -> LiveResult:
    """A result of a camera that looks ahead, flying sideways."""
    status = LiveStatus(stamp_ns, Health(State.OK, None, 0))
    turn = None if body is None else quaternion_from_rotation(rotation_from_euler(*map(math.radians, body)))
    return LiveResult(
        depth=depth,
        image=np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8),
        camera=CAMERA,
        stamp_ns=stamp_ns,
        ready_ns=stamp_ns + 30_000_000,
        boot_ns=stamp_ns + 5 * NS_PER_S,
        motion=MotionAt(camera_attitude(), turn, np.array([0.0, 3.0, 0.0]), None),
        status=status,
    )


def of(result_: LiveResult, **motion) -> LiveResult:
    """The same with another motion."""
    return replace(result_, motion=replace(result_.motion, **motion))


def yawed(degrees: float) -> np.ndarray:
    return quaternion_from_rotation(rotation_from_euler(0, 0, math.radians(degrees)))


def feed(**options) -> ObstacleFeed:
    return ObstacleFeed(ObstacleMap(lambda _: SIGHT), ObstaclePacker(SETTINGS, system=lambda: 7), **options)


def decoded(messages: Iterable[bytes]) -> list:
    parser = dialect.MAVLink(None)
    parser.robust_parsing = False
    return parser.parse_buffer(bytearray(b"".join(messages))) or []


def test_the_numbers_are_those_of_mavlink():
    assert dialect.MAV_COMP_ID_OBSTACLE_AVOIDANCE == COMPONENT
    assert dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE == 330


def test_every_field_of_a_message():
    sectors = looked(result(wall(camera_attitude(), 10.0)))
    message = decoded([ObstaclePacker(SETTINGS, system=lambda: 7).distances(sectors, 123_456)])[0]
    assert message.get_type() == DISTANCE and message.get_srcSystem() == 7
    assert message.get_srcComponent() == COMPONENT
    assert message.time_usec == 123_456 and message.frame == 12
    assert (message.increment, message.increment_f, message.angle_offset) == (5, 0.0, 0.0)
    assert (message.min_distance, message.max_distance) == (100, 4000)
    assert message.distances == distances_cm(sectors, SETTINGS).tolist()
    assert len(message.distances) == SECTORS


def test_the_sender_takes_the_vehicles_number_once_it_is_heard():
    """A vehicle numbered 42 got messages of system 1."""
    heard: list[int] = []
    packer = ObstaclePacker(SETTINGS, system=lambda: heard[0] if heard else None)
    before = packer.heartbeat(usable=True)
    heard.append(42)
    messages = decoded([before, packer.heartbeat(usable=True), packer.distances(looked(nothing(60.0)), 1)])
    assert [message.get_srcSystem() for message in messages] == [1, 42, 42]
    assert {message.get_srcComponent() for message in messages} == {COMPONENT}


def test_what_ardupilot_and_px4_make_of_it():
    """Both index by angle: ArduPilot index to angle (j * increment), PX4 angle to index (ceil of angle / increment)."""
    sectors = looked(result(wall(camera_attitude(), 10.0)))
    message = decoded([ObstaclePacker(SETTINGS).distances(sectors, 1)])[0]
    for index, distance in enumerate(message.distances):
        angle = index * message.increment + message.angle_offset
        assert math.ceil((angle - message.angle_offset) % 360 / message.increment) == index
        if distance not in (UNKNOWN, message.max_distance + 1):
            assert message.min_distance <= distance <= message.max_distance
            side = min(angle, 360 - angle)
            low, high = (1000 / math.cos(math.radians(edge)) for edge in (max(side - 2.5, 0), side))
            assert low * 0.98 <= distance <= high + 1


def test_fifteen_a_second_and_a_heartbeat_each_second():
    steady = feed()
    kinds = []
    for step in range(0, 2900, 2):  # a result each 34 ms
        now_ns = step * 1_000_000
        if step % 34 == 0:
            steady.take(live_result(now_ns, nothing(90.0)))
        kinds += [message.get_type() for message in decoded(steady.due(now_ns))]
    assert kinds.count(HEARTBEAT) == 3
    assert 41 <= kinds.count(DISTANCE) <= 44


def test_a_stopped_estimator_falls_silent_and_its_heartbeat_says_so():
    stopped = feed()
    stopped.take(live_result(0, nothing(90.0)))
    states, last_ns = [], 0
    for step in range(200):
        for message in decoded(stopped.due(step * 10_000_000)):
            if message.get_type() == HEARTBEAT:
                states.append(message.system_status)
            else:
                last_ns = step * 10_000_000
    assert states == [dialect.MAV_STATE_ACTIVE, dialect.MAV_STATE_CRITICAL]
    assert 0.4 * NS_PER_S < last_ns <= 0.5 * NS_PER_S


@pytest.mark.parametrize(("age_ms", "sent"), [(-51, False), (-40, True), (500, True), (501, False)])
def test_a_result_that_is_old_or_from_the_future_is_not_sent(age_ms, sent):
    """One from the future was sent until that had passed, and as long again."""
    aging, now_ns = feed(), 100 * NS_PER_S
    aging.take(live_result(now_ns - age_ms * 1_000_000, nothing(90.0)))
    assert (aging.fresh(now_ns) is not None) == sent
    heartbeat, *distances = decoded(aging.due(now_ns))
    assert heartbeat.system_status == (dialect.MAV_STATE_ACTIVE if sent else dialect.MAV_STATE_CRITICAL)
    assert len(distances) == sent


def test_the_same_result_comes_nearer_as_the_drone_flies_on():
    aging = feed()
    aging.take(
        of(live_result(0, result(wall(camera_attitude(), 10.0))), velocity_ned=np.array([3.0, 3.0, 0.0]))
    )
    first = decoded(aging.due(0))[-1].distances[0]
    later = decoded(aging.due(200_000_000))[-1].distances[0]
    assert first - later == pytest.approx(60, abs=1)


def test_distances_are_those_to_the_drone_where_it_is_when_they_are_sent():
    """It stopped just after the picture, and turned right by 20 degrees since."""
    stopped = MotionAt(None, yawed(20), np.array([-3.0, -3.0, 0.0]), None)  # on average: 0 since the picture
    asked: list[int] = []
    telling = feed(motion_at=lambda now_ns: asked.append(now_ns) or stopped)
    telling.take(
        of(live_result(0, result(wall(camera_attitude(), 10.0))), velocity_ned=np.array([3.0, 3.0, 0.0]))
    )
    told = np.array(decoded(telling.due(100_000_000))[-1].distances)
    assert asked == [100_000_000]
    assert told[-4] == told.min() == pytest.approx(1000, abs=2) and told[0] > 1040


def test_what_motion_is_unknown_by_now_stays_as_the_result_had_it():
    telling = feed(motion_at=lambda now_ns: MotionAt(None, None, None, None))
    telling.take(
        of(live_result(0, result(wall(camera_attitude(), 10.0))), velocity_ned=np.array([3.0, 3.0, 0.0]))
    )
    assert decoded(telling.due(200_000_000))[-1].distances[0] == pytest.approx(940, abs=2)


def test_what_is_wanting_for_obstacles_is_told() -> None:
    """All was unknown, and the state said that all was well."""
    told = feed()
    told.take(live_result(NS_PER_S, result(wall(camera_attitude(), 10.0)), body=None))
    assert (
        told.lacking
        == "obstacles are unknown: nobody tells the drone's heading (a camera screwed to it: --mount fixed)"
    )
    told.take(live_result(2 * NS_PER_S, result(wall(camera_attitude(), 10.0))))
    assert told.lacking is None


def test_without_the_drones_heading_all_is_unknown_unless_the_camera_looks_ahead():
    seen = live_result(0, result(wall(camera_attitude(), 10.0)), body=None)
    lost, ahead = feed(), feed(camera_ahead=True)
    lost.take(seen)
    ahead.take(seen)
    assert set(decoded(lost.due(0))[-1].distances) == {UNKNOWN}
    assert decoded(ahead.due(0))[-1].distances[0] == pytest.approx(1000, abs=2)


def test_a_tlog_comes_back_through_mavutil(tmp_path: Path):
    path = tmp_path / "out.tlog"
    steady, written = feed(), []
    with path.open("wb") as log:
        for step in range(60):
            steady.take(live_result(step * 33_000_000, result(wall(camera_attitude(), 10.0 + step))))
            for message in steady.due(step * 33_000_000):
                log.write(in_tlog(1_700_000_000_000_000 + step * 33_000, message))
                written += decoded([message])
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    back = []
    while (message := connection.recv_match()) is not None:
        back.append(message)
    connection.close()
    assert [m.get_type() for m in back] == [m.get_type() for m in written]
    assert [m.to_dict() for m in back] == [m.to_dict() for m in written]
    assert back[-1]._timestamp == pytest.approx(1_700_000_000 + 59 * 0.033, abs=0.1)


@pytest.fixture
def clock(monkeypatch):
    """The sender's: no result grows old while a busy machine works out its sectors."""
    clock = SimpleNamespace(now_ns=1_000 * NS_PER_S)
    monkeypatch.setattr(obstacle_sender, "time", SimpleNamespace(monotonic_ns=lambda: clock.now_ns))
    return clock


def test_a_dead_link_stops_nobody(clock):
    def broken(message: bytes) -> None:
        raise OSError("no route to host")

    live = feed()
    with ObstacleSender(live, broken) as sender:
        live.take(live_result(clock.now_ns, nothing(90.0)))
        until(lambda: sender.failed >= 2, within_s=3)
    assert sender.sent == 0


def test_messages_that_cannot_be_made_are_counted_and_stop_nobody(clock):
    """Their thread ended without a word: a picture from before the autopilot's power-up has a time below 0."""
    live, sent = feed(), []
    with ObstacleSender(live, sent.append) as sender:
        early = live_result(clock.now_ns, result(wall(camera_attitude(), 10.0)))
        live.take(replace(early, boot_ns=-5_000_000))
        until(lambda: sender.failed)
        clock.now_ns += NS_PER_S
        live.take(live_result(clock.now_ns, result(wall(camera_attitude(), 10.0))))
        until(lambda: DISTANCE in {message.get_type() for message in decoded(list(sent))})


def test_the_heartbeat_goes_out_where_the_distances_cannot_be_made(clock):
    """It was lost with them, and counted as sent: none came for a second."""
    live, sent = feed(), []
    live.take(replace(live_result(clock.now_ns, nothing(90.0)), boot_ns=-5_000_000))
    with ObstacleSender(live, sent.append) as sender:
        until(lambda: sender.failed)
    assert [message.get_type() for message in decoded(sent)] == [HEARTBEAT]
    assert (sender.sent, sender.failed) == (1, 1)


def test_udp_to_pymavlink(clock):
    """The sender's own thread and a real socket, read by another pymavlink."""
    listener = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="ardupilotmega")
    port = listener.port.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        live = feed()
        live.take(live_result(clock.now_ns, result(wall(camera_attitude(), 10.0))))
        with ObstacleSender(live, lambda message: out.sendto(message, ("127.0.0.1", port))):
            message = listener.recv_match(type=DISTANCE, blocking=True, timeout=PATIENCE_S)
    listener.close()
    assert message is not None and message.get_srcComponent() == COMPONENT
    assert 850 < message.distances[0] <= 1000


@pytest.mark.slow
def test_mavproxy_reads_them(tmp_path: Path):
    """MAVProxy as the ground station: it logs what it receives from us into its own tlog."""
    program = shutil.which("mavproxy.py") or shutil.which(
        "mavproxy.py", path=str(Path(sys.executable).parent)
    )
    if program is None:
        pytest.skip("MAVProxy is not installed")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = tmp_path / "mavproxy.tlog"
    options = [
        "--master",
        f"udpin:127.0.0.1:{port}",
        "--logfile",
        str(log),
        "--daemon",
        "--state-basedir",
        str(tmp_path),
    ]
    with (
        subprocess.Popen(
            [program, *options], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out,
    ):
        try:
            live = feed()
            with ObstacleSender(live, lambda message: out.sendto(message, ("127.0.0.1", port))):
                deadline = time.monotonic() + 40
                while time.monotonic() < deadline and _count(log) < 20:
                    live.take(live_result(time.monotonic_ns(), result(wall(camera_attitude(), 10.0))))
                    time.sleep(0.05)
        finally:
            peer.terminate()
    assert _count(log) >= 20


def _count(log: Path) -> int:
    """How many OBSTACLE_DISTANCE with a wall ahead MAVProxy has logged."""
    if not log.exists() or not log.stat().st_size:
        return 0
    connection = mavutil.mavlink_connection(str(log), dialect="ardupilotmega")
    found = 0
    while (message := connection.recv_match(type=DISTANCE)) is not None:
        found += 850 < message.distances[0] <= 1000
    connection.close()
    return found


@pytest.mark.parametrize("min_m", [0.14, 0.28, 0.55, 1.0, 1.1, 1.12, 2.2])
def test_the_nearest_value_is_within_the_range_that_is_told(min_m: float) -> None:
    """Autopilots leave out what is not."""
    settings = replace(SETTINGS, min_m=min_m)
    packer = ObstaclePacker(settings, system=lambda: 7)
    near = looked(nothing())
    near = replace(near, obstacle_m=np.full_like(near.obstacle_m, min_m / 2))
    [message] = decoded([packer.distances(near, 0)])
    assert set(message.distances) == {message.min_distance}


def at(distances_m, *, clear_m=0.0) -> Sectors:
    """Sectors with these obstacles, the first ahead and each next one clockwise."""
    nothing_known = Sectors.unknown()
    nothing_known.obstacle_m[: len(distances_m)] = distances_m
    return replace(nothing_known, clear_m=np.full(SECTORS, clear_m))


def test_the_heartbeat_is_that_of_an_onboard_computer_and_no_autopilots():
    """Else ground stations take it for another vehicle."""
    [beat] = decoded([ObstaclePacker(SETTINGS).heartbeat(usable=True)])
    assert beat.type == dialect.MAV_TYPE_ONBOARD_CONTROLLER == 18
    assert beat.autopilot == dialect.MAV_AUTOPILOT_INVALID == 8
    assert (beat.base_mode, beat.custom_mode) == (0, 0)


def test_messages_are_numbered_and_the_numbers_wrap_around():
    packer = ObstaclePacker(SETTINGS)
    messages = decoded([packer.heartbeat(usable=True) for _ in range(258)])
    assert [message.get_seq() for message in messages] == [*range(256), 0, 1]


def test_messages_before_an_autopilot_is_heard_are_of_system_1_and_its_number_stays():
    numbers = iter([None, 42, None])
    packer = ObstaclePacker(SETTINGS, system=lambda: next(numbers))
    messages = decoded([packer.heartbeat(usable=True) for _ in range(3)])
    assert [message.get_srcSystem() for message in messages] == [1, 42, 42]


@pytest.mark.parametrize(
    ("obstacle_m", "clear_m", "told"),
    [
        (40.0, 40.0, 4000),
        (40.01, 40.01, FREE),
        (math.nan, 40.0, FREE),
        (math.nan, 39.99, 3999),
        (math.nan, 12.3499, 1234),  # rounded down, never farther than known
        (12.3499, 12.3499, 1234),
        (1.13, 0.0, 113),  # 112.99999999999999 centimetres
        (math.nan, 1.0, 100),
        (math.nan, 0.99, UNKNOWN),
        (0.3, 0.3, 100),
    ],
)
def test_what_is_told_of_a_sector(obstacle_m, clear_m, told):
    assert distances_cm(at([obstacle_m], clear_m=clear_m), SETTINGS)[0] == told


def test_a_log_is_known_for_ours_by_its_first_message():
    ours = in_tlog(1_700_000_000_000_000, ObstaclePacker(SETTINGS).heartbeat(usable=True))
    assert is_own_log(ours[:15]) and not is_own_log(ours[:14]) and not is_own_log(b"")
    for place in (8, 14):  # MAVLink 2's first byte; the component
        assert not is_own_log(ours[:place] + b"\x01" + ours[place + 1 :])


# What is sent of a result


def test_the_height_that_somebody_tells_keeps_the_ground_out():
    attitude = camera_attitude(pitch=-10)
    low = of(live_result(0, result(ground(attitude, 1.2), farther_m=60.0)), world_from_camera=attitude)
    for height_m, told in ((None, True), (1.2, False)):
        flying = feed()
        flying.take(of(low, height_above_ground_m=height_m))
        assert np.isfinite(flying.fresh(0).sectors.obstacle_m).any() == told


def test_the_drones_own_heading_stands_before_its_cameras():
    """A camera 30 degrees to the right of the nose: its wall is in sector 6, whoever says that it looks ahead."""
    attitude = camera_attitude(yaw=30)
    seen = of(live_result(0, result(wall(attitude, 10.0, bearing_deg=30))), world_from_camera=attitude)
    ahead = feed(camera_ahead=True)
    ahead.take(seen)
    assert ahead.fresh(0).sectors.obstacle_m[6] == pytest.approx(10.0, rel=0.01)


def test_a_camera_that_looks_ahead_tells_the_heading_in_any_direction():
    attitude = camera_attitude(pitch=-20, yaw=60)
    seen = of(live_result(0, result(wall(attitude, 10.0, bearing_deg=60))), world_from_camera=attitude)
    ahead = feed(camera_ahead=True)
    ahead.take(of(seen, world_from_body=None))
    assert np.nanargmin(ahead.fresh(0).sectors.obstacle_m) == 0
    assert ahead.fresh(0).sectors.obstacle_m[0] == pytest.approx(10.0, rel=0.02)


def test_all_that_is_wanting_is_told_in_one_sentence():
    told = feed(camera_ahead=True)
    told.take(of(live_result(0, nothing(60.0)), world_from_camera=None, world_from_body=None))
    assert told.lacking == "obstacles are unknown: nobody tells the camera's attitude and the drone's heading"
    told.take(of(live_result(1, nothing(60.0)), world_from_camera=None))
    assert told.lacking == "obstacles are unknown: nobody tells the camera's attitude"


@pytest.mark.parametrize(("boot_ns", "told_us"), [(7 * NS_PER_S, 7_000_000), (None, 2_000_000)])
def test_messages_tell_when_the_picture_was_taken(boot_ns, told_us):
    """By the autopilot's clock where that is known."""
    timed = feed()
    seen = live_result(2 * NS_PER_S, result(wall(camera_attitude(), 10.0)))
    timed.take(replace(seen, boot_ns=boot_ns))
    _, distances = decoded(timed.due(2 * NS_PER_S + 100_000_000))
    assert distances.time_usec == told_us


def test_nothing_is_sent_twice_within_a_fifteenth_of_a_second():
    steady = feed()
    steady.take(live_result(0, nothing(90.0)))
    times_ms = [ms for ms in range(0, 400) if len(list(steady.due(ms * 1_000_000))) > (ms == 0)]
    assert times_ms == [0, 66, 132, 198, 264, 330, 396]


def test_a_clock_that_went_back_holds_nothing_up():
    steady = feed()
    for now_ns in (10 * NS_PER_S, NS_PER_S):
        steady.take(live_result(now_ns, nothing(90.0)))
        assert len(list(steady.due(now_ns))) == 2


def test_nothing_is_due_before_somebody_is_heard_and_what_is_sent_is_counted(clock):
    live, sent, heard, asked = feed(), [], threading.Event(), threading.Event()

    def is_heard():
        asked.set()
        return heard.is_set()

    live.take(live_result(clock.now_ns, nothing(90.0)))
    with ObstacleSender(live, sent.append, heard=is_heard) as sender:
        assert asked.wait(PATIENCE_S)
        asked.clear()
        assert asked.wait(PATIENCE_S) and not sent  # asked once more, after it might have sent
        heard.set()
        until(lambda: sender.sent == 2)
    assert [message.get_type() for message in decoded(sent)] == [HEARTBEAT, DISTANCE]
    assert sender.failed == 0 and not sender._thread.is_alive()
