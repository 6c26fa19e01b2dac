"""Real peers of a live run: an RTSP server, a sender of MPEG-TS, an autopilot; and a clip they send."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from flightdepth.flight.video import Video
from flightdepth.live.autopilot_feed import AutopilotFeed, AutopilotListener
from flightdepth.live.mavlink_link import MavlinkLink
from flightdepth.live.motion_store import MotionStore

SAMPLE = Path(__file__).parents[2] / "src" / "flightdepth" / "sample"
FOV_DEG = 75.0
RATE_HZ = 15  # half of the sample's: these tests share their machine
SYSTEM_PYTHON = Path("/usr/bin/python3")
SERVER = Path(__file__).with_name("rtsp_server.py")
PATIENCE_S = 20.0
NEEDS = 'import gi; gi.require_version("GstRtspServer", "1.0"); from gi.repository import GstRtspServer'


def free_port(kind=socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(condition, within_s=PATIENCE_S, what="it"):
    """Seconds until `condition()` holds, less those in which this process was not given the processor."""
    waited_s, looked = 0.0, time.monotonic()
    while not condition():
        assert waited_s < within_s, f"{what} never came about"
        time.sleep(0.01)
        now = time.monotonic()
        waited_s += min(now - looked, 0.05)
        looked = now
    return waited_s


def lasts_s(work):
    """Seconds that `work()` takes, less those in which this process was not given the processor."""
    thread = threading.Thread(target=work)
    thread.start()
    spent_s = until(lambda: not thread.is_alive())
    thread.join()
    return spent_s


def worst_wait_s(looks=40):
    """The longest that a sleep of 10 ms took: how real this machine's time is."""
    waits = []
    for _ in range(looks):
        began = time.monotonic()
        time.sleep(0.01)
        waits.append(time.monotonic() - began)
    return max(waits)


def skip_where_time_is_not_real():
    """What is tested is what happens within tenths of a second: not on a machine that stands still for as long."""
    if (waited_s := worst_wait_s()) > 0.1:
        pytest.skip(f"this machine is too busy for a test in real time: it slept {waited_s:.2f} s for 0.01")


def sample_pictures(size, count):
    with Video(SAMPLE / "flight.mp4", end_s=count / 30 - 0.01) as video:
        return [cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA) for frame in video.frames()]


def encode(path, size=(192, 108), seconds=20.0, key_every=8) -> Path:
    """The sample's first seconds, forth and back, as a camera's encoder would send them: no B frames."""
    forth = sample_pictures(size, 60)[:: 30 // RATE_HZ]
    there_and_back = forth + forth[-2:0:-1]
    with av.open(str(path), "w") as container:
        options = {"preset": "ultrafast", "tune": "zerolatency"}
        stream = container.add_stream("libx264", rate=RATE_HZ, options=options)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        stream.codec_context.gop_size = key_every
        for i in range(round(RATE_HZ * seconds)):
            image = there_and_back[i % len(there_and_back)]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


class RtspServer:
    """GStreamer's, in a process of its own; `kill` and `start` as often as wanted."""

    def __init__(self, clip, *options):
        check = [SYSTEM_PYTHON, "-W", "ignore", "-c", NEEDS]
        if not SYSTEM_PYTHON.exists() or subprocess.run(check, capture_output=True, check=False).returncode:
            pytest.skip("GStreamer's RTSP server is not installed (gir1.2-gst-rtsp-server-1.0, python3-gi)")
        self.port = free_port(socket.SOCK_STREAM)
        self.url = f"rtsp://127.0.0.1:{self.port}/flight"
        self._command = [str(SYSTEM_PYTHON), str(SERVER), str(clip), str(self.port), *options]

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *error):
        self.kill()

    def start(self):
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert self._process.stdout.readline() == b"ready\n"

    def kill(self):
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()


class Repeating:
    """A thread that does `step(i)` at `rate_hz` until the end."""

    rate_hz = float(RATE_HZ)

    def __enter__(self):
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._over.set()
        self._thread.join()

    def _work(self):
        began = time.monotonic()
        i = 0
        while not self._over.wait(max(0.0, began + i / self.rate_hz - time.monotonic())):
            self.step(i)
            i += 1


class TsSender(Repeating):
    """Pushes a clip as MPEG-TS over UDP, packet by packet, in real time."""

    def __init__(self, clip, port):
        self._container = av.open(str(clip))
        self._output = av.open(f"udp://127.0.0.1:{port}?pkt_size=1316", "w", format="mpegts")
        source = self._container.streams.video[0]
        self._stream = self._output.add_stream_from_template(source)
        self._packets = [packet for packet in self._container.demux(source) if packet.size]

    def step(self, i):
        if i < len(self._packets):
            packet = self._packets[i]
            packet.stream = self._stream
            self._output.mux(packet)

    def __exit__(self, *error):
        super().__exit__(*error)
        self._output.close()
        self._container.close()


class Autopilot(Repeating):
    """Plays the sample's poses over MAVLink to `port`: heartbeats, velocity, body attitude; answers TIMESYNC.

    `boot_s` is its clock at the start; `link` is what it speaks over instead of UDP. `asked` holds the rates that it
    was asked for, by message number.
    """

    def __init__(self, port=None, boot_s=100.0, *, address=None, link=None):
        address = address or f"udpout:127.0.0.1:{port}"
        self.link = link or mavutil.mavlink_connection(address, source_system=7)
        self.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        self.asked, self.answers, self.heard = {}, 0, []
        self.silent = False
        self._zero_ns = time.monotonic_ns() - round(boot_s * 1e9)
        poses = np.loadtxt(SAMPLE / "poses.csv", delimiter=",", skiprows=1)
        self._velocities = np.gradient(poses[:, 1:4], poses[:, 0] * 1e-9, axis=0)

    def boot_ns(self):
        return time.monotonic_ns() - self._zero_ns

    def reboot(self):
        self._zero_ns = time.monotonic_ns()

    def send(self, message):
        self.link.write(message.pack(self.mav))

    def step(self, i):
        self._answer()
        if self.silent:
            return
        if i % RATE_HZ == 0:
            self.send(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
        boot_ms = self.boot_ns() // 10**6
        velocity = self._velocities[2 * i % 120]  # five seconds ahead, all the same way
        self.send(mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, 0, *velocity))
        self.send(mavlink.MAVLink_attitude_quaternion_message(boot_ms, 1, 0, 0, 0, 0, 0, 0))

    def _answer(self):
        while self.link.select(0) and (data := self.link.recv(4096)):
            for message in self.mav.parse_buffer(bytes(data)) or []:
                self.heard.append(message)
                if message.get_type() == "COMMAND_LONG" and message.command == 511:
                    self.asked[int(message.param1)] = message.param2
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    self.answers += 1
                    self.send(mavlink.MAVLink_timesync_message(self.boot_ns(), message.ts1))

    def __exit__(self, *error):
        super().__exit__(*error)
        self.link.close()


class Listening:
    """A link that feeds a store; `velocities` holds when each came, `errors` what was said of the link."""

    def __init__(self, address):
        self.store, self.errors = MotionStore(), []
        self.velocities, self.reboots = [], []
        self.feed = AutopilotFeed(self.store, AutopilotListener(self.velocities.append, self.reboots.append))
        self.link = MavlinkLink(address, self.feed, rate_hz=self.store.rate_hz, on_error=self.errors.append)

    def __enter__(self):
        self.link.start()
        return self

    def __exit__(self, *error):
        self.link.close()


def live_command(*arguments):
    """The command line as a process would be started."""
    return [
        sys.executable,
        "-c",
        "import sys; from flightdepth.cli import main; sys.exit(main())",
        "live",
        *arguments,
    ]
