"""When a picture was taken, on the live clock: by the sender's word where it can be believed, else by arrival.

Senders' words: a V4L2 driver stamps a picture that begins to come in, with this machine's monotonic clock; an RTP
sender's RTCP reports tie its stream to its wall clock (FFmpeg hands them on as "producer reference time"), which
means something here only where both machines' clocks are set by NTP or PTP, so it has to be asked for.
"""

from __future__ import annotations

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.clock import RemoteClock
from flightdepth.live.status import AgeFrom

# A sender's word for when a picture was taken is believed if it makes it at most so old, or so far ahead.
OLDEST_NS, AHEAD_NS = 2 * NS_PER_S, NS_PER_S // 100
# The stream's and the sender's clock drift apart by less, within one connection; more is a clock that was set.
SET_NS = NS_PER_S // 10
# Packets come in the order of decoding, so their times step back by some pictures; by more where it was set.
BACK_NS = NS_PER_S // 2
HELD = 64  # packets: a decoder holds the pictures of fewer
NO_REPORT = "no report of the sender's clock has come"
EARLY = "by it pictures came before they were taken"


class PictureClock:
    """Stamps of one connection's pictures; `delay_ns`, exposure to sending, is taken off all but an RTCP report's.

    `wall_from_sender`: believe the wall clock of RTCP reports. `same_clock`: the stream's times are already
    those of our monotonic clock, if they look like it.

    A decoder may hold a picture back until the next packets come. What these say of the clock, which may be wrong once,
    is of later pictures: each is stamped as the clock stood when its own packet came.

    `distrusted`: why the wall clock asked for is not believed now; None where it is, or nobody asked for one.
    """

    def __init__(self, delay_ns: int, *, wall_from_sender: bool = False, same_clock: bool = False) -> None:
        self.distrusted = NO_REPORT if wall_from_sender else None
        self._delay_ns = delay_ns
        self._wall_from_sender, self._same_clock = wall_from_sender, same_clock
        self._arrivals = RemoteClock()
        self._newest_ns = 0  # of the stream's times
        self._sender_offset_ns: int | None = None
        self._was_set = False
        self._stamps: dict[int, tuple[int, AgeFrom]] = {}  # of the newest packets, by the stream's time

    def packet(
        self,
        own_ns: int,
        now_ns: int,
        *,
        sender_wall_ns: int | None = None,
        wall_now_ns: int = 0,
        queued: bool = False,
    ) -> None:
        """A packet of the stream's time `own_ns` came; the sender's wall clock for it, and ours now.

        `queued`: it may have come earlier, and lain in a queue of ours.
        """
        # A camera of this machine sends in the order of display: one time too late would hold for ten seconds.
        if own_ns < self._newest_ns - (0 if self._same_clock else BACK_NS):
            self._arrivals, self._newest_ns = RemoteClock(), own_ns
            self._sender_offset_ns = None  # it is known anew at once, unless the times were set
            if self._wall_from_sender and not self._was_set:
                self.distrusted = NO_REPORT
        self._newest_ns = max(self._newest_ns, own_ns)
        self._arrivals.arrived(own_ns, now_ns, queued=queued)
        if self._same_clock and _credible(own_ns, now_ns):
            self._sender_offset_ns = 0
        elif self._wall_from_sender and sender_wall_ns is not None and not self._was_set:
            self._compare(own_ns, now_ns, now_ns + sender_wall_ns - wall_now_ns)
        self._stamps.pop(own_ns, None)
        self._stamps[own_ns] = self._stamp(own_ns)
        if len(self._stamps) > HELD:
            del self._stamps[next(iter(self._stamps))]

    def late_ns(self, own_ns: int, now_ns: int) -> int:
        """How much later than the fastest ones a packet of the stream's time `own_ns` is, read at `now_ns`."""
        return now_ns - self._arrivals.live_ns(own_ns)

    def stamp(self, own_ns: int) -> tuple[int, AgeFrom]:
        """When the picture of the stream's time `own_ns` was taken; a packet must have come before."""
        return self._stamps.get(own_ns) or self._stamp(own_ns)

    def _stamp(self, own_ns: int) -> tuple[int, AgeFrom]:
        """By what is known now.

        The sender is not believed where it says so from the future: its clock, or one stamp of it, is wrong.
        """
        came_ns = self._arrivals.live_ns(own_ns)
        if self._sender_offset_ns is not None:
            claimed_ns = own_ns + self._sender_offset_ns
            if claimed_ns <= came_ns + AHEAD_NS:
                delay_ns = self._delay_ns if self._same_clock else 0  # a driver knows nothing of the exposure
                return claimed_ns - delay_ns, "sender"
            if self._wall_from_sender:
                self.distrusted = EARLY
        return came_ns - self._delay_ns, "reception"

    def _compare(self, own_ns: int, now_ns: int, claimed_ns: int) -> None:
        offset_ns = claimed_ns - own_ns
        before_ns = self._sender_offset_ns
        if before_ns is not None and abs(offset_ns - before_ns) > SET_NS:
            self.distrusted = f"a wall clock was set by {(offset_ns - before_ns) / NS_PER_S:.1f} s"
            self._sender_offset_ns, self._was_set = None, True
        elif _credible(claimed_ns, now_ns):
            self._sender_offset_ns, self.distrusted = offset_ns, None
        elif self.distrusted == NO_REPORT:
            age_s = (now_ns - claimed_ns) / NS_PER_S
            self.distrusted = f"by the wall clocks pictures come {age_s:.2f} s after they were taken"


def _credible(claimed_ns: int, now_ns: int) -> bool:
    return -AHEAD_NS <= now_ns - claimed_ns <= OLDEST_NS
