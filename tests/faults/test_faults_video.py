"""Faults 1 to 7 and 10 of the video itself: what is delivered is sound, and what is not is counted."""

import random
import struct
import threading
import time
import tracemalloc
from collections import Counter
from contextlib import closing
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from fault_flights import FPS, GROUP, film, packets
from hypothesis import given, settings
from hypothesis import strategies as st
from trash import trashed

from flightdepth.errors import BadInput
from flightdepth.flight.decoding import REORDERED
from flightdepth.flight.video import Video
from flightdepth.live.video_address import video_address
from flightdepth.live.video_stream import VideoStream

FRAMES = 40


def read(path, **part):
    with Video(path, **part) as video:
        frames = list(video.frames())
    return frames, dict(video.counts)


def number(frame):
    """Which picture of the film this is, by its time."""
    return number_at(frame.stamp_ns)


def number_at(stamp_ns):
    """Which picture of the film is shown then."""
    return round(stamp_ns * FPS / 1e9)


def unsound(frames, of):
    """Numbers of the pictures that are not, to the last bit, pictures of the undamaged film."""
    return [number(frame) for frame in frames if frame.image.tobytes() not in pictures(of)]


@cache
def pictures(path):
    """All that a film shows."""
    return {frame.image.tobytes() for frame in read(path)[0]}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Four groups of ten pictures, in an MP4 with its index at the front."""
    return film(tmp_path_factory.mktemp("film") / "whole.mp4", FRAMES, muxer={"movflags": "faststart"})


@pytest.fixture(scope="module")
def stream(tmp_path_factory):
    """The same as a transport stream, as a link or a recorder writes it."""
    return film(tmp_path_factory.mktemp("film") / "whole.ts", FRAMES)


def damaged(path, tmp_path, changes):
    """A copy with bytes replaced: (place, new bytes)."""
    data = bytearray(path.read_bytes())
    for at, new in changes:
        data[at : at + len(new)] = new
    copy = tmp_path / f"damaged{path.suffix}"
    copy.write_bytes(data)
    return copy


def test_a_sound_film_shows_what_it_should(whole):
    frames, counts = read(whole)
    assert [number(frame) for frame in frames] == list(range(FRAMES))
    assert counts == {}
    assert len({frame.image.tobytes() for frame in frames}) == FRAMES
    assert not any(frame.after_damage for frame in frames)


# Fault 1: no video.


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no such file"),
        (b"", "an empty file"),
        (b"time_s,vn_m_s\n0,1\n", "a text file"),
        (b"\x89PNG\r\n\x1a\n" + bytes(200), "video .*expected"),
        (b"\0\0\0\x20ftypisom" + b"\xff" * 500, "an MP4 without a usable index"),
        (b"\x1aE\xdf\xa3" + b"\xff" * 500, "expected a video"),
    ],
)
def test_fault_1_what_is_no_video_is_refused(tmp_path, content, said):
    path = tmp_path / "flight.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=said):
        Video(path)


# Fault 2: cut at any byte.


@pytest.mark.parametrize("name", ["whole", "stream"])
def test_fault_2_a_cut_video_gives_what_came_before(name, request, tmp_path):
    path = request.getfixturevalue(name)
    data, cut, lengths = path.read_bytes(), tmp_path / f"cut{path.suffix}", []
    for end in [*range(1, len(data), len(data) // 25), len(data)]:
        cut.write_bytes(data[:end])
        try:
            frames, counts = read(cut)
        except BadInput:
            lengths.append(0)
            continue
        # A transport stream has no index: cut between two packets it looks whole, and half a packet like a whole one.
        is_stream = path.suffix == ".ts"
        assert unsound(frames[:-1] if is_stream else frames, path) == []
        assert counts or len(frames) == FRAMES or is_stream
        lengths.append(len(frames))
    # The picture that was cut may take along those that the order of display holds back. In a transport stream the
    # decoder calls it damaged or not as its threads happen to run.
    assert all(later >= before - REORDERED - 1 for before, later in pairwise(lengths))
    assert lengths[-1] == FRAMES
    assert any(0 < length < FRAMES for length in lengths)


# Fault 3: trash.


def outcomes(path, tmp_path, seeds):
    """How many trashed copies were read, and the processor time of all; anything but BadInput flies out."""
    data, copy, good = path.read_bytes(), tmp_path / f"trashed{path.suffix}", 0
    spent_s = 0.0
    for seed in seeds:
        copy.write_bytes(trashed(data, seed))
        started = time.process_time()
        try:
            frames, _ = read(copy)
        except BadInput as error:
            assert "\n" not in str(error)
        else:
            good += 1
            stamps = [frame.stamp_ns for frame in frames]
            assert stamps == sorted(set(stamps))
        spent_s += time.process_time() - started
    return good, spent_s


@pytest.mark.parametrize("name", ["whole", "stream"])
def test_fault_3_trashed_copies_are_refused_or_counted(name, request, tmp_path):
    good, _ = outcomes(request.getfixturevalue(name), tmp_path, range(40))
    assert good > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", ["whole", "stream"])
def test_fault_3_500_trashed_copies_take_no_longer_than_twice_as_many_whole_ones(name, request, tmp_path):
    path = request.getfixturevalue(name)
    started = time.process_time()
    for _ in range(20):
        read(path)
    normal_s = (time.process_time() - started) / 20
    _, spent_s = outcomes(path, tmp_path, range(500))
    assert spent_s < 2 * 500 * normal_s


@given(at=st.integers(0, 10**6), trash=st.binary(max_size=200))
@settings(max_examples=25)
def test_fault_3_any_bytes_at_any_place(tmp_path_factory, whole, at, trash):
    data = whole.read_bytes()
    at %= len(data)
    path = tmp_path_factory.getbasetemp() / "any.mp4"
    path.write_bytes(data[:at] + trash + data[at + len(trash) :])
    try:
        frames, _ = read(path)
    except BadInput:
        return
    assert np.all(np.diff([frame.stamp_ns for frame in frames]) > 0)


# Fault 4: a declared length of 2^31.


@pytest.mark.parametrize("kind", [b"moov", b"mdat", b"stsz", b"stco", b"stsd"])
def test_fault_4_a_box_of_2_to_the_31_is_refused_before_allocating(whole, tmp_path, kind):
    data = bytearray(whole.read_bytes())
    at = data.index(kind) - 4
    data[at : at + 4] = struct.pack(">L", 2**31)
    path = tmp_path / "bomb.mp4"
    path.write_bytes(data)
    peak = peak_bytes(path)
    assert peak < 64 << 20


@pytest.mark.parametrize("kind", [b"stsz", b"stts", b"stco"])
def test_fault_4_a_table_of_2_to_the_31_entries_is_refused_before_allocating(whole, tmp_path, kind):
    data = bytearray(whole.read_bytes())
    at = data.index(kind) + (12 if kind == b"stsz" else 8)
    data[at : at + 4] = struct.pack(">L", 2**31 - 1)
    path = tmp_path / "bomb.mp4"
    path.write_bytes(data)
    assert peak_bytes(path) < 64 << 20


def peak_bytes(path):
    """Largest memory that Python held, and, where the system tells it, how much the process grew."""
    before_kib = resident_peak_kib()
    tracemalloc.start()
    try:
        read(path)
    except BadInput:
        pass
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return max(peak, (resident_peak_kib() - before_kib) << 10)


def resident_peak_kib():
    resource = pytest.importorskip("resource")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


# Fault 5: no index, or cut within a group of pictures.


def test_fault_5_a_video_without_moov_is_refused(tmp_path):
    path = film(tmp_path / "flight.mp4", 20)
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"moov") - 4])
    with pytest.raises(BadInput, match="an MP4 without a usable index, so it was cut off"):
        Video(path)


def test_fault_5_a_video_cut_in_mid_group_ends_with_its_last_sound_picture(whole, tmp_path):
    at, size, _ = packets(whole)[2 * GROUP + 4]
    path = tmp_path / "cut.mp4"
    path.write_bytes(whole.read_bytes()[: at + size // 2])
    frames, counts = read(path)
    assert 2 * GROUP - REORDERED <= len(frames) <= 2 * GROUP + 4
    assert unsound(frames, whole) == []
    assert counts["frames missing at the end of the file"] >= FRAMES - 2 * GROUP - 5
    assert len(frames) + sum(counts.values()) == FRAMES


def test_fault_5_a_cut_is_told_where_only_a_part_is_wanted(tmp_path):
    """The index at the front promises what is not there."""
    path = film(tmp_path / "long.mp4", 100, muxer={"movflags": "faststart"})
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with Video(path, start_s=0.5) as video:
        last_ns = max(frame.stamp_ns for frame in video.frames())
        missing_s = (video.duration_ns - last_ns) / 1e9
        assert video.counts["seconds missing at the end of the file"] == round(missing_s) > 0
    with pytest.raises(BadInput, match="that was cut off before"):
        Video(path, start_s=last_ns / 1e9 + 0.5)
    with pytest.raises(BadInput) as between:  # pictures of a sound video
        Video(film(tmp_path / "sound.mp4", 40), start_s=0.51, end_s=0.52)
    assert "cut off" not in str(between.value)
    with pytest.raises(BadInput) as last:  # is shown from 1.30 s to the end, 1.33 s
        Video(tmp_path / "sound.mp4", start_s=1.32)
    assert "cut off" not in str(last.value)


@pytest.mark.parametrize("codec", ["libx264", "mpeg4"])
def test_fault_5_a_stream_that_begins_in_mid_group_begins_with_its_first_key_frame(tmp_path, codec):
    path = film(tmp_path / "whole.ts", FRAMES, codec=codec)
    data = path.read_bytes()
    keys = [at for at, _, key in packets(path) if key]
    tables = data[: keys[0]]  # of the stream's programmes, 188 bytes a packet
    copy = tmp_path / "begun.ts"
    copy.write_bytes(tables[: len(tables) // 188 * 188] + data[keys[0] + 3 * 188 :])
    begun, _ = read(copy)
    assert unsound(begun, path) == []
    assert len(begun) == FRAMES - GROUP


def test_fault_5_such_a_file_runs_against_its_log_as_it_flies(tmp_path):
    """The log began with the first sound picture in `live`, with the stream in `run`."""
    path = film(tmp_path / "whole.ts", FRAMES)
    data = path.read_bytes()
    keys = [at for at, _, key in packets(path) if key]
    copy = tmp_path / "begun.ts"
    copy.write_bytes(data[: keys[0] // 188 * 188] + data[keys[0] + 3 * 188 :])
    begun, _ = read(copy)
    stream = VideoStream(video_address(str(copy)), Counter())
    epoch_ns = time.monotonic_ns()
    pictures = stream.paced(epoch_ns, 0, threading.Event())
    stamps_ns = [next(pictures).stamp_ns - epoch_ns for _ in range(3)]
    stream.close()
    assert stamps_ns == pytest.approx([frame.stamp_ns for frame in begun[:3]], abs=2)
    assert stamps_ns[0] > 0


# Fault 6: damaged packets.


@pytest.mark.parametrize("group", [0, 1, 2])
def test_fault_6_after_a_damaged_key_frame_nothing_comes_until_the_next(whole, tmp_path, group):
    at, size, key = packets(whole)[group * GROUP]
    assert key
    path = damaged(whole, tmp_path, [(at + size // 4, bytes(size - size // 4))])
    frames, counts = read(path)
    lost = set(range(group * GROUP, (group + 1) * GROUP))
    # The order of display holds a few sound pictures back: they go with it.
    assert {number(frame) for frame in frames} <= set(range(FRAMES)) - lost
    assert len(frames) >= FRAMES - GROUP - REORDERED
    assert unsound(frames, whole) == []
    assert len(frames) + sum(counts.values()) == FRAMES
    assert [number(frame) for frame in frames if frame.after_damage] == [(group + 1) * GROUP]


@pytest.mark.parametrize("seed", range(8))
def test_fault_6_no_picture_is_grey_or_smeared_wherever_packets_are_hit(whole, tmp_path, seed):
    chance = random.Random(seed)
    hit = [(at, size) for at, size, _ in packets(whole) if size > 60]
    changes = [(at + 4 + size // 4, bytes(size - 4 - size // 4)) for at, size in chance.sample(hit, 2)]
    frames, counts = read(damaged(whole, tmp_path, changes))
    assert unsound(frames, whole) == []
    assert len(frames) + sum(counts.values()) == FRAMES


@pytest.mark.parametrize("seed", range(6))
def test_fault_6_packets_lost_on_the_way_cost_their_group(stream, tmp_path, seed):
    data = stream.read_bytes()
    at = random.Random(seed).randrange(8, len(data) // 188 - 3) * 188
    path = tmp_path / "lossy.ts"
    path.write_bytes(data[:at] + data[at + 2 * 188 :])
    frames, _ = read(path)
    assert unsound(frames, stream) == []
    assert len(frames) >= FRAMES - 2 * GROUP - 4


def test_fault_6_a_damaged_h265_packet_costs_its_group(tmp_path):
    quick = {"preset": "ultrafast", "x265-params": f"log-level=none:keyint={GROUP}:open-gop=0"}
    path = film(tmp_path / "v.mp4", FRAMES, codec="libx265", encoder=quick, muxer={"movflags": "faststart"})
    at, size, _ = next(each for each in packets(path)[GROUP:] if each[2])
    frames, counts = read(damaged(path, tmp_path, [(at + size // 4, bytes(size - size // 4))]))
    assert unsound(frames, path) == []
    assert len(frames) >= FRAMES - 2 * GROUP
    assert counts["damaged video packets"] == 1
    assert len([frame for frame in frames if frame.after_damage]) == 1


def test_fault_6_pictures_that_stand_alone_are_lost_alone(tmp_path):
    path = film(tmp_path / "v.mov", 12, codec="mjpeg", encoder={"strict": "unofficial"})
    at, size, _ = packets(path)[5]
    frames, counts = read(damaged(path, tmp_path, [(at, bytes(size))]))
    assert [number(frame) for frame in frames] == [0, 1, 2, 3, 4, *range(6, 12)]
    assert sum(counts.values()) == 1


# Fault 7: another size in mid-stream.


def test_fault_7_pictures_of_another_size_are_left_out_and_counted(tmp_path):
    first = film(tmp_path / "a.ts", 20)
    wide = film(tmp_path / "b.ts", stamps_s=[1 + i / FPS for i in range(20)], size=(192, 128))
    again = film(tmp_path / "c.ts", stamps_s=[2 + i / FPS for i in range(20)])
    path = tmp_path / "joined.ts"
    path.write_bytes(first.read_bytes() + wide.read_bytes() + again.read_bytes())
    frames, counts = read(path)
    assert {frame.image.shape for frame in frames} == {(128, 128, 3)}
    assert counts["frames of another size than the first"] >= 20 - GROUP
    assert sum(frame.stamp_ns > 1.9e9 for frame in frames) > 0  # what comes back is used
    assert [frame.index for frame in frames] == list(range(len(frames)))


# Fault 10: stamps that do not rise.


def test_fault_10_pictures_with_doubled_or_backward_times_are_dropped_and_counted(tmp_path):
    path = film(tmp_path / "flight.mkv", 12, codec="mjpeg", encoder={"strict": "unofficial"})
    data = bytearray(path.read_bytes())
    for picture, late_ms in ((4, -33), (8, -234)):  # to 100 ms, as the one before; to 33 ms, as the second
        place = nth(data, b"\xff\xd8\xff", picture) - 3  # a block is track, time, flags, and then the JPEG
        struct.pack_into(">h", data, place, struct.unpack_from(">h", data, place)[0] + late_ms)
    path.write_bytes(data)
    frames, counts = read(path)
    assert counts == {"frames not later than the one before": 2}
    assert [number(frame) for frame in frames] == [0, 1, 2, 3, 5, 6, 7, 9, 10, 11]


def test_fault_10_one_time_far_ahead_costs_its_own_picture(tmp_path):
    """Found in review: all that came after it, to the end of the flight, was not later. Live waited for it."""
    path = film(tmp_path / "flight.mkv", 24, codec="mjpeg", encoder={"strict": "unofficial"})
    data = bytearray(path.read_bytes())
    place = nth(data, b"\xff\xd8\xff", 9) - 3
    struct.pack_into(">h", data, place, struct.unpack_from(">h", data, place)[0] + 20_000)
    path.write_bytes(data)
    others = [index for index in range(24) if index != 9]
    frames, counts = read(path)
    assert counts == {"frames whose time jumps ahead": 1}
    assert [number(frame) for frame in frames] == others
    live_counts = Counter()
    stream = VideoStream(video_address(str(path)), live_counts)
    began_ns = time.monotonic_ns()
    with closing(stream):
        played = list(stream.paced(began_ns, 0, threading.Event()))
    assert dict(live_counts) == counts
    assert [number_at(picture.stamp_ns - began_ns) for picture in played] == others


def nth(data, found, n):
    """Where `found` begins for the n-th time, from 0."""
    at = -1
    for _ in range(n + 1):
        at = data.index(found, at + 1)
    return at
