"""The engine's loop and its state with parts made by hand: nothing is opened, no network runs."""

from __future__ import annotations

import threading
import time
import weakref
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from obstacle_worlds import result

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.flight.turned_focal import TurnedFocal
from flightdepth.live import engine as engine_module
from flightdepth.live.depth_stage import DepthStage, Lens, NoCalibration, Staged
from flightdepth.live.engine import LiveEngine, Parts
from flightdepth.live.meters import Rate
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.slots import Newest
from flightdepth.live.status import State
from flightdepth.live.video_address import VideoAddress
from flightdepth.live.video_input import ENDED, NOT_TAKEN, VideoInput, VideoListener
from flightdepth.ranges.result import RangedDepth
from flightdepth.weights.store import find_network, read_card

CAMERA = Camera.from_fov(6, 4, 90)
IMAGE = np.zeros((4, 6, 3), np.uint8)
FLOWN = result(np.full((4, 6), 10.0))
PICTURE = SimpleNamespace(stamp_ns=1_000, age_from="sender", rgb=lambda: IMAGE)


class Stage:
    """Says of every picture that it has no depth, of the first ones with an error for each."""

    ranges = 1
    compiles = False
    faster = ""
    hovers = True

    def __init__(self, counts: Counter[str], errors: tuple[Exception, ...] = ()) -> None:
        self.counts, self.errors = counts, list(errors)

    def is_prepared(self, width, height):
        return not self.compiles

    def take(self, stamp_ns, image):
        if self.errors:
            raise self.errors.pop(0)
        depth = RangedDepth.unknown(CAMERA.height, CAMERA.width, "hovering", 1.0) if self.hovers else FLOWN
        return Staged(depth, image, CAMERA, compiled=self.compiles)


class Video:
    """So many pictures, and the end."""

    def __init__(self, pictures: int = 1) -> None:
        self.slot, self.ended, self.error = Pictures(pictures), threading.Event(), None
        self.received, self.reconnects, self.dropped, self.distrusted = pictures, 0, {}, None
        self.instead = None
        self.ended.set()

    def start(self) -> None:
        pass

    def close(self) -> None:
        pass


class Motion:
    """No telemetry."""

    def start(self) -> None:
        pass

    def close(self) -> None:
        pass


class Pictures(Newest):
    """PICTURE, so often."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.left = count

    def take(self, timeout_s):
        self.left -= 1
        return PICTURE if self.left >= 0 else None


def engine(counts: Counter[str] | None = None, errors=(), say=lambda text: None) -> LiveEngine:
    stage = Stage(Counter() if counts is None else counts, errors)
    parts = Parts(
        stage, MotionStore(), video=lambda listener: Video(1 + len(errors)), motion=lambda engine: None
    )
    return LiveEngine(parts, say=say)


def test_a_picture_becomes_a_result():
    run = engine()
    run.run(threading.Event())
    status = run.status()
    assert (status.frames.received, status.frames.used) == (1, 1)
    assert status.age_from == "sender"


def test_ages_of_more_than_a_minute_ago_are_not_told():
    run = engine()
    run._ages.add(time.monotonic_ns() - 61 * 10**9, 5.0)
    status = run.status()
    assert (status.age_ms, status.age_p95_ms) == (None, None)


def test_a_line_that_nobody_can_read_ends_nothing():
    def refuse(text):
        raise OSError("no space left on device")

    run = engine(say=refuse)
    run.on_link_error("no route to host")
    run.on_reboot(1)
    run.run(threading.Event())
    assert run.status().frames.used == 1


def test_the_state_asks_what_the_sinks_and_the_telemetry_lack():
    parts = Parts(
        Stage(Counter()),
        MotionStore(),
        video=lambda listener: Video(),
        motion=lambda engine: Motion(),
        lacking=lambda: "the drone's heading",
        untold=lambda: "no autopilot's heartbeat comes",
    )
    run = LiveEngine(parts)
    run.status()
    assert run._monitor.lacking == "the drone's heading"
    assert run._monitor.untold == "no autopilot's heartbeat comes"


def test_rates_are_read_under_the_lock_alone():
    """Reading forgets old events: two threads at once could each take the last."""

    class Guarded(Rate):
        def hz(self, now_ns):
            assert run._lock.locked()
            return super().hz(now_ns)

    run = engine()
    run._pictures, run._taken, run._results = Guarded(), Guarded(), Guarded()
    run.run(threading.Event())
    run.status()


def test_the_state_can_be_asked_while_a_picture_is_dropped_for_a_new_reason():
    class Growing(Counter):
        """As the estimator's thread makes it grow while another sums it up."""

        def items(self):
            for item in super().items():
                self["the same picture again"] += 1
                yield item

    dropped = engine(Growing({"not later than the one before": 2})).status().frames.dropped
    assert dropped["not later than the one before"] == 2


def test_no_picture_waits_for_the_judgement_of_the_lens():
    """The lens's thread is still at the first picture when the last one's result stands."""
    begun, over, stage = threading.Event(), threading.Event(), Stage(Counter())

    class Judging:
        verdict = None

        def take(self, result):
            begun.set()
            over.wait(20)

    parts = Parts(
        stage, MotionStore(), video=lambda listener: Video(), motion=lambda engine: Motion(), lens=Judging()
    )
    with LiveEngine(parts) as run:
        run._work(PICTURE)
        assert begun.wait(20)
        for _ in range(50):
            run._work(PICTURE)
        assert run.status().frames.used == 51 and not over.is_set()
        assert run.status().sinks["lens watch"].missed == 49
        over.set()


def test_what_turns_say_of_the_lens_is_the_state():
    told = TurnVerdict(TurnedFocal(None), doubt="focal length 390 px, where the turns tell 300")
    parts = Parts(
        Stage(Counter()),
        MotionStore(),
        video=lambda listener: Video(),
        motion=lambda engine: Motion(),
        lens=SimpleNamespace(verdict=told, take=lambda result: None),
    )
    run = LiveEngine(parts)
    assert run.status().lens is told
    assert run._monitor.lens_doubt == told.doubt


def test_why_nothing_comes_is_said_once_until_something_does():
    """A line each second or two for as long as a camera was off, beside the state that says it anyway."""
    said = []
    run = engine(say=said.append)
    for _ in range(3):
        run._on_stream_error("nothing came in time")
        run.on_link_error("MAVLink tcp:x:1: refused")
    run._on_stream_error("another sender began")
    run._on_picture(1)
    run.on_velocity(1)
    run._on_stream_error("another sender began")
    run.on_link_error("MAVLink tcp:x:1: refused")
    again = "; opening it again"
    came, other = f"video: nothing came in time{again}", f"video: another sender began{again}"
    link = f"MAVLink tcp:x:1: refused{again}"
    assert said == [came, link, other, other, link]


def test_pictures_that_repeat_are_no_slow_machine(monkeypatch):
    """Of a camera of 5 pictures a second in a stream of 30 it said `the machine is too slow`."""
    run, clock = engine(), SimpleNamespace(now_ns=10**12)
    take = run._stage.take
    monkeypatch.setattr(engine_module, "time", SimpleNamespace(monotonic_ns=lambda: clock.now_ns))
    for i in range(60):
        clock.now_ns += 10**9 // 30
        monkeypatch.setattr(run._stage, "take", (lambda *picture: None) if i % 6 else take)
        run._on_picture(clock.now_ns)
        run._work(PICTURE)
    assert run.status().fps == pytest.approx(5)
    assert run._monitor.taken_hz == pytest.approx(30)


def test_the_engine_keeps_no_result():
    """Freeing the last one's maps took milliseconds, with the lock held."""
    run = engine()
    kept = []
    run.add_sink("test", lambda result: kept.append(weakref.ref(result.depth)))
    run.run(threading.Event())
    run._sinks[0].close()
    assert kept and kept[0]() is None


def test_of_a_sink_s_failure_the_error_s_own_words_are_told():
    said = []
    run = engine(say=said.append)
    run._on_sink_failure("recorder", BadInput("disk", expected="500 MB", got="1 MB"))
    run._on_sink_failure("page", OSError("broken"))
    assert said == [
        "recorder failed, the estimator goes on: disk: expected 500 MB, got 1 MB",
        "page failed, the estimator goes on: OSError: broken",
    ]


UNCALIBRATED = NoCalibration("camera: expected a calibration for 100x100, got one for 6x4")
DAMAGED = BadInput("velocity frame", expected="world or camera", got="'sea'")


def test_each_refusal_is_counted_by_its_own_reason_and_the_next_picture_counts():
    """Whatever could not be used was called a size without a calibration, and only the first was told."""
    said = []
    run = engine(errors=(UNCALIBRATED, DAMAGED, UNCALIBRATED, DAMAGED, DAMAGED), say=said.append)
    run.run(threading.Event())
    frames = run.status().frames
    assert frames.dropped == {"size without a calibration": 2, "refused: velocity frame": 3}
    assert frames.used == 1
    assert said == [str(UNCALIBRATED), str(DAMAGED)]


def test_pictures_of_another_size_are_told_with_the_focal_length_that_is_taken():
    """With --hfov a crop passed in silence, with all depths wrong by as much."""
    said = []
    run = engine(say=said.append)
    for width, fx in ((6, 3.0), (6, 3.0), (4, 2.0), (4, 2.0)):
        run._look_at_size(Camera(width, 4, fx, fx, 1.5, 1.5))
    assert said == ["video: the pictures are 4x4 now; their focal length is taken to be 2 px"]


def test_while_the_network_is_prepared_for_another_size_the_state_says_so():
    """It was `pictures come, but no results`, as of an estimator that hangs."""

    class Compiling(Stage):
        compiles = True

        def take(self, stamp_ns, image):
            told.append(run._monitor.preparing)
            return super().take(stamp_ns, image)

    told = []
    run = LiveEngine(
        Parts(Compiling(Counter()), MotionStore(), lambda listener: Video(), lambda engine: Motion())
    )
    run._work(PICTURE)
    assert told == [True]
    assert not run._monitor.preparing


@pytest.fixture
def clock(monkeypatch):
    """The engine's."""
    clock = SimpleNamespace(now_ns=10**12)
    monkeypatch.setattr(engine_module, "time", SimpleNamespace(monotonic_ns=lambda: clock.now_ns))
    return clock


def test_a_result_that_waited_for_the_network_is_not_old(clock):
    """After 5 s of compilation the state was `results are old: 5000 ms`, though none was."""

    class Compiling(Stage):
        compiles, hovers = True, False

        def take(self, stamp_ns, image):
            clock.now_ns += 5 * 10**9
            run._on_picture(clock.now_ns)
            run.on_velocity(clock.now_ns)
            return super().take(stamp_ns, image)

    run = LiveEngine(
        Parts(Compiling(Counter()), MotionStore(), lambda listener: Video(), lambda engine: Motion())
    )
    run._work(SimpleNamespace(**vars(PICTURE) | {"stamp_ns": clock.now_ns}))
    assert run.status().health.reason is None


def test_hovering_does_not_undo_the_wait_between_trials_of_one_more_range(clock):
    """Results without depth take next to nothing: n rose meanwhile, and held, so each flight began with trials anew."""
    costs_ms = {1: 150, 2: 240}  # of the 200 from picture to picture

    class Costly(Stage):
        ranges = 2

        def take(self, stamp_ns, image):
            clock.now_ns += 10**6 * (8 if self.hovers else costs_ms[self.ranges])
            return super().take(stamp_ns, image)

    stage, rose = Costly(Counter()), []
    run = LiveEngine(Parts(stage, MotionStore(), lambda listener: Video(), lambda engine: Motion()))
    for stage.hovers, seconds in (False, 60), (True, 20), (False, 60):
        rises = 0
        for _ in range(5 * seconds):
            next_ns, before = clock.now_ns + 2 * 10**8, stage.ranges
            run._on_picture(clock.now_ns)
            run._work(PICTURE)
            rises += stage.ranges > before
            clock.now_ns = next_ns
        rose.append(rises)
    assert rose == [4, 0, 1]  # after 2, 4, 8 and 16 s of room, and after the hovering; it was 4, 1, 4


def test_why_no_picture_can_be_used_is_the_state():
    run = engine(errors=(DAMAGED,))
    run._on_picture(1)
    run._work(PICTURE)
    health = run._monitor.judge(2)
    assert health.state is State.LOST
    assert health.reason.endswith(str(DAMAGED))


def test_only_a_size_that_the_camera_does_not_fit_is_one_without_a_calibration(monkeypatch):
    def refuse(*arguments):
        raise DAMAGED

    network = SimpleNamespace(grid=refuse)
    stage = DepthStage(network, Lens(CAMERA), MotionStore(), ranges=1, fixed=True)
    with pytest.raises(NoCalibration, match="100x100"):
        stage.take(1, np.zeros((100, 100, 3), np.uint8))
    with pytest.raises(BadInput, match="velocity frame") as other:
        stage.take(1, IMAGE)
    assert not isinstance(other.value, NoCalibration)


@pytest.mark.parametrize("ranges", [0, 5])
def test_ranges_that_there_are_not_are_refused_before_the_first_picture(ranges):
    with pytest.raises(BadInput, match="ranges: expected 1 to 4"):
        DepthStage(SimpleNamespace(), Lens(CAMERA), MotionStore(), ranges=ranges, fixed=True)


class SetClock:
    """A stream whose sender's clock is right at first, and then set by three seconds."""

    def pictures(self, clock, stop):
        for i in range(60):
            own_ns = i * 33_000_000
            set_ns = 3 * 10**9 * (i >= 30)
            clock.packet(own_ns, 10**12 + own_ns, sender_wall_ns=own_ns + set_ns, wall_now_ns=own_ns)
            yield SimpleNamespace(stamp_ns=own_ns)

    def close(self):
        pass


@pytest.mark.parametrize(
    ("name", "aligned", "faster"),
    [
        ("motion", True, " or --no-align or --network motion-tiny"),
        ("motion-tiny", True, " or --no-align"),
        ("motion-tiny", False, ""),
        ("tiny-clamped-512", True, " or --network tiny-clamped-256"),
        ("tiny-clamped-256", True, ""),
    ],
)
def test_what_is_advised_to_a_slow_machine_is_not_what_runs_already(name, aligned, faster):
    """It was --network motion-tiny while motion-tiny ran, and fewer ranges, of which only one was left."""
    network = SimpleNamespace(card=read_card(find_network(name)), aligned=aligned)
    stage = DepthStage(network, Lens(CAMERA), MotionStore(), ranges=2, fixed=True)
    assert stage.faster == "smaller pictures from the camera" + faster


def test_a_senders_clock_that_is_no_longer_followed_is_said_once_and_shown(monkeypatch):
    """Who asked for --sender-clock saw ages from reception, and not why."""
    said = []
    parts = Parts(
        Stage(Counter()),
        MotionStore(),
        video=lambda listener: VideoInput(VideoAddress("camera", "camera"), listener, sender_clock=True),
        motion=lambda engine: None,
    )
    run = LiveEngine(parts, say=said.append)
    monkeypatch.setattr(run._video, "_open", SetClock)
    run._video._read()
    why = "a wall clock was set by 3.0 s"
    assert run.status().distrusted == why
    assert said == [f"video: ages count from reception, not by the sender's clock: {why}"]


def test_of_a_clock_that_nobody_asked_for_nothing_is_said(monkeypatch):
    said = []
    video = VideoInput(
        VideoAddress("camera", "camera"), VideoListener(lambda now_ns: None, said.append, said.append)
    )
    monkeypatch.setattr(video, "_open", SetClock)
    video._read()
    assert (video.distrusted, said) == (None, [])


def test_a_picture_that_waits_when_the_run_ends_is_counted():
    """The summary said 31 used and 223 dropped of 255."""
    listener = VideoListener(lambda now_ns: None, print, print)
    video = VideoInput(VideoAddress("camera", "camera"), listener)
    for _ in range(2):
        video.slot.put(PICTURE)
    video.close()
    assert video.dropped == {NOT_TAKEN: 1, ENDED: 1}


@pytest.mark.parametrize("compiles", [True, False])
def test_the_time_to_compile_is_no_load_and_no_age(compiles: bool) -> None:
    run = engine()
    run._stage.compiles, run._stage.hovers = compiles, False
    loads: list[float] = []
    run._control = SimpleNamespace(add=lambda now_ns, busy_ms, period_ms: loads.append(busy_ms) or 1)
    run.run(threading.Event())
    assert len(loads) == (0 if compiles else 1)
    assert (run.status().age_ms is None) == compiles  # of seconds, in the p95 of the first ones
