"""Files without key frames after the first, and files from which packets are missing."""

from types import SimpleNamespace

import av
import pytest

from flightdepth.flight.decoding import BUILT_ON_DAMAGE, MISSING, REORDERED
from flightdepth.flight.refresh import Refresh
from flightdepth.flight.video import Video
from flightdepth.flight.video_headers import H264Headers, recovery_point, units
from tests_refresh import CYCLE, H265_TAKES, RATE_HZ, copied, film, missing, overwritten

FRAMES = 130
DAMAGED = CYCLE + 5
TAKES = {"libx264": CYCLE, "libx265": H265_TAKES}  # pictures from a refresh's begin until all is whole


def read(path, **part):
    """Pictures by number, those after damage, what was left out."""
    with Video(path, **part) as video:
        frames = {round(frame.stamp_ns * RATE_HZ / 1e9): frame for frame in video.frames()}
        after = [number for number, frame in frames.items() if frame.after_damage]
        return {number: frame.image.tobytes() for number, frame in frames.items()}, after, dict(video.counts)


@pytest.fixture(scope="module", params=["libx264", "libx265"])
def refreshed(request, tmp_path_factory):
    path = film(tmp_path_factory.mktemp("refreshed") / "v.mp4", FRAMES, request.param)
    return SimpleNamespace(path=path, pictures=read(path)[0], takes=TAKES[request.param], codec=request.param)


@pytest.mark.parametrize("name", ["v.mp4", "v.mkv", "v.ts"])
@pytest.mark.parametrize("damage", [overwritten, missing], ids=["overwritten", "missing"])
def test_after_damage_pictures_come_again_with_the_first_whole_refresh(refreshed, tmp_path, damage, name):
    """All after the damage was lost: it was waited for a key frame. Missing packets of H.264 were not noticed."""
    path = copied(refreshed.path, tmp_path / name, damage(DAMAGED))
    pictures, after, counts = read(path)
    assert pictures.items() <= refreshed.pictures.items()
    again = min(number for number in pictures if number > DAMAGED)
    assert set(pictures) >= {*range(DAMAGED - REORDERED - 1), *range(again, FRAMES)}
    assert again <= 2 * CYCLE + refreshed.takes
    assert after == [again]
    assert counts[BUILT_ON_DAMAGE] > 0
    lost = sum(counts.values()) - counts.get(MISSING, 0)
    assert len(pictures) + lost == FRAMES - (damage is missing)


def test_a_refresh_that_is_damaged_itself_does_not_count(refreshed, tmp_path):
    """Found on the way: H.264's decoder does not tell what is wrong with pictures that it keeps to itself."""
    path = copied(refreshed.path, tmp_path / "v.mp4", overwritten(DAMAGED, 2 * CYCLE + 3))
    pictures, after, _ = read(path)
    assert pictures.items() <= refreshed.pictures.items()
    assert 3 * CYCLE < after[0] <= 3 * CYCLE + refreshed.takes


def test_a_file_that_begins_within_begins_with_its_first_whole_refresh(refreshed, tmp_path):
    """It was refused: at least one picture that can be decoded, got none."""
    path = copied(refreshed.path, tmp_path / "v.mkv", missing(*range(DAMAGED)))
    pictures, _, counts = read(path)
    assert set(pictures.values()) <= set(refreshed.pictures.values())
    assert len(pictures) >= FRAMES - 2 * CYCLE - refreshed.takes
    assert len(pictures) + sum(counts.values()) == FRAMES - DAMAGED


def test_a_part_begins_with_a_refresh_before_it(refreshed):
    start = 5 * CYCLE + 5
    pictures, _, counts = read(refreshed.path, start_s=start / RATE_HZ)
    assert pictures == {number: refreshed.pictures[number] for number in range(start, FRAMES)}
    assert counts == {}


GROUPS = {
    "B frames": {"x264-params": "keyint=20:scenecut=0", "bf": "2"},
    "pyramid": {"x264-params": "keyint=20:scenecut=0:b-pyramid=normal:b-adapt=0", "bf": "5"},
    "open groups": {"x264-params": "open-gop=1:keyint=20:scenecut=0:bframes=2:b-adapt=0"},
    "interlaced": {"x264-params": "keyint=20:interlaced=1"},
    "baseline": {"profile": "baseline", "x264-params": "keyint=20"},
    "zero latency": {"tune": "zerolatency", "x264-params": "keyint=20:slices=4"},
}


@pytest.mark.parametrize("name", ["v.mp4", "v.ts", "v.avi"])
@pytest.mark.parametrize("encoder", GROUPS.values(), ids=GROUPS)
def test_no_packet_of_a_whole_file_is_missed(tmp_path, encoder, name):
    path = film(tmp_path / name, 50, encoder=encoder)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        refresh = Refresh(stream.codec_context)
        packets = [packet for packet in container.demux(stream) if packet.size]
    assert [packet.pts for packet in packets if refresh.misses(packet)] == []


@pytest.mark.parametrize("encoder", [GROUPS["B frames"], GROUPS["pyramid"]], ids=["B frames", "pyramid"])
@pytest.mark.parametrize("lost", [4, 23, 30])
def test_a_missing_packet_costs_its_group_at_most(tmp_path, encoder, lost):
    """An MP4 of a link that lost it: what leant on it was built on another picture, and nothing was said."""
    whole = film(tmp_path / "whole.mp4", 60, encoder=encoder)
    path = copied(whole, tmp_path / "v.mp4", missing(lost))
    pictures, _, counts = read(path)
    assert pictures.items() <= read(whole)[0].items()
    assert len(pictures) >= 60 - CYCLE - REORDERED - 1
    assert counts.get(MISSING, 0) <= 1
    assert len(pictures) + sum(counts.values()) - counts.get(MISSING, 0) == 59


@pytest.mark.parametrize(("name", "start_s"), [("v.mkv", 0), ("v.mp4", 1)])
def test_a_damaged_end_is_not_missing(tmp_path, name, start_s):
    """It was counted twice: as damaged, and as missing at the end of the file."""
    whole = film(tmp_path / "whole.mp4", 180, encoder={"preset": "ultrafast", "g": "90", "bf": "0"})
    pictures, _, counts = read(copied(whole, tmp_path / name, missing(120)), start_s=start_s)
    lost = counts.pop(BUILT_ON_DAMAGE)
    assert counts == {MISSING: 1}
    assert len(pictures) + lost == 179 - start_s * RATE_HZ
    assert max(pictures) < 120


def test_damaged_headers_are_no_error():
    headers = H264Headers(b"")
    for data in (
        b"",
        b"\0\0\1",
        b"\0\0\1\x67",
        b"\0\0\1\x67\x42",
        b"\0\0\1\x06\x06\xff\xff",
        b"\0\0\1\x65" * 3,
    ):
        assert headers.read(data) is None
    assert H264Headers(b"\1\x42\0\0\xff").read(b"\0\0\0\5\x65") is None
    assert [*units(b"\0\0\0\0\0\0\0\1a\xff\0\0\0b", 4)] == [b"a", b"b"]
    assert recovery_point(b"\x05\x01\x00\x06\x01\x9c\x80") == b"\x9c"
    assert recovery_point(b"\xff\xff\xff") is None
