"""Faults that need a machine of their own to show: a slow estimator, lost packets, Ctrl-C, no camera at all."""

import signal
import subprocess
import threading
import time
from collections import Counter
from contextlib import closing
from itertools import islice

import av
import numpy as np
import pytest
from live_peers import SAMPLE, RtspServer, encode, free_port, live_command, until
from live_runs import running

from flightdepth.flight.decoding import BUILT_ON_DAMAGE
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.live.picture_clock import PictureClock
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import NOT_TAKEN
from flightdepth.live.video_stream import VideoStream
from flightdepth.runtimes.network import load_network


@pytest.fixture
def network(save_difference_network):
    return load_network(save_difference_network(), device="cpu", threads=1)


class Slowed:
    """A network that takes its time: 60 ms for each pair."""

    def __init__(self, network):
        self._network = network

    def __getattr__(self, name):
        return getattr(self._network, name)

    def predict(self, previous_n, *arguments):
        time.sleep(0.06 * len(previous_n))
        return self._network.predict(previous_n, *arguments)


@pytest.mark.slow
def test_a_slow_estimator_gives_up_ranges_and_drops_pictures_but_does_not_fall_behind(network, tmp_path):
    clip = encode(tmp_path / "flight.mp4", seconds=12)
    log = read_telemetry(SAMPLE / "telemetry.csv")
    with running(Slowed(network), str(clip), telemetry=log, ranges=4) as run:
        until(lambda: run.engine.status().ranges == 1)
        until(lambda: run.engine.status().frames.dropped.get(NOT_TAKEN, 0) > 5)
        status = run.engine.status()
    assert status.age_ms < 1500  # it would be many seconds if pictures queued
    assert status.frames.used < status.frames.received


def stopped(process):
    """What a process says after Ctrl-C, and its exit code."""
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    return out, err, process.returncode


def test_ctrl_c_ends_a_run_that_finds_no_camera(save_difference_network):
    arguments = ["--video", f"rtsp://127.0.0.1:{free_port()}/none", "--hfov", "80", "--network"]
    command = live_command(
        *arguments, str(save_difference_network()), "--mavlink", f"udpin:127.0.0.1:{free_port()}"
    )
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert any("LOST" in process.stdout.readline() for _ in range(3))  # behind what runs, and its camera
        out, err, code = stopped(process)
    assert code == 0
    assert "0 of 0 pictures used" in out
    assert "Connection refused" in err
    assert "Traceback" not in err


def grey(picture):
    return picture.to_ndarray(format="gray")[::4, ::4].astype(np.int16)


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.01, 0.03])
def test_lost_packets_give_fewer_pictures_and_no_damaged_ones(tmp_path, loss):
    """A decoder fills what was lost with guesses, and hardly ever says so: each picture is compared with those sent."""
    clip, counts, stop = (
        encode(tmp_path / "flight.mp4", size=(320, 180), seconds=30),
        Counter(),
        threading.Event(),
    )
    with av.open(str(clip)) as container:
        sent = np.array([grey(picture) for picture in container.decode(video=0)])
    with RtspServer(clip, "--loss", str(loss)) as server:
        address = video_address(server.url.replace("rtsp", "rtsp+udp"))
        with closing(VideoStream(address, counts)) as stream:
            pictures = islice(stream.pictures(PictureClock(0), stop), 60)
            off = [np.abs(sent - grey(picture.decoded)).mean(axis=(1, 2)).min() for picture in pictures]
    assert max(off) < 3  # grey levels; a picture with a lost slice is off by more
    assert counts["gaps in the RTP packets"] > 5
    assert counts[BUILT_ON_DAMAGE] > 5


def test_a_session_without_a_single_picture_could_not_run(save_difference_network, tmp_path):
    """What starts it again when it fails, a service say, is told."""
    save_difference_network()
    options = ["--hfov", "80", "--network", str(tmp_path / "difference.onnx"), "--duration", "1"]
    nobody = [f"rtsp://127.0.0.1:{free_port()}/main", "--mavlink", f"udpin:127.0.0.1:{free_port()}"]
    ran = subprocess.run(
        live_command("--video", *nobody, *options), capture_output=True, text=True, timeout=60, check=False
    )
    assert ran.returncode == 3
    assert "no picture came" in ran.stderr.splitlines()[-1]
