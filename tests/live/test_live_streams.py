"""The engine against real peers: RTSP, MPEG-TS, MAVLink; and what happens when each of them fails."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from live_peers import (
    FOV_DEG,
    RATE_HZ,
    SAMPLE,
    Autopilot,
    RtspServer,
    TsSender,
    encode,
    free_port,
    skip_where_time_is_not_real,
    until,
)
from live_runs import running

from flightdepth.camera import Camera
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.live.health import LATE, REBOOTED, SILENT
from flightdepth.live.status import State
from flightdepth.runtimes.network import load_network


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return encode(tmp_path_factory.mktemp("clip") / "flight.mp4")


@pytest.fixture(autouse=True)
def real_time(clip):
    skip_where_time_is_not_real()


@pytest.fixture
def network(save_difference_network):
    return load_network(save_difference_network(), device="cpu", threads=1)


def test_a_file_and_its_log_in_real_time(network, clip):
    log = read_telemetry(SAMPLE / "telemetry.csv")
    with running(network, str(clip), telemetry=log) as run:
        run.until(State.OK)
        until(lambda: run.results[-1].stamp_ns > run.epoch_ns + 2e9)
    result = next(r for r in run.results if r.stamp_ns > run.epoch_ns + 2e9)
    assert result.camera == Camera.from_fov(192, 108, FOV_DEG)
    assert np.linalg.norm(result.motion.velocity_ned) == pytest.approx(5.7, abs=0.5)
    assert (result.depth.displacements_m > 0).all()
    stamps = [r.stamp_ns for r in run.results]
    assert stamps == sorted(set(stamps))
    steps = np.diff(stamps) / 1e9 * RATE_HZ
    np.testing.assert_allclose(steps, np.round(steps), atol=0.01)  # the file's own times


def test_rtsp_and_an_autopilot_and_the_server_killed_and_restarted(network, clip):
    port = free_port()
    with (
        RtspServer(clip) as server,
        Autopilot(port) as autopilot,
        running(network, server.url, port=port) as run,
    ):
        run.until(State.OK)
        until(lambda: autopilot.answers >= 2 and 32 in autopilot.asked)
        assert autopilot.asked[32] == pytest.approx(1e6 / 30, abs=1)  # LOCAL_POSITION_NED, microseconds
        result = run.results[-1]
        off_ns = (time.monotonic_ns() - result.stamp_ns) - (autopilot.boot_ns() - result.boot_ns)
        assert abs(off_ns) < 500e6
        assert result.motion.world_from_camera is not None
        server.kill()
        assert run.until(State.LOST, SILENT) < 2.0
        server.start()
        run.until(State.OK)
        assert run.engine.status().reconnects >= 1
        assert not any("127.0.0.1" in text for text in run.said if text.startswith("video"))


@pytest.mark.slow
def test_the_senders_clock_is_used_where_it_is_trusted(network, clip):
    port = free_port()
    with (
        RtspServer(clip) as server,
        Autopilot(port),
        running(network, server.url, port=port, sender_clock=True) as run,
    ):
        until(lambda: run.engine.status().age_from == "sender")  # after the first RTCP report
        assert 0 <= run.engine.status().age_ms < 2000


@pytest.mark.slow
def test_mpeg_ts_over_udp_and_another_size(network, clip, tmp_path):
    video, port = free_port(), free_port()
    other = encode(tmp_path / "other.mp4", size=(128, 96), seconds=10)
    with Autopilot(port), running(network, f"udp://127.0.0.1:{video}", port=port) as run:
        with TsSender(clip, video):
            run.until(State.OK)
        with TsSender(other, video):
            until(lambda: run.results[-1].camera.width == 128)
            run.until(State.OK)
    assert run.results[-1].depth.depth_m.shape == (96, 128)


@pytest.mark.slow
def test_telemetry_stops_and_the_autopilot_reboots(network, clip):
    port = free_port()
    with (
        Autopilot(port, boot_s=300.0) as autopilot,
        RtspServer(clip) as server,
        running(network, server.url, port=port) as run,
    ):
        run.until(State.OK)
        autopilot.silent = True
        assert run.until(State.DEGRADED, LATE) < 3.0
        until(lambda: run.results[-1].depth.reason is not None)
        time.sleep(1.0)
        autopilot.reboot()
        autopilot.silent = False
        run.until(State.DEGRADED, REBOOTED)
        run.until(State.OK)
        assert abs(run.results[-1].boot_ns) < 60e9


@pytest.mark.slow
def test_a_sink_that_fails_and_one_that_hangs_stop_nothing(network, clip):
    hold = threading.Event()

    def full_disk(result):
        raise OSError(28, "No space left on device")

    with running(network, str(clip), telemetry=read_telemetry(SAMPLE / "telemetry.csv")) as run:
        run.engine.add_sink("disk", full_disk)
        run.engine.add_sink("page", lambda result: hold.wait(60))
        run.until(State.OK)
        before = len(run.results)
        until(lambda: len(run.results) > before + 20)
        counts = run.engine.status().sinks
        hold.set()
    assert counts["disk"].failed > 5
    assert counts["page"].taken == 0
    assert counts["page"].missed > 5
    assert sum("disk failed" in text for text in run.said) == 1
