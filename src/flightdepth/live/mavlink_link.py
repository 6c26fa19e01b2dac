"""The MAVLink connection: UDP, TCP or serial through pymavlink, on a thread of its own, opened again when lost."""

from __future__ import annotations

import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

from flightdepth.errors import BadInput, MissingExtra
from flightdepth.flight.records import NS_PER_S
from flightdepth.live.autopilot_feed import AutopilotFeed
from flightdepth.live.tcp_transport import TcpTransport
from flightdepth.live.video_input import pause_s

EXPECTED = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:/dev/DEVICE[:BAUD] or serial:COM3[:BAUD]"
LAST_PORT = 65_535
NETWORK = re.compile(r"(udpin|udpout|tcp):([^:]+):(\d+)")
SERIAL = re.compile(r"(?:serial:)?(/dev/[^:]+|(?i:COM)[1-9]\d*)(?::(\d+))?")  # COM3: Windows' ports
DEFAULT_BAUD = 921600
MAVLINK_2 = 0xFD  # a packet's first byte
# Who we are: MAV_COMP_ID_ONBOARD_COMPUTER, in the vehicle's own system.
COMPONENT = 191
SELECT_S, LOCK_S, WRITE_S = 0.05, 0.05, 0.05
POLL_S = 0.005  # of a serial port on Windows, which cannot be waited for: pymavlink sleeps
SILENT_S = 10  # after which a UDP peer that came to us hears no more from us
HEARTBEAT_NS = TIMESYNC_NS = NS_PER_S
QUESTIONS_KEPT = 4  # of TIMESYNC: an answer later than a second tells nothing
ASK_AGAIN_NS = 5 * NS_PER_S
# Rates asked for, Hz; a link that gives half of the velocities is left in peace.
RATES_HZ = {
    "LOCAL_POSITION_NED": 30,
    "ATTITUDE_QUATERNION": 50,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 30,
    "DISTANCE_SENSOR": 10,
}
# Asked for too where the first request did not help.
INSTEAD = {"ODOMETRY": 30, "GLOBAL_POSITION_INT": 30}

Message = Any


def open_transport(address: str) -> Any:
    """A connection, used for its bytes only: pymavlink's for UDP and serial ports."""
    network = NETWORK.fullmatch(address)
    if network is not None and network[1] == "tcp":
        return TcpTransport(network[2], int(network[3]))
    try:
        from pymavlink import mavutil
    except ModuleNotFoundError as error:
        raise MissingExtra("a MAVLink connection", "live") from error
    if network is not None:
        return mavutil.mavlink_connection(address, udp_timeout=SILENT_S)
    device, baud = check_address(address)
    try:
        transport = mavutil.mavlink_connection(device, baud=baud or DEFAULT_BAUD)
    except ModuleNotFoundError as error:
        raise MissingExtra("a serial MAVLink connection (pyserial)", "live") from error
    # pymavlink would wait for ever where a peer takes nothing, print that the port is dead, and raise nothing.
    transport.port.write_timeout = WRITE_S
    transport.write = transport.port.write
    return transport


def check_address(address: str) -> tuple[str, int | None]:
    """Device and baud of a serial address, or the address itself; what is neither is refused."""
    network = NETWORK.fullmatch(address)
    if network is not None and int(network[3]) <= LAST_PORT:
        return address, None
    serial = SERIAL.fullmatch(address)
    if serial is None:
        expected = EXPECTED if network is None else f"a port up to {LAST_PORT}"
        raise BadInput("--mavlink", expected=expected, got=repr(address))
    return serial[1], int(serial[2]) if serial[2] else None


class MavlinkLink:
    """Feeds `feed` from `start` to `close`, and sends: heartbeats, rate requests, TIMESYNC, what `write` is given.

    `on_error` hears why the connection was lost. `rate_hz` tells how many velocities come a second.
    """

    def __init__(
        self,
        address: str,
        feed: AutopilotFeed,
        *,
        rate_hz: Callable[[int], float],
        on_error: Callable[[str], None],
    ) -> None:
        check_address(address)
        try:
            from pymavlink.dialects.v20 import common as mavlink
        except ModuleNotFoundError as error:
            raise MissingExtra("a MAVLink connection", "live") from error
        self.counts: Counter[str] = Counter()
        self._address, self._feed, self._rate_hz, self._on_error = address, feed, rate_hz, on_error
        self._dialect = mavlink
        self._mav = mavlink.MAVLink(self, srcSystem=1, srcComponent=COMPONENT)
        self._mav.robust_parsing = True
        self._writing = threading.Lock()
        self._transport: Any = None
        self._due = dict.fromkeys(("heartbeat", "timesync", "rates"), 0)
        self._asked = 0
        self._came_ns = -NS_PER_S  # when the last bytes did
        self._questions: deque[int] = deque(maxlen=QUESTIONS_KEPT)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="mavlink", daemon=True)

    def start(self) -> None:
        """Connect and listen."""
        self._thread.start()

    def close(self) -> None:
        """Stop, and free the port."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def instead(self) -> str | None:
        """What comes in place of velocities, for those who miss them; None while there is no connection."""
        now_ns = time.monotonic_ns()
        if self._transport is None:
            return None
        if now_ns - self._came_ns > NS_PER_S:
            return f"nothing comes over {self._address}"
        damaged = self.counts["damaged messages"] if self._feed.vehicle is None else 0
        return self._feed.instead(now_ns) + (f", but {damaged} damaged messages" if damaged else "")

    def write(self, data: bytes) -> None:
        """Send a packed message, of any component; never waits long, and counts what did not go out."""
        if not self._writing.acquire(timeout=LOCK_S):
            self.counts["messages not sent: the link is busy"] += 1
            return
        try:
            if self._transport is None:
                self.counts["messages not sent: no connection"] += 1
            else:
                self._transport.write(data)
        except OSError:
            self.counts["messages not sent: the connection takes none"] += 1
        finally:
            self._writing.release()

    def _work(self) -> None:
        failures = 0
        while not self._stop.is_set():
            try:
                self._transport = open_transport(self._address)
                failures = 0
                self._listen()
            except Exception as error:
                # A driver's or a parser's, of any kind: without this thread all is lost.
                self._on_error(f"MAVLink {self._address}: {_in_words(error)}")
                failures += 1
            finally:
                self._hang_up()
            self._stop.wait(pause_s(failures))

    def _listen(self) -> None:
        wait_s = POLL_S if getattr(self._transport, "fd", True) is None else SELECT_S
        while not self._stop.is_set():
            ready = self._transport.select(wait_s)
            data = self._transport.recv(4096) if ready else b""
            now_ns = time.monotonic_ns()
            self._came_ns = now_ns if data else self._came_ns
            for message in self._mav.parse_buffer(bytes(data)) or [] if data else []:
                self._take(message, now_ns)
            self._keep_up(now_ns)

    def _hang_up(self) -> None:
        with self._writing:
            if self._transport is not None:
                self._transport.close()
            self._transport = None

    def _take(self, message: Message, now_ns: int) -> None:
        name = message.get_type()
        if name == "BAD_DATA":
            self.counts["damaged messages"] += 1
        elif name == "TIMESYNC":
            self._take_timesync(message, now_ns)
        else:
            self._feed.take(message, now_ns)

    def _take_timesync(self, message: Message, now_ns: int) -> None:
        """Answer a question that is for us or for all; of the answers, those to our own questions count."""
        if message.tc1 != 0:
            if message.ts1 in self._questions:
                self._feed.take(message, now_ns)
            return
        system, component = timesync_target(message.get_msgbuf())
        if system in (0, self._mav.srcSystem) and component in (0, COMPONENT):
            self._mav.timesync_send(tc1=now_ns, ts1=message.ts1)

    def _keep_up(self, now_ns: int) -> None:
        """What is due: a heartbeat, a TIMESYNC question, requests for rates that are too low."""
        if self._is_due("heartbeat", now_ns, HEARTBEAT_NS):
            kind, nobody = self._dialect.MAV_TYPE_ONBOARD_CONTROLLER, self._dialect.MAV_AUTOPILOT_INVALID
            active = self._dialect.MAV_STATE_ACTIVE
            self._mav.heartbeat_send(kind, nobody, 0, 0, active)
        if self._feed.vehicle is None:
            return
        self._mav.srcSystem = self._feed.vehicle.system
        if self._is_due("timesync", now_ns, TIMESYNC_NS):
            self._questions.append(time.monotonic_ns())
            self._mav.timesync_send(tc1=0, ts1=self._questions[-1])
        slow = self._rate_hz(now_ns) < RATES_HZ["LOCAL_POSITION_NED"] / 2
        if slow and self._is_due("rates", now_ns, ASK_AGAIN_NS):
            self._ask_for_rates()

    def _is_due(self, what: str, now_ns: int, every_ns: int) -> bool:
        due = now_ns >= self._due[what]
        if due:
            self._due[what] = now_ns + every_ns
        return due

    def _ask_for_rates(self) -> None:
        vehicle = self._feed.vehicle
        assert vehicle is not None
        wanted = RATES_HZ if self._asked == 0 else RATES_HZ | INSTEAD
        self._asked += 1
        for name, rate_hz in wanted.items():
            number = getattr(self._dialect, f"MAVLINK_MSG_ID_{name}")
            command = self._dialect.MAV_CMD_SET_MESSAGE_INTERVAL
            nothing = (0,) * 5
            self._mav.command_long_send(
                vehicle.system, vehicle.component, command, 0, number, 1e6 / rate_hz, *nothing
            )


def timesync_target(packet: bytes) -> tuple[int, int]:
    """Whom a packed TIMESYNC is for, system and component, 0: all; read here, since pymavlink 2.4.50 does not know it.

    Two bytes behind tc1 and ts1, an extension of MAVLink 2: older senders have none, and zeros at the end are not sent.
    """
    if packet[0] != MAVLINK_2:
        return 0, 0
    target = bytes(packet[10 + 16 : 10 + packet[1]]).ljust(2, b"\0")
    return target[0], target[1]


def _in_words(error: Exception) -> str:
    """Why, short: of a port that is not there the system's words, and the kind of an error nobody expected."""
    if isinstance(error, OSError | MissingExtra):
        return str(getattr(error, "strerror", None) or error)
    return f"{type(error).__name__}: {error}"
