"""The MAVLink link against pymavlink over real sockets."""

import socket
import threading
import time

import pytest
from live_peers import Autopilot, Listening, free_port, until
from pymavlink.dialects.v20 import common as mavlink

from flightdepth.errors import BadInput
from flightdepth.live import mavlink_link, tcp_transport
from flightdepth.live.mavlink_link import check_address, open_transport


def test_udp_rates_are_asked_for_and_timesync_goes_both_ways():
    port = free_port()
    with Listening(f"udpin:127.0.0.1:{port}") as ours, Autopilot(port) as autopilot:
        until(lambda: len(ours.velocities) > 10)
        until(lambda: autopilot.answers and {32, 31, 285} <= set(autopilot.asked))
        until(lambda: any(m.get_type() == "HEARTBEAT" for m in autopilot.heard))  # the first went to nobody
        autopilot.send(mavlink.MAVLink_timesync_message(0, 987654321))
        until(lambda: any(m.get_type() == "TIMESYNC" and m.ts1 == 987654321 for m in autopilot.heard))
        answer = next(m for m in autopilot.heard if m.get_type() == "TIMESYNC" and m.ts1 == 987654321)
        assert abs(answer.tc1 - time.monotonic_ns()) < 20e9
        now_ns = time.monotonic_ns()
        assert abs(now_ns - ours.feed.boot_ns(now_ns) - autopilot._zero_ns) < 500e6  # a busy machine's
    kinds = {message.get_type() for message in autopilot.heard}
    assert {"HEARTBEAT", "COMMAND_LONG", "TIMESYNC"} <= kinds
    assert {m.get_srcSystem() for m in autopilot.heard if m.get_type() == "COMMAND_LONG"} == {7}


def test_a_link_without_velocities_says_what_it_brings():
    port = free_port()
    address = f"udpin:127.0.0.1:{port}"
    with Listening(address) as ours, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        until(lambda: ours.link.instead() == f"nothing comes over {address}")
        sender.sendto(b"\x01" * 40, ("127.0.0.1", port))  # as from a serial port at another baud rate
        until(lambda: ours.link.counts["damaged messages"])
        assert ours.link.instead().startswith("no autopilot's heartbeat comes, but ")
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
        sender.sendto(heartbeat.pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=1)), ("127.0.0.1", port))
        until(lambda: ours.feed.vehicle)
        assert ours.link.instead().startswith("the autopilot of vehicle 7 tells none (")
    assert ours.link.instead() is None


@pytest.mark.parametrize(
    ("target", "answered"), [((), True), ((7, 191), True), ((7, 0), True), ((9, 0), False), ((7, 1), False)]
)
def test_a_timesync_question_is_answered_by_whom_it_is_for(target, answered):
    """Every one was, also those to other vehicles and to the autopilot: then the asker takes our clock for theirs."""
    port = free_port()
    with Listening(f"udpin:127.0.0.1:{port}") as ours, Autopilot(port) as autopilot:
        until(lambda: ours.velocities)  # by then it is known that the vehicle is number 7
        autopilot.send(AddressedTimesync(target, ts1=1))
        autopilot.send(mavlink.MAVLink_timesync_message(0, 2))  # as older ones ask: without a target
        until(lambda: any(m.get_type() == "TIMESYNC" and m.ts1 == 2 for m in autopilot.heard))
    assert answered == any(m.get_type() == "TIMESYNC" and m.ts1 == 1 for m in autopilot.heard)


def test_an_answer_to_somebody_elses_timesync_question_tells_nothing():
    """A camera that was powered up with us asks with nearly our time: its answers set the autopilot's clock."""
    port = free_port()
    with Listening(f"udpin:127.0.0.1:{port}") as ours, Autopilot(port) as autopilot:
        until(lambda: ours.velocities and autopilot.answers)
        for _ in range(20):
            wrong_ns = autopilot.boot_ns() - 400_000_000
            autopilot.send(mavlink.MAVLink_timesync_message(wrong_ns, time.monotonic_ns() - 1000))
        seen = len(ours.velocities)
        until(lambda: len(ours.velocities) > seen + 3)
        assert not ours.feed.counts["jumps of the autopilot's clock"]


class AddressedTimesync(mavlink.MAVLink_timesync_message):
    """A question with the bytes of target_system and target_component, as newer senders pack it."""

    def __init__(self, target, ts1):
        super().__init__(0, ts1)
        self._target = bytes(target)

    def pack(self, mav):
        return self._pack(mav, self.crc_extra, self.unpacker.pack(0, self.ts1) + self._target)


def test_a_tcp_peer_that_reads_nothing_is_found_out():
    """What waits in the connection is an old obstacle when it arrives."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        transport = open_transport(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        peer, _ = server.accept()
        with peer, pytest.raises(OSError):
            for _ in range(1000):
                transport.write(bytes(200))
        transport.close()


def test_each_message_has_the_next_number():
    """They were all sent as number 0, which a router that drops duplicates takes for one message."""
    port = free_port()
    with Listening(f"udpin:127.0.0.1:{port}") as ours, Autopilot(port) as autopilot:
        until(lambda: ours.velocities and len(autopilot.heard) > 3)
        ours.link.close()
        until(lambda: not autopilot.link.select(0))
    numbers = [message.get_seq() for message in autopilot.heard]
    assert numbers == [(numbers[0] + i) % 256 for i in range(len(numbers))]


def test_what_is_sent_arrives():
    port = free_port()
    with Listening(f"udpin:127.0.0.1:{port}") as ours, Autopilot(port) as autopilot:
        until(lambda: ours.velocities)
        message = mavlink.MAVLink_statustext_message(6, b"obstacle")
        ours.link.write(message.pack(mavlink.MAVLink(None, srcSystem=1)))
        until(lambda: any(m.get_type() == "STATUSTEXT" for m in autopilot.heard))


def test_without_a_connection_sending_is_counted_and_does_not_wait():
    ours = Listening(f"udpin:127.0.0.1:{free_port()}")
    ours.link.write(b"anything")
    assert ours.link.counts == {"messages not sent: no connection": 1}


def heartbeat_and_velocity():
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    messages = [
        mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3),
        mavlink.MAVLink_local_position_ned_message(1000, 0, 0, 0, 1, 2, 3),
    ]
    return b"".join(bytes(message.pack(mav)) for message in messages)


def test_tcp_is_connected_again_when_the_peer_restarts():
    def serve():
        server = socket.create_server(("127.0.0.1", port))
        connection, _ = server.accept()
        connection.sendall(b"noise" + heartbeat_and_velocity())
        time.sleep(0.3)
        connection.close()
        server.close()

    port = free_port(socket.SOCK_STREAM)
    with Listening(f"tcp:127.0.0.1:{port}") as ours:
        for n in (1, 2):
            peer = threading.Thread(target=serve)
            peer.start()
            peer.join(20)
            until(lambda n=n: ours.link.counts["damaged messages"] >= n)
    assert len(ours.velocities) >= 1
    # How a connection ends depends on what was under way.
    endings = ("closed", "refused", "reset", "broken pipe")
    assert any(ending in text.lower() for text in ours.errors for ending in endings), ours.errors


def test_tcp_is_connected_again_when_nothing_comes_any_more(monkeypatch):
    """A peer that goes without a word, as behind a lost radio, was listened to for ever."""
    monkeypatch.setattr(tcp_transport, "SILENT_S", 0.3, raising=False)
    with socket.create_server(("127.0.0.1", 0)) as server:
        with Listening(f"tcp:127.0.0.1:{server.getsockname()[1]}") as ours:
            first, _ = server.accept()
            first.sendall(heartbeat_and_velocity())
            until(lambda: ours.velocities)
            server.settimeout(20)
            second, _ = server.accept()
        first.close()
        second.close()
    assert "nothing came for 0.3 s" in ours.errors[0]


def test_a_tcp_host_that_does_not_answer_is_told(monkeypatch):
    """Nothing was said of it for two minutes. A full backlog answers nobody."""
    monkeypatch.setattr(tcp_transport, "OPEN_S", 0.3, raising=False)
    with socket.create_server(("127.0.0.1", 0), backlog=0) as server:
        waiting = [socket.socket() for _ in range(4)]
        for each in waiting:
            each.setblocking(False)
            each.connect_ex(server.getsockname())
        with Listening(f"tcp:127.0.0.1:{server.getsockname()[1]}") as ours:
            until(lambda: ours.errors)
        for each in waiting:
            each.close()
    assert "timed out" in ours.errors[0]


def test_a_port_that_cannot_be_is_refused_before_it_is_opened():
    """It was tried for ever: OverflowError."""
    with pytest.raises(
        BadInput, match=r"--mavlink: expected a port up to 65535, got 'udpin:0\.0\.0\.0:99999'"
    ):
        check_address("udpin:0.0.0.0:99999")


@pytest.mark.parametrize("address", ["", "14550", "udp:0.0.0.0", "http://x:1", "udpin:0.0.0.0:x", "/tmp/x"])
def test_an_address_that_is_none_is_refused_with_examples(address):
    with pytest.raises(BadInput, match="udpin:HOST:PORT"):
        check_address(address)


@pytest.mark.parametrize(
    ("address", "found"),
    [
        ("udpin:0.0.0.0:14550", ("udpin:0.0.0.0:14550", None)),
        ("serial:/dev/ttyAMA0:921600", ("/dev/ttyAMA0", 921600)),
        ("serial:COM3:57600", ("COM3", 57600)),
        ("com12", ("com12", None)),
        ("/dev/cu.usbmodem01", ("/dev/cu.usbmodem01", None)),
        ("/dev/ttyACM0", ("/dev/ttyACM0", None)),
    ],
)
def test_addresses(address, found):
    assert check_address(address) == found


@pytest.mark.parametrize(("fd", "longest_s"), [(None, 0.005), (7, 0.05)])
def test_a_port_that_cannot_be_waited_for_is_looked_at_often(monkeypatch, fd, longest_s):
    """In place of waiting for a serial port of Windows pymavlink sleeps: telemetry was stamped up to 50 ms late."""
    waits = []

    class Port:
        def select(self, timeout_s):
            waits.append(timeout_s)
            time.sleep(0.001)
            return True

        def recv(self, most):
            return b""

        def write(self, data):
            pass

        def close(self):
            pass

    port = Port()
    port.fd = fd
    monkeypatch.setattr(mavlink_link, "open_transport", lambda address: port)
    with Listening("serial:COM3:57600"):
        until(lambda: len(waits) > 2)
    assert set(waits) == {longest_s}
