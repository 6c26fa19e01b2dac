"""What --camera and --hfov of `flightdepth live` mean for pictures of each size, and what turns say of them."""

import sys
import threading
import time
from collections import deque
from dataclasses import replace
from math import inf
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live_peers import SAMPLE, until

from flightdepth.errors import BadInput
from flightdepth.flight import BodyAttitudeSample, Telemetry, VelocitySample
from flightdepth.flight.lenses import find_lens
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.video import Video
from flightdepth.live import lens_watch
from flightdepth.live.depth_stage import DepthStage, Lens
from flightdepth.live.engine import LiveEngine, Parts
from flightdepth.live.health import LENS, Limits
from flightdepth.live.lens_watch import LensWatch
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.status import State
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.runtimes.network import load_network

sys.path.append(str(Path(__file__).parents[1] / "flight"))
from turning_videos import looking, simulated, write_video

NAME = "gopro-hero11-linear"
HOUR_NS = 3600 * NS_PER_S
# A clip played at any speed is no trouble: how long each may last is tested in test_health.py.
ANY_SPEED = Limits(
    silent_ns=HOUR_NS, stuck_ns=HOUR_NS, late_ns=HOUR_NS, no_depth_ns=HOUR_NS, old_ms=inf, slow_hz=0.0
)


def test_a_name_of_the_table_is_that_lens():
    assert Lens.given(Path(NAME), None).at(1920, 1080) == find_lens(NAME).seen(1920, 1080)


def test_a_field_of_view_holds_for_any_size():
    lens = Lens.given(None, 80.0)
    assert {round(lens.at(*size).horizontal_fov_deg, 6) for size in [(640, 480), (1280, 720)]} == {80.0}


@pytest.mark.parametrize(
    ("given", "hfov_deg", "told"),
    [
        (Path(NAME), None, f"{NAME} in the table of lenses: "),
        (SAMPLE / "camera.json", None, "calibration camera.json"),
        (None, 80.0, "--hfov 80, an ideal lens"),
    ],
)
def test_where_a_camera_comes_from_is_told(given, hfov_deg, told):
    assert Lens.given(given, hfov_deg).source.startswith(told)


def test_a_name_that_no_one_knows_is_refused():
    with pytest.raises(BadInput, match="gopro-hero11"):
        Lens.given(Path("gopro-hero11-liner"), None)


@pytest.mark.parametrize("given", [(None, None), (Path(NAME), 80.0)])
def test_one_of_the_two_is_needed(given):
    with pytest.raises(BadInput, match="one of them"):
        Lens.given(*given)


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A clip of a far landscape through a camera that is screwed to a turning drone, its log, and the camera."""
    case = simulated.Case(simulated.PINHOLE.resized(192, 108), lasts_s=16.0, turn_deg=15.0)
    turned, path = (
        simulated.angles(case, np.random.default_rng(8)),
        tmp_path_factory.mktemp("turns") / "v.mp4",
    )
    write_video(path, case.camera, lambda at_s: looking(case, turned, at_s), lasts_s=16)
    samples, bodies = [], []
    for stamp_ns in range(0, 16 * 10**9, 10**9 // 20):
        body = looking(case, turned, stamp_ns / 1e9) @ NED_FROM_CAMERA.T
        samples.append(VelocitySample(stamp_ns, [1.0 + stamp_ns % 7 * 1e-3, 0, 0]))
        bodies.append(BodyAttitudeSample(stamp_ns, quaternion_from_rotation(body)))
    return path, Telemetry("turns", tuple(samples), body_attitudes=tuple(bodies)), case.camera


class InStep:
    """A clip and its log, for an engine, each picture when every sink has taken the result of the one before.

    In real time a busy machine leaves pictures out, and what the first turns tell depends on which. Stands for the
    engine's video input, for its slot and for its telemetry.
    """

    error = instead = distrusted = None
    received = reconnects = 0

    def __init__(self, clip, log, store):
        self.slot, self.ended, self.dropped = self, threading.Event(), {}
        self._store, self._epoch_ns, self._pictures = store, time.monotonic_ns(), self._played(clip)
        samples = (*log.samples, *log.body_attitudes)
        self._log = deque(sorted(samples, key=lambda sample: sample.stamp_ns))

    def video(self, listener):
        self._listener = listener
        return self

    def motion(self, engine):
        self._engine = engine
        return self

    def start(self):
        pass

    def close(self):
        pass

    def take(self, timeout_s):
        until(self._taken)
        return next(self._pictures, None)

    def _taken(self):
        status = self._engine.status()
        return all(sink.taken == status.frames.used for sink in status.sinks.values())

    def _played(self, clip):
        with Video(clip) as video:
            for frame in video.frames():
                self._tell_motion(frame.stamp_ns)
                self.received += 1
                self._listener.on_picture(time.monotonic_ns())
                yield SimpleNamespace(
                    stamp_ns=self._epoch_ns + frame.stamp_ns,
                    age_from="reception",
                    rgb=lambda image=frame.image: image,
                )
        self.ended.set()

    def _tell_motion(self, until_ns):
        while self._log and self._log[0].stamp_ns <= until_ns:
            sample, now_ns = self._log.popleft(), time.monotonic_ns()
            self._store.add(replace(sample, stamp_ns=self._epoch_ns + sample.stamp_ns), now_ns)
            self._engine.on_velocity(now_ns)


@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_live_a_lens_that_its_turns_deny_is_told_while_flying(
    turning, factor, save_difference_network, monkeypatch
):
    for name in ("ENOUGH", "LEAST_NEW"):
        monkeypatch.setattr(lens_watch, name, 25)  # else it would take half a minute
    clip, log, camera = turning
    given = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
    network = load_network(save_difference_network(), device="cpu", threads=1)
    store, told = MotionStore(NED_FROM_CAMERA), []
    played = InStep(clip, log, store)
    parts = Parts(
        stage=DepthStage(network, Lens(given), store, ranges=1, fixed=True),
        store=store,
        video=played.video,
        motion=played.motion,
        lens=LensWatch(store),
    )
    engine, judged = LiveEngine(parts), threading.Event()
    engine._monitor._limits = ANY_SPEED

    def note(result):
        told.append(result.status)
        if result.status.lens is not None:
            judged.set()

    engine.add_sink("test", note)
    with engine:
        engine.run(judged)
    verdict = told[-1].lens
    assert verdict.agrees == (factor == 1.0), str(verdict)
    if factor != 1.0:
        assert verdict.found.camera.fx * 192 / 160 == pytest.approx(camera.fx, rel=0.05)
        assert told[-1].health.kind == (State.DEGRADED, LENS)
