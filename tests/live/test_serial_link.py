"""The MAVLink link on a serial port: pseudo terminals, with pymavlink at the other end of the cable."""

import os
import select
import termios
import time
import tty
from pathlib import Path

import pytest
from live_peers import Autopilot, Listening, until
from pymavlink.dialects.v20 import common as mavlink

pytest.importorskip("serial")
SHM = Path("/dev/shm")  # a port's name must stand in /dev, and here anyone may put one
pytestmark = pytest.mark.skipif(not os.access(SHM, os.W_OK), reason="no place for a port's name")


class Cable:
    """A pseudo terminal whose near end is called `port`; at the far end reads and writes as pymavlink's links do."""

    def __init__(self, port):
        self._far, near = os.openpty()
        tty.setraw(near)
        port.unlink(missing_ok=True)
        port.symlink_to(os.ttyname(near))
        self._port = port
        os.close(near)
        os.set_blocking(self._far, False)

    def select(self, timeout_s):
        return bool(select.select([self._far], [], [], timeout_s)[0])

    def recv(self, most):
        try:
            return os.read(self._far, most)
        except OSError:  # nobody has opened the other end
            return b""

    def write(self, data):
        return os.write(self._far, data)

    def speed(self):
        return termios.tcgetattr(self._far)[5]

    def close(self):
        """Pull it: the port is gone."""
        self._port.unlink()
        os.close(self._far)


@pytest.fixture
def port():
    path = SHM / f"flightdepth-{os.getpid()}-{time.monotonic_ns()}"
    yield path
    path.unlink(missing_ok=True)


def test_telemetry_comes_and_rates_and_distances_go_out(port):
    cable = Cable(port)
    with Listening(f"serial:{port}:57600") as ours, Autopilot(link=cable) as autopilot:
        until(
            lambda: len(ours.velocities) > 5 and ours.store.at(time.monotonic_ns()).velocity_ned is not None
        )
        until(lambda: {32, 31, 285} <= set(autopilot.asked) and autopilot.answers)
        distances = [4001] * 70 + [65535, 250]
        message = mavlink.MAVLink_obstacle_distance_message(1, 0, distances, 5, 100, 4000, 0, 0, 12)
        ours.link.write(message.pack(mavlink.MAVLink(None, srcSystem=1)))
        until(lambda: any(m.get_type() == "OBSTACLE_DISTANCE" for m in autopilot.heard))
        assert cable.speed() == termios.B57600
        assert not ours.errors and not ours.link.counts
    heard = next(m for m in autopilot.heard if m.get_type() == "OBSTACLE_DISTANCE")
    assert heard.distances == distances
    assert autopilot.asked[32] == pytest.approx(1e6 / 30, rel=1e-6)


def test_a_pulled_cable_is_told_and_the_port_is_opened_again(port):
    with Listening(f"serial:{port}:57600") as ours:
        with Autopilot(link=Cable(port)):
            until(lambda: ours.velocities)
            ours.errors.clear()
        assert until(lambda: ours.errors and ours.link._transport is None) < 2
        ours.link.write(b"anything")
        assert ours.link.counts["messages not sent: no connection"] == 1
        until(lambda: len(ours.errors) >= 2)
        came = len(ours.velocities)
        with Autopilot(link=Cable(port), boot_s=101):
            until(lambda: len(ours.velocities) > came + 3)
    assert "read failed" in ours.errors[0] or "disconnected" in ours.errors[0]
    assert "No such file" in ours.errors[1]
    assert all(str(port) in error for error in ours.errors)


def test_a_port_that_takes_nothing_holds_nobody_up(port):
    """Without a write timeout the first full port would have stopped telemetry for good."""
    cable = Cable(port)
    with Listening(f"serial:{port}") as ours:
        until(lambda: ours.link._transport is not None)
        data = mavlink.MAVLink_statustext_message(6, b"x" * 50).pack(mavlink.MAVLink(None, srcSystem=1))
        for _ in range(5000):
            ours.link.write(data)
            if ours.link.counts:
                break
        assert set(ours.link.counts) <= {
            "messages not sent: the connection takes none",
            "messages not sent: the link is busy",
        }
        assert ours.link.counts
        with Autopilot(link=cable):  # it reads again
            until(lambda: ours.velocities)


@pytest.mark.parametrize("name", ["/dev/there-is-none", "/dev/null"])
def test_what_is_no_serial_port_is_told_and_tried_again(name):
    with Listening(f"serial:{name}:57600") as ours:
        until(lambda: len(ours.errors) >= 2)
    assert all(name in error and "\n" not in error for error in ours.errors)
