"""RTP to pictures: packets as the RFCs write them, FFmpeg as the sender, and packets lost, mixed and cut."""

import errno
import random
import socket
import struct
import threading
import time
from collections import Counter, deque
from contextlib import closing, contextmanager
from itertools import groupby, islice

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_peers import RATE_HZ, encode, free_port, until

from flightdepth.flight.decoding import BUILT_ON_DAMAGE
from flightdepth.live import rtp_stream
from flightdepth.live.picture_clock import PictureClock
from flightdepth.live.rtp import (
    LONGEST_HELD_NS,
    MAX_DROPOUT,
    MAX_MISORDER,
    START_CODE,
    Continuity,
    Reorder,
    RtpPacket,
    SenderReport,
    Units,
    begins,
    h264_parts,
    h265_parts,
)
from flightdepth.live.rtp_stream import RtpStream
from flightdepth.live.sound_decoder import SoundDecoder
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import VideoInput, VideoListener
from flightdepth.live.video_stream import BEHIND, StreamEnded

GAP = "gaps in the RTP packets"


def rtp(sequence=1, timestamp=0, *, marker=False, payload=b"\x41x", source=7, kind=96):
    return struct.pack(">BBHII", 0x80, kind | marker << 7, sequence, timestamp, source) + payload


@contextmanager
def bound(port):
    """A socket that hears what is sent to a port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", port))
        heard.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        heard.settimeout(0.3)
        yield heard


def drained(heard):
    """The datagrams that came."""
    datagrams = []
    try:
        while True:
            datagrams.append(heard.recv(65536))
    except TimeoutError:
        return datagrams


def as_sent(clip, port):
    """What FFmpeg sends of a clip as RTP, and its packets as they were encoded."""
    with bound(port) as heard:
        encoded = send(clip, port)
        return drained(heard), encoded


def send(clip, port, wait=lambda i: None):
    """Play a clip as RTP, with its parameter sets before each key frame; returns the pictures' bytes."""
    with (
        av.open(str(clip)) as container,
        av.open(f"rtp://127.0.0.1:{port}", "w", format="rtp") as output,
    ):
        source = container.streams.video[0]
        # Not by template: the muxer would take the packets for MP4's.
        stream = output.add_stream("libx264", rate=15)
        stream.width, stream.height, stream.pix_fmt = source.width, source.height, "yuv420p"
        plain = av.BitStreamFilterContext("h264_mp4toannexb", source)
        packets = [
            found for packet in container.demux(source) if packet.size for found in plain.filter(packet)
        ]
        for i, packet in enumerate(packets):
            wait(i)
            packet.stream = stream
            output.mux(packet)
    return [bytes(packet) for packet in packets]


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return encode(tmp_path_factory.mktemp("rtp") / "clip.mp4", size=(320, 180), seconds=3)


@pytest.fixture(scope="module")
def datagrams(clip):
    return as_sent(clip, free_port())[0]


def units_of(datagrams, *, step_ns=1_000_000):
    reorder, units, found = Reorder(), Units(), []
    for i, data in enumerate(datagrams):
        for packet, came_ns, lost in reorder.add(RtpPacket.parse(data), i * step_ns):
            found += units.add(packet, came_ns, lost=lost)
    return found


def test_a_header_with_all_that_may_stand_in_it():
    extended = struct.pack(
        ">BBHIIIHHI", 0xB1, 0xE0, 5, 9, 7, 11, 0xBEDE, 1, 0
    )  # one source, one word, padding
    packet = RtpPacket.parse(extended + b"body" + b"\x00\x00\x03")
    assert packet == RtpPacket(7, 96, 5, 9, True, b"body")


def test_trash_is_no_packet():
    rng = random.Random(3)
    whole = rtp(payload=b"\x7c\x85abc")
    assert all(RtpPacket.parse(whole[:n]) is None for n in range(13))
    for _ in range(2000):
        data = rng.randbytes(rng.randrange(40))
        packet = RtpPacket.parse(data)
        SenderReport.parse(data)
        if packet is not None:
            list(Units().add(packet, 0, lost=False))
            list(Units(h265=True).add(packet, 0, lost=False))


def test_h264_units_as_rfc_6184_packs_them():
    assert h264_parts(b"\x67sps") == [START_CODE, b"\x67sps"]
    assert h264_parts(b"\x78\x00\x02\x67a\x00\x03\x68bc") == [START_CODE, b"\x67a", START_CODE, b"\x68bc"]
    assert b"".join(h264_parts(b"\x7c\x85one") + h264_parts(b"\x7c\x45two")) == START_CODE + b"\x65onetwo"


def test_h265_units_as_rfc_7798_packs_them():
    assert h265_parts(b"\x40\x01vps") == [START_CODE, b"\x40\x01vps"]
    assert h265_parts(b"\x60\x01\x00\x03\x40\x01v") == [START_CODE, b"\x40\x01v"]
    # IDR_W_RADL is 19: a head of 0x26 0x01.
    assert b"".join(h265_parts(b"\x62\x01\x93one") + h265_parts(b"\x62\x01\x53two")) == (
        START_CODE + b"\x26\x01onetwo"
    )


def test_a_sender_report_tells_its_wall_clock():
    # 2024-01-01 00:00:00.5 UTC in NTP's seconds since 1900.
    data = struct.pack(">BBHIIIIII", 0x80, 200, 6, 7, 1_704_067_200 + 2_208_988_800, 1 << 31, 90, 0, 0)
    assert SenderReport.parse(data) == SenderReport(7, 1_704_067_200_500_000_000, 90)


def test_what_ffmpeg_sends_comes_out_as_it_was_encoded(clip):
    datagrams, encoded = as_sent(clip, free_port())
    units = units_of(datagrams)
    assert len(units) == len(encoded) == 45
    assert begins(units[0].data, h265=False)
    steps = np.diff([unit.ticks for unit in units])
    assert (steps == 6000).all()  # 15 a second
    for unit, packet in zip(units, encoded, strict=True):
        assert unit.data.replace(START_CODE, START_CODE[1:]) == packet.replace(START_CODE, START_CODE[1:])


def test_a_picture_is_given_with_its_last_packet(datagrams):
    assert len(datagrams) > 60
    reorder, units = Reorder(), Units()
    for data in datagrams:
        packet = RtpPacket.parse(data)
        given = [unit for due in reorder.add(packet, 0) for unit in units.add(due[0], due[1], lost=due[2])]
        assert len(given) == packet.marker


def test_mixed_up_packets_give_the_same_pictures(datagrams):
    mixed = list(datagrams)
    for i in range(0, len(mixed) - 4, 4):
        mixed[i : i + 4] = random.Random(i).sample(mixed[i : i + 4], 4)
    mixed.insert(0, mixed.pop(mixed.index(datagrams[0])))  # the first to come is where the count begins
    mixed.insert(30, mixed[28])  # and one comes twice
    assert [unit.data for unit in units_of(mixed)] == [unit.data for unit in units_of(datagrams)]


def test_sequence_numbers_and_times_wrap_around():
    packets = [rtp((65_530 + i) % 65_536, (2**32 - 9000 + 3000 * i) % 2**32, marker=True) for i in range(12)]
    assert [unit.ticks - 2**32 for unit in units_of(packets)] == [-9000 + 3000 * i for i in range(12)]


def test_a_lost_packet_spoils_its_picture_only(datagrams):
    whole = units_of(datagrams)
    for lost in range(20, 60, 7):
        units = units_of(datagrams[:lost] + datagrams[lost + 1 :])
        bad = [unit.ticks for unit in units if unit.data is None]
        assert 1 <= len(bad) <= 2
        assert RtpPacket.parse(datagrams[lost]).timestamp - bad[0] in (0, -6000)
        by_time = {unit.ticks: unit.data for unit in whole}
        assert all(unit.data == by_time[unit.ticks] for unit in units if unit.data is not None)


def test_a_missing_packet_is_not_waited_for_longer_than_said():
    reorder, came = Reorder(), []
    for i, now_ns in [(0, 0), (2, 1), (3, LONGEST_HELD_NS), (4, LONGEST_HELD_NS + 1)]:
        came += [(p.sequence, lost) for p, _, lost in reorder.add(RtpPacket.parse(rtp(10 + i, 0)), now_ns)]
    assert came == [(10, False), (12, True), (13, False), (14, False)]


def test_parameter_sets_of_their_own_belong_to_the_next_picture():
    found = units_of(
        [rtp(1, 0, marker=True, payload=b"\x67sps"), rtp(2, 3000, marker=True, payload=b"\x65i")]
    )
    assert [(unit.data, unit.ticks) for unit in found] == [
        (START_CODE + b"\x67sps" + START_CODE + b"\x65i", 3000)
    ]


def test_a_picture_that_never_ends_does_not_fill_the_memory(monkeypatch):
    """A sender without marker bits whose time stands still: 241 MB after 200,000 packets."""
    monkeypatch.setattr("flightdepth.live.rtp.MOST_BYTES", 10_000)
    units, part = Units(), b"\x41" + bytes(999)
    for i in range(100):
        assert not list(units.add(RtpPacket.parse(rtp(i, 0, payload=part)), i, lost=False))
    assert sum(map(len, units._parts)) <= 10_000
    closed = list(units.add(RtpPacket.parse(rtp(100, 0, marker=True, payload=part)), 100, lost=False))
    assert [unit.data for unit in closed] == [None]  # damaged
    closed = list(units.add(RtpPacket.parse(rtp(101, 3000, marker=True, payload=part)), 101, lost=False))
    assert [unit.data for unit in closed] == [START_CODE + part]


def pictures_of(datagrams, count, *, gone=()):
    """The pictures that RtpStream makes of datagrams that a socket sends, in order; `gone` are lost."""
    port, counts, stop = free_port(), Counter(), threading.Event()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        closing(RtpStream(f"rtp://127.0.0.1:{port}", counts)) as stream,
    ):

        def work():
            for i, data in enumerate(datagrams):
                if i not in gone:
                    sender.sendto(data, ("127.0.0.1", port))
                    time.sleep(0.0005)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            found = list(islice(stream.pictures(PictureClock(0), stop), count))
        finally:
            thread.join()
    return found, counts


def test_pictures_are_those_that_were_sent(clip, datagrams):
    with av.open(str(clip)) as container:
        sent = [picture.to_ndarray(format="rgb24") for picture in container.decode(video=0)]
    found, counts = pictures_of(datagrams, 45)
    for picture, right in zip(found, sent, strict=True):
        np.testing.assert_array_equal(picture.rgb(), right)
    assert not counts
    stamps = np.array([picture.stamp_ns for picture in found])
    assert (np.diff(stamps) > 0).all()


def test_after_a_lost_packet_no_picture_until_a_key_frame(datagrams):
    numbers = [RtpPacket.parse(data).timestamp for data in datagrams]
    third = 2 * 6000 + numbers[0]
    found, counts = pictures_of(datagrams, 20, gone={numbers.index(third)})
    at = np.array([picture.decoded.pts - numbers[0] for picture in found]) // 6000
    assert at.tolist() == [0, 1, *range(8, 26)]  # a key frame every eight
    assert counts[GAP] == 1
    assert counts[BUILT_ON_DAMAGE] >= 4


def test_silence_and_another_sender_end_a_connection():
    port, stop = free_port(), threading.Event()
    with closing(RtpStream(f"rtp://127.0.0.1:{port}", Counter())) as stream, pytest.raises(TimeoutError):
        next(stream.pictures(PictureClock(0), stop))
    counts = Counter()
    with closing(RtpStream(f"rtp://127.0.0.1:{port}", counts)) as stream:
        one, other = RtpPacket.parse(rtp(source=1)), RtpPacket.parse(rtp(source=2))
        assert stream._is_ours(one, 0)
        assert not stream._is_ours(other, 100_000_000)
        assert stream._is_ours(one, 200_000_000)
        with pytest.raises(StreamEnded):
            stream._is_ours(other, 800_000_000)
    assert counts == {"RTP packets of another sender": 1}


def instead_of_pictures(datagrams):
    """What a live input says that came, when these packets do."""
    port = free_port()
    video = VideoInput(video_address(f"rtp://127.0.0.1:{port}"), VideoListener(*[lambda told: None] * 3))
    with closing(video), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        video.start()

        def told():
            for data in datagrams:
                sender.sendto(data, ("127.0.0.1", port))
            return video.instead

        until(told)
        return video.instead, video.received


def test_why_no_picture_comes_though_packets_do_is_told(datagrams):
    """Nothing was: no picture has come yet, or nothing came in time."""
    numbered = [data[:1] + bytes([data[1] & 0x80 | 97]) + data[2:] for data in datagrams[:20]]
    what, received = instead_of_pictures(numbered)
    assert "RTP packets of payload type 97, not 96" in what and not received
    bare = [
        rtp(i, 6000 * i, marker=True, payload=b"\x41x" if i else b"\x65x") for i in range(8)
    ]  # a key frame, and no parameter sets with it
    what, received = instead_of_pictures(bare)
    assert "before the first parameter sets" in what and "config-interval" in what and not received


def test_what_came_instead_is_forgotten_with_the_next_picture(clip):
    port = free_port()
    video = VideoInput(video_address(f"rtp://127.0.0.1:{port}"), VideoListener(*[lambda told: None] * 3))
    with closing(video), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        video.start()
        until(lambda: sender.sendto(rtp(kind=97), ("127.0.0.1", port)) and video.instead)
        send(clip, port)
        until(lambda: video.received)
        assert video.instead is None


def test_a_port_that_another_program_reads_is_refused():
    """The last one took all packets from those before it, which heard that nothing came."""
    address = f"rtp://127.0.0.1:{free_port()}"
    with closing(RtpStream(address, Counter())), pytest.raises(OSError, match="in use"):
        RtpStream(address, Counter())


def test_a_cameras_address_is_not_where_to_listen():
    with pytest.raises(StreamEnded, match=r"192\.0\.2\.1 is no address of this machine"):
        RtpStream(f"rtp://192.0.2.1:{free_port()}", Counter())


def test_where_no_group_can_be_bound_to_all_that_comes_to_its_port_is_heard(monkeypatch):
    """Windows knows a group as no address of its own, so `rtp://239.1.1.1:5600` was never opened."""
    bound_to, bind = [], socket.socket.bind

    def bind_as_windows(self, address):
        if address[0]:
            raise OSError(errno.EADDRNOTAVAIL, "The requested address is not valid in its context")
        bound_to.append(address[1])
        bind(self, address)

    monkeypatch.setattr(socket.socket, "bind", bind_as_windows)
    joined, setsockopt = [], socket.socket.setsockopt

    def join(self, level, option, value):
        if option == socket.IP_ADD_MEMBERSHIP:  # needs a network, which a test may not have
            joined.append(value)
        else:
            setsockopt(self, level, option, value)

    monkeypatch.setattr(socket.socket, "setsockopt", join)
    with closing(RtpStream("rtp://239.1.1.1:45600", Counter())):
        assert (bound_to, joined) == ([45600, 45601], [bytes([239, 1, 1, 1, 0, 0, 0, 0])] * 2)


NEWEST = RtpPacket.parse(rtp(65_000, 2**32 - 1000))


def strays(*steps, ms=33):
    """What Continuity says of packets that lie (numbers, ticks) from NEWEST, `ms` after each other."""
    continuity = Continuity()
    assert continuity.strays(NEWEST, 0) == 0
    return [
        continuity.strays(
            RtpPacket.parse(rtp((65_000 + n) % 2**16, (2**32 - 1000 + ticks) % 2**32)), i * ms * 10**6
        )
        for i, (n, ticks) in enumerate(steps, 1)
    ]


@pytest.mark.parametrize("number", [5, 50 - MAX_MISORDER, MAX_DROPOUT + 1, 20_000, 32_768, 45_000])
@pytest.mark.parametrize("ticks", [2**31 - 1, 300_000, -2_000_000, -(2**31)])
def test_a_restart_with_the_same_source_is_known_by_its_second_packet(number, ticks):
    """Its packets were taken for late ones, half of all numbers long, or its times for those of the stream before."""
    assert strays((1, 3000), (number, ticks), (number + 1, ticks)) == [0, 1, 2]


def test_numbers_alone_tell_a_restart_too():
    assert strays((20_000, 3000), (20_001, 6000)) == [1, 2]
    assert strays((-20_000, 3000), (-19_999, 6000)) == [1, 2]


def test_one_stray_packet_is_no_restart():
    assert strays((1, 3000), (9000, 5), (2, 6000), (9001, 5), (3, 9000)) == [0, 1, 0, 1, 0]
    assert strays((9000, 3000), (30_000, 3000), (9001, 3000)) == [1, 1, 1]


@given(st.lists(st.tuples(st.integers(1, MAX_DROPOUT - 1), st.integers(0, MAX_MISORDER - 1)), max_size=40))
def test_lost_late_and_repeated_packets_are_no_restart(gaps):
    number, steps = 0, []
    for gap, back in gaps:
        number += gap
        steps += [(number, 30 * number), (number - back, 30 * (number - back))]
    assert not any(strays(*steps, ms=500))


def test_packets_that_waited_while_this_process_slept_are_no_restart():
    assert strays((1, 3000), (2, 6000), ms=60_000) == [0, 0]


@pytest.mark.parametrize(("seconds", "stray"), [(1.9, 0), (2.1, 1), (-1.9, 0), (-2.1, 1)])
def test_a_streams_time_may_step_by_two_seconds(seconds, stray):
    assert strays((1, 3000), (2, 3000 + round(90_000 * seconds))) == [0, stray]


def test_what_may_be_lost_counts_from_the_newest_packet_not_from_a_late_one():
    assert strays((100, 3000), (10, 300), (100 + MAX_DROPOUT - 1, 9000)) == [0, 0, 0]


def renumbered(datagrams, *, number, ticks):
    """The same pictures as a restarted sender's."""
    packets = [RtpPacket.parse(data) for data in datagrams]
    return [
        rtp(
            (packet.sequence + number) % 2**16,
            (packet.timestamp + ticks) % 2**32,
            marker=packet.marker,
            payload=packet.payload,
            source=packet.source,
        )
        for packet in packets
    ]


def test_a_restart_with_the_same_source_ends_the_connection(datagrams):
    """It is opened again, with a new decoder, order and clock; before, no picture came for minutes."""
    with pytest.raises(StreamEnded, match="anew"):
        pictures_of(datagrams + renumbered(datagrams, number=-20_000, ticks=2**30), 90)


def test_no_packet_of_the_new_stream_is_taken_for_one_of_the_old():
    counts = Counter()
    with closing(RtpStream(f"rtp://127.0.0.1:{free_port()}", counts)) as stream:
        assert stream._is_ours(RtpPacket.parse(rtp(5, 0)), 0)
        assert not stream._is_ours(RtpPacket.parse(rtp(6, 2**31)), 33_000_000)
        with pytest.raises(StreamEnded):
            stream._is_ours(RtpPacket.parse(rtp(7, 2**31)), 33_000_000)
    assert counts == {"RTP packets that do not go on from those before": 1}


class Clock:
    """In place of `time`: it is `due_ns` as soon as somebody waits; the wall clock was `wall_ns` at 0."""

    def __init__(self, wall_ns):
        self.now_ns, self.due_ns, self.wall_ns = 0, 0, wall_ns

    def waits(self, wait):
        def waited(timeout_s):
            self.now_ns = self.due_ns
            return wait(timeout_s)

        return waited

    def monotonic_ns(self):
        return self.now_ns

    def monotonic(self):
        return self.now_ns / 1e9

    def time_ns(self):
        return self.wall_ns + self.now_ns


def test_ages_count_from_the_senders_clock(clip, monkeypatch):
    """FFmpeg tells by RTCP when it sent the first; here each comes when it is due, however busy the machine is."""
    port, sent, ages = free_port(), [0, 10**9], []
    with bound(port) as pictures, bound(port + 1) as control:
        while sent[1] - sent[0] > 5_000_000:  # nobody knows the time of the first packet better
            drained(pictures), drained(control), sent.clear()
            send(clip, port, lambda i: sent.append(time.time_ns()))
        datagrams, reports = drained(pictures), drained(control)
    clock, first = Clock(sent[0]), RtpPacket.parse(datagrams[0]).timestamp
    monkeypatch.setattr(rtp_stream, "time", clock)
    with (
        closing(RtpStream(f"rtp://127.0.0.1:{port}", Counter())) as stream,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        monkeypatch.setattr(stream._selector, "select", clock.waits(stream._selector.select))
        found = stream.pictures(PictureClock(0, wall_from_sender=True), threading.Event())
        for report in reports:
            sender.sendto(report, ("127.0.0.1", port + 1))
        for timestamp, parts in groupby(datagrams, lambda data: RtpPacket.parse(data).timestamp):
            clock.due_ns = (timestamp - first) % 2**32 * 10**9 // 90_000
            for part in parts:
                sender.sendto(part, ("127.0.0.1", port))
            picture = next(found)
            if picture.age_from == "sender":
                ages.append((clock.now_ns - picture.stamp_ns) / 1e6)
    assert len(ages) > 30
    assert -10 < np.median(ages) < 30


class Playing(Clock):
    """The time of a sender too: each picture's datagrams go to `port` when it is due, whoever is busy meanwhile."""

    def __init__(self, datagrams, port):
        super().__init__(wall_ns=0)
        packets = [RtpPacket.parse(data) for data in datagrams]
        ticks = [(packet.timestamp - packets[0].timestamp) % 2**32 for packet in packets]
        self._left = deque(zip((each * 10**9 // 90_000 for each in ticks), datagrams, strict=True))
        self._sender, self._to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), ("127.0.0.1", port)

    def close(self):
        self._sender.close()

    def spend(self, spent_ns):
        self.now_ns += spent_ns
        while self._left and self._left[0][0] <= self.now_ns:
            self._sender.sendto(self._left.popleft()[1], self._to)

    def waits(self, wait):
        def waited(timeout_s):
            if not (ready := wait(0)) and self._left:
                self.spend(max(0, self._left[0][0] - self.now_ns))
                ready = wait(timeout_s)
            return ready

        return waited


def test_pictures_that_pile_up_in_the_sockets_buffer_are_thrown_away(tmp_path, monkeypatch):
    """After 20 s they were 8 s old, and told to be 2: times are those of reading, which were all as late."""
    port, counts, ages, first, decode = free_port(), Counter(), [], None, SoundDecoder.decode
    datagrams, _ = as_sent(encode(tmp_path / "flight.mp4", seconds=7), port)

    def slowly(self, packet):
        clock.spend(round(1.6e9 / RATE_HZ))
        return decode(self, packet)

    monkeypatch.setattr(SoundDecoder, "decode", slowly)
    with (
        closing(Playing(datagrams, port)) as clock,
        closing(RtpStream(f"rtp://127.0.0.1:{port}", counts)) as stream,
    ):
        monkeypatch.setattr(rtp_stream, "time", clock)
        monkeypatch.setattr(stream._selector, "select", clock.waits(stream._selector.select))
        for picture in stream.pictures(PictureClock(0), threading.Event()):
            first = picture.decoded.pts if first is None else first
            number = round((picture.decoded.pts - first) / 90_000 * RATE_HZ)
            ages.append((clock.now_ns / 1e9 - number / RATE_HZ, (clock.now_ns - picture.stamp_ns) / 1e9))
            if number >= 6 * RATE_HZ:
                break
    assert counts[BEHIND] > 5
    assert max(true for true, _ in ages) < 1.5  # 3.5 s where they queue
    assert max(true - told for true, told in ages) < 0.2


def test_a_header_that_promises_more_than_there_is_is_none():
    """Of an extension only a part, padding as long as all of it, sources that are not there."""
    assert RtpPacket.parse(rtp(payload=b"")) is None
    assert RtpPacket.parse(rtp(payload=b"x")).payload == b"x"
    extended = b"\x90" + rtp(payload=b"\xbe\xde\x00\x00")[1:]
    assert RtpPacket.parse(extended) is None and RtpPacket.parse(extended + b"x").payload == b"x"
    assert all(RtpPacket.parse(extended[:n]) is None for n in range(12, 16))
    assert RtpPacket.parse(b"\xa0" + rtp(payload=b"ab\x03")[1:]) is None
    assert RtpPacket.parse(b"\xa0" + rtp(payload=b"ab\x02")[1:]).payload == b"a"
    assert RtpPacket.parse(b"\x81" + rtp(payload=b"abcd")[1:]) is None
    assert RtpPacket.parse(b"\x40" + rtp()[1:]) is None  # version 1


def test_only_a_whole_sender_report_is_one():
    data = struct.pack(">BBHIIIIII", 0x80, 200, 6, 7, 3_000_000_000, 0, 90, 0, 0)
    assert SenderReport.parse(data) == SenderReport(7, (3_000_000_000 - 2_208_988_800) * 10**9, 90)
    assert SenderReport.parse(data[:27]) is None
    assert SenderReport.parse(b"\x40" + data[1:]) is None
    assert SenderReport.parse(data[:1] + b"\xc9" + data[2:]) is None  # a receiver's


def sequences(reorder, number, now_ns=0):
    return [(packet.sequence, lost) for packet, _, lost in reorder.add(RtpPacket.parse(rtp(number)), now_ns)]


def test_sixteen_packets_may_wait_for_one_and_no_more():
    reorder = Reorder()
    assert sequences(reorder, 10) == [(10, False)]
    assert all(sequences(reorder, number) == [] for number in range(12, 28))
    assert sequences(reorder, 28) == [(12, True), *((number, False) for number in range(13, 29))]
    assert sequences(reorder, 11) == []  # too late now
    assert sequences(reorder, 28) == []  # came before
    assert sequences(reorder, 29) == [(29, False)]
    assert sequences(reorder, 30, LONGEST_HELD_NS) == [(30, False)]  # and they are not held


@pytest.mark.parametrize(("waited_ms", "due"), [(39, []), (40, [(12, True), (13, False)])])
def test_a_packet_waits_for_40_ms(waited_ms, due):
    reorder = Reorder()
    sequences(reorder, 10)
    sequences(reorder, 12)
    assert sequences(reorder, 13, waited_ms * 1_000_000) == due


def test_a_picture_came_with_its_first_packet():
    units = Units()
    assert not list(units.add(RtpPacket.parse(rtp(1, 90)), 5, lost=False))
    [unit] = units.add(RtpPacket.parse(rtp(2, 90, marker=True)), 9, lost=False)
    assert (unit.came_ns, unit.ticks, unit.data) == (5, 90, 2 * (START_CODE + b"\x41x"))


@pytest.mark.parametrize("lost_first", [True, False])
def test_a_picture_that_lacks_a_packet_has_no_data_and_the_next_is_whole(lost_first):
    units = Units()
    assert not list(units.add(RtpPacket.parse(rtp(2, 90)), 5, lost=lost_first))
    [damaged] = units.add(RtpPacket.parse(rtp(4, 90, marker=True)), 9, lost=not lost_first)
    [whole] = units.add(RtpPacket.parse(rtp(5, 180, marker=True)), 10, lost=False)
    assert (damaged.data, whole.data) == (None, START_CODE + b"\x41x")


def test_a_fragment_without_its_beginning_makes_no_picture():
    units = Units()
    [unit] = units.add(RtpPacket.parse(rtp(1, 90, marker=True, payload=b"\x7c\x45end")), 5, lost=False)
    assert unit.data is None


@pytest.mark.parametrize(
    ("parts", "payload"),
    [
        (h264_parts, b"\x78\x00\x00"),  # a unit of no bytes
        (h264_parts, b"\x78\x00\x03ab"),  # one longer than its packet
        (h264_parts, b"\x79\x00\x01a"),  # STAP-B
        (h264_parts, b"\x60x"),  # type 0
        (h265_parts, b"\x60\x01\x00\x04abc"),
        (h265_parts, b"\x64\x01a"),  # type 50, PACI
    ],
)
def test_payloads_that_are_none_of_these_are_refused(parts, payload):
    with pytest.raises(ValueError, match="expected"):
        parts(payload)


def test_fragments_keep_their_heads_other_bits():
    """H.264's importance (2 bits), H.265's layer (its first bit lies in the first byte)."""
    assert h264_parts(b"\x1c\x81x")[1] == b"\x01" and h264_parts(b"\x5c\x81x")[1] == b"\x41"
    assert h265_parts(b"\x63\x09\x93x")[1] == b"\x27\x09"


@pytest.mark.parametrize(
    ("h265", "kind", "shows"),
    [(False, 1, 1), (False, 5, 1), (False, 6, 0), (True, 0, 1), (True, 21, 1), (True, 31, 1), (True, 32, 0)],
)
def test_which_units_are_of_a_picture(h265, kind, shows):
    """Slices are; parameter sets and messages stand before the next one."""
    payload = bytes([kind << 1, 1, 0]) if h265 else bytes([0x60 | kind, 0])
    found = list(
        Units(h265=h265).add(RtpPacket.parse(rtp(1, 0, marker=True, payload=payload)), 0, lost=False)
    )
    assert len(found) == shows


def test_a_decoder_can_begin_with_parameter_sets_wherever_they_stand():
    assert begins(START_CODE + b"\x06sei" + START_CODE + b"\x67sps" + START_CODE + b"\x65i", h265=False)
    assert not begins(START_CODE + b"\x68pps" + START_CODE + b"\x65i", h265=False)
    assert begins(START_CODE + b"\x40\x01vps", h265=True)
    assert not begins(START_CODE + b"\x42\x01sps", h265=True)
    assert not begins(START_CODE, h265=False) and not begins(b"", h265=False)
