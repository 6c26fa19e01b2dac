import random
import threading
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

import av
import numpy as np
import pytest
from flight_files import make_sound, make_video, trimmed, turn_video

from flightdepth.errors import BadInput
from flightdepth.flight.decoding import GAP, SoundPictures
from flightdepth.flight.video import Video
from flightdepth.flight.video_file import VideoFile
from flightdepth.live.video_address import video_address
from flightdepth.live.video_stream import VideoStream

UNEVEN_MS = [0, 33, 67, 140, 200, 1000, 1033]


@pytest.fixture
def uneven(tmp_path):
    return make_video(tmp_path / "uneven.mp4", UNEVEN_MS)


def read(path, **part):
    with Video(path, **part) as video:
        return list(video.frames())


def test_times_are_the_containers(uneven):
    assert [frame.stamp_ns for frame in read(uneven)] == [ms * 1_000_000 for ms in UNEVEN_MS]


def test_a_video_that_starts_late_starts_at_zero(tmp_path):
    path = make_video(tmp_path / "late.mkv", [500, 540, 580])
    assert [frame.stamp_ns for frame in read(path)] == [0, 40_000_000, 80_000_000]


def test_pictures_come_in_the_files_order(tmp_path):
    path = make_video(tmp_path / "v.mp4", range(0, 400, 40), colour=lambda index: 20 * index)
    greys = [float(frame.image[40:, 40:].mean()) for frame in read(path)]
    assert np.allclose(greys, np.arange(10) * 20, atol=4)


def test_start_is_included_and_end_is_not(uneven):
    assert [f.stamp_ns // 1_000_000 for f in read(uneven, start_s=0.067, end_s=1.0)] == [67, 140, 200]


def test_a_part_has_the_same_pictures_as_the_whole(tmp_path):
    path = make_video(tmp_path / "v.mp4", range(0, 2000, 40), colour=lambda index: 4 * index)
    whole = {frame.stamp_ns: frame.image for frame in read(path)}
    part = read(path, start_s=1.2)
    assert len(part) == 20
    assert all(np.array_equal(frame.image, whole[frame.stamp_ns]) for frame in part)


def test_an_avi_whose_recorder_dropped_pictures_is_whole(tmp_path):
    """Analogue receivers' recorders leave an empty chunk for each, which the index counts as a frame."""
    path = tmp_path / "dropped.avi"
    ticks = [0, 1, 2, 5, 6, 7, 9, 12]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25, width=64, height=48, pix_fmt="yuvj420p")
        for tick in ticks:
            picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 10 * tick, np.uint8), format="rgb24")
            picture.pts = tick
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    with Video(path) as video:
        assert [frame.stamp_ns // 40_000_000 for frame in video.frames()] == ticks
        assert not video.counts


INTRA_REFRESH = {"x264-params": "intra-refresh=1:keyint=30:bframes=0:scenecut=0"}


@pytest.mark.parametrize(
    ("name", "codec", "stream_options"),
    [
        ("v.ts", "libx264", {"g": "100"}),
        ("v.ts", "libx265", {"x265-params": "keyint=100:log-level=error"}),
        ("v.mpg", "mpeg2video", {"g": "100"}),
        ("v.mkv", "libx264", INTRA_REFRESH),
        ("v.ts", "libx264", INTRA_REFRESH),
    ],
)
def test_a_part_of_a_file_in_which_ffmpeg_seeks_too_far_is_whole(tmp_path, name, codec, stream_options):
    """Found in review: --start lost all up to the next key frame of MPEG-TS, or refused a file that is sound."""
    path = make_video(
        tmp_path / name,
        range(0, 7000, 40),
        colour=lambda index: index % 200,
        codec=codec,
        stream_options=stream_options,
        rate=25,
    )
    whole = {frame.stamp_ns: frame.image for frame in read(path)}
    with Video(path, start_s=3) as video:
        part = list(video.frames())
        assert dict(video.counts) == {}
    assert [frame.stamp_ns for frame in part] == [40_000_000 * index for index in range(75, 175)]
    assert all(np.array_equal(frame.image, whole[frame.stamp_ns]) for frame in part)


def test_a_part_of_an_mp4_is_sought_once(tmp_path, monkeypatch):
    path, ways_back = make_video(tmp_path / "v.mp4", range(0, 2000, 40), stream_options={"g": "10"}), []
    seek = VideoFile._seek
    monkeypatch.setattr(
        VideoFile, "_seek", lambda file, start, back: ways_back.append(back) or seek(file, start, back)
    )
    for start_s in (0.4, 0.79, 1.95):
        read(path, start_s=start_s)
    assert ways_back == [0, 0, 0]


def test_a_way_back_in_vain_stops_at_the_start(tmp_path):
    """Each would else decode all the rest of the file."""
    path = make_video(tmp_path / "v.mkv", range(0, 2000, 40), stream_options=INTRA_REFRESH)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        container.seek(1300, stream=stream)
        sound = SoundPictures(
            container, stream, Counter(), whole=False, begin_by=1320
        )  # a refresh ends at 1360
        assert list(sound) == []
        assert next(container.demux(stream)).pts < 2000 - 40


def test_index_counts_from_zero_in_a_part(uneven):
    assert [frame.index for frame in read(uneven, start_s=0.1)] == [0, 1, 2, 3]


def test_a_sideways_video_is_turned_upright(tmp_path):
    path = turn_video(make_video(tmp_path / "v.mp4", [0, 40], colour=lambda _: 60))
    with Video(path) as video:
        assert video.size == (64, 96)
        image = next(video.frames()).image
    assert image.shape == (96, 64, 3)
    assert image[4, -4].min() > 200  # clockwise: the mark moves from top left to top right
    assert image[4, 4].max() < 100


@pytest.mark.parametrize(
    ("shown", "corner"),
    [
        ((-1, 0, 0, 1), "top right"),
        ((1, 0, 0, -1), "bottom left"),
        ((-1, 0, 0, -1), "bottom right"),
        ((0, 1, 1, 0), "top left"),
        ((0, -1, -1, 0), "bottom right"),
        ((0, -1, 1, 0), "bottom left"),
    ],
)
def test_a_mirrored_video_is_shown_as_players_show_it(tmp_path, shown, corner):
    """Left and right swapped was taken for 180 degrees, top and bottom swapped was not seen."""
    path = turn_video(make_video(tmp_path / "v.mp4", [0, 40], colour=lambda _: 60), shown)
    [image, _] = [frame.image for frame in read(path)]
    assert image.shape == ((64, 96, 3) if shown[0] else (96, 64, 3))
    marks = {
        f"{row} {column}": image[y, x].min() > 200
        for row, y in (("top", 4), ("bottom", -4))
        for column, x in (("left", 4), ("right", -4))
    }
    assert [name for name, marked in marks.items() if marked] == [corner]


def test_a_matrix_of_zeros_turns_nothing(tmp_path):
    """It lay on its side."""
    path = turn_video(make_video(tmp_path / "v.mp4", [0, 40]), (0, 0, 0, 0))
    assert read(path)[0].image.shape == (64, 96, 3)


LIMITED, FULL, TEN_BITS = (16, 235, 128), (0, 255, 128), (64, 940, 512)  # black, white, no colour


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "levels"),
    [
        ("limited.mp4", "libx264", "yuv420p", LIMITED),
        ("full.mp4", "libx264", "yuvj420p", FULL),
        ("ten_bits.mp4", "libx265", "yuv420p10le", TEN_BITS),
        ("prores.mov", "prores_ks", "yuv422p10le", TEN_BITS),
        ("motion_jpeg.avi", "mjpeg", "yuvj420p", FULL),
    ],
)
def test_a_grey_is_the_same_in_any_coding(tmp_path, name, codec, pixels, levels):
    path, greys = tmp_path / name, [0.0, 0.25, 0.5, 1.0]
    black, white, colourless = levels
    number = np.uint16 if levels is TEN_BITS else np.uint8
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixels
        for grey in greys:
            picture = av.VideoFrame(96, 64, pixels)
            luma = round(black + grey * (white - black))
            for plane, value in zip(picture.planes, (luma, colourless, colourless), strict=True):
                plane.update(np.full(plane.buffer_size // number().itemsize, value, number))
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    for frame, grey in zip(read(path), greys, strict=True):
        assert np.abs(frame.image.astype(int) - 255 * grey).max() < 6


def pictures_of(path, shown, **part):
    """Time in steps of 40 ms and number of each picture, by its grey value, `shown(number)`."""
    values = np.array([shown(number) for number in range(50)])
    return [
        (frame.stamp_ns / 40_000_000, int(np.abs(values - frame.image[40:, 40:].mean()).argmin()))
        for frame in read(path, **part)
    ]


@pytest.mark.parametrize("b_frames", ["0", "2"])
def test_a_losslessly_trimmed_video_has_all_that_its_edit_list_shows(tmp_path, b_frames):
    """Its key frame lies before the start, so that a player decodes it and does not show it."""
    whole = make_video(
        tmp_path / "v.mp4", range(0, 2000, 40), colour=lambda k: 4 * k, stream_options={"bf": b_frames}
    )
    part = trimmed(whole, tmp_path / "part.mp4", 800)
    with Video(part) as video:
        assert len(list(video.frames())) == 30
        assert dict(video.counts) == {}
    assert pictures_of(part, lambda k: 4 * k) == [(k, 20 + k) for k in range(30)]
    assert pictures_of(part, lambda k: 4 * k, start_s=0.8) == [(k, 20 + k) for k in range(20, 30)]


def test_the_files_of_a_recording_can_be_joined_without_encoding(tmp_path):
    """As docs/telemetry.md says, here by the library behind ffmpeg's command."""
    for name, first in (("DJI_0001.MP4", 0), ("DJI_0002.MP4", 25)):
        make_video(
            tmp_path / name,
            range(0, 1000, 40),
            colour=lambda k, first=first: 4 * (first + k),
            stream_options={"bf": "2"},
            rate=25,
        )
    files, whole = tmp_path / "files.txt", tmp_path / "whole.mp4"
    files.write_text("file 'DJI_0001.MP4'\nfile 'DJI_0002.MP4'\n")
    with av.open(str(files), format="concat") as parts, av.open(str(whole), "w") as joined:
        copied = joined.add_stream_from_template(parts.streams.video[0])
        for packet in parts.demux(video=0):
            if packet.size:
                packet.stream = copied
                joined.mux(packet)
    assert pictures_of(whole, lambda k: 4 * k) == [(k, k) for k in range(50)]
    assert pictures_of(whole, lambda k: 4 * k, start_s=1.2) == [(k, k) for k in range(30, 50)]


@pytest.mark.parametrize("start_s", [0.08, 0.6])
def test_a_part_of_a_transport_stream_whose_counter_overflows_is_whole(tmp_path, start_s):
    """Times before the overflow are negative: of what began there a part was refused, or lacked its first second."""
    path = make_video(
        tmp_path / "v.ts",
        range(0, 2000, 40),
        colour=lambda k: 4 * k,
        options={"output_ts_offset": f"{2**33 / 90_000 - 1:.3f}"},
        stream_options={"g": "12"},
        rate=25,
    )
    assert pictures_of(path, lambda k: 4 * k) == [(k, k) for k in range(50)]
    first = round(start_s * 25)
    assert pictures_of(path, lambda k: 4 * k, start_s=start_s) == [(k, k) for k in range(first, 50)]


@pytest.mark.parametrize(("name", "codec"), [("v.mov", "cfhd"), ("v.avi", "cfhd"), ("v.mov", "qtrle")])
def test_a_video_whose_decoder_marks_no_key_frame_is_read(tmp_path, name, codec):
    """CineForm, which GoPro's programs make of its videos, and QuickTime Animation were refused: no picture."""
    path = make_video(
        tmp_path / name,
        range(0, 800, 40),
        colour=lambda k: 10 * k,
        codec=codec,
        stream_options={"g": "5"},
        rate=25,
    )
    assert pictures_of(path, lambda k: 10 * k) == [(k, k) for k in range(20)]
    assert pictures_of(path, lambda k: 10 * k, start_s=0.32) == [(k, k) for k in range(8, 20)]


def test_pictures_of_an_avi_are_at_their_own_place(tmp_path, monkeypatch):
    """It numbers packets as they lie, which is not how they are shown."""
    path = make_video(
        tmp_path / "v.avi", range(0, 2000, 40), colour=lambda k: 4 * k, stream_options={"bf": "3"}, rate=25
    )
    assert pictures_of(path, lambda k: 4 * k) == [(k, k) for k in range(50)]
    assert pictures_of(path, lambda k: 4 * k, start_s=1.2) == [(k, k) for k in range(30, 50)]
    # Played as live, they came one or two pictures late, the steps between them uneven.
    begun_ns = time.monotonic_ns() - 2 * 10**9
    monkeypatch.setattr("flightdepth.live.video_stream.LATE_NS", 60 * 10**9)
    with closing(VideoStream(video_address(str(path)), Counter())) as stream:
        played = [each.stamp_ns - begun_ns for each in stream.paced(begun_ns, 0, threading.Event())]
    assert played == [frame.stamp_ns for frame in read(path)]


@pytest.mark.parametrize("part", [{}, {"end_s": 0.4}])
def test_a_raw_stream_is_told_from_a_broken_video(tmp_path, part):
    with pytest.raises(BadInput, match="raw stream without a container"):
        Video(make_video(tmp_path / "v.h264", range(0, 2000, 40)), **part)


def test_a_thumbnail_before_the_video_is_not_the_video(tmp_path):
    """The first stream of pictures was read, though it held a single thumbnail."""
    path = tmp_path / "thumbnail.mp4"
    with av.open(str(path), "w") as container:
        thumbnail, video = (container.add_stream(codec, rate=10) for codec in ("mjpeg", "libx264"))
        thumbnail.width, thumbnail.height, thumbnail.pix_fmt = 32, 16, "yuvj420p"
        video.width, video.height, video.pix_fmt = 64, 32, "yuv420p"
        for stream, shown in ((thumbnail, 1), (video, 8)):
            for number in range(shown):
                grey = np.full((stream.height, stream.width, 3), 100 + 10 * number, np.uint8)
                picture = av.VideoFrame.from_ndarray(grey, format="rgb24")
                picture.pts = number
                container.mux(stream.encode(picture))
            container.mux(stream.encode(None))
    with Video(path) as read_back:
        assert (read_back.size, len(list(read_back.frames()))) == ((64, 32), 8)
    with closing(VideoStream(video_address(str(path)), Counter())) as played:
        first = next(played.paced(time.monotonic_ns(), 0, threading.Event()))
    assert first.rgb().shape == (32, 64, 3)


def test_duration_and_count_are_hinted(tmp_path):
    with Video(make_video(tmp_path / "v.mp4", range(0, 2000, 40))) as video:
        assert video.duration_ns == pytest.approx(2e9, abs=1e8)
        assert video.frame_count_hint == pytest.approx(50, abs=2)


def test_the_hint_counts_the_chosen_part(tmp_path):
    path = make_video(tmp_path / "v.mp4", range(0, 2000, 40))
    with Video(path, start_s=0.5, end_s=1.5) as video:
        assert video.frame_count_hint == pytest.approx(25, abs=1)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no such file"),
        (b"", "an empty file"),
        (b"time,x\n1,2\n" * 9, "a text file"),
        (bytes(5000), "cannot"),
    ],
)
def test_what_is_no_video_is_refused(tmp_path, content, said):
    path = tmp_path / "x.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=said):
        Video(path)


def test_a_title_that_is_not_utf_8_is_no_damage(tmp_path):
    """Found in review: one letter in Latin-1 made a good video a broken one."""
    path = tmp_path / "v.avi"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        container.metadata["title"] = "caf#"
        container.mux(stream.encode(av.VideoFrame(64, 48, "yuv420p")))
        container.mux(stream.encode(None))
    path.write_bytes(path.read_bytes().replace(b"caf#", b"caf\xe9"))
    with Video(path) as video:
        assert video.tags["title"] == "caf\ufffd"
        assert len(list(video.frames())) == 1


def test_a_name_with_a_time_in_it_is_no_address(tmp_path, monkeypatch):
    make_video(tmp_path / "flight-12:30:05.mp4", [0, 40])
    monkeypatch.chdir(tmp_path)
    assert len(read(Path("flight-12:30:05.mp4"))) == 2


def test_text_cut_within_a_character_is_still_text(tmp_path):
    path = tmp_path / "x.txt"
    path.write_bytes(b"a" + ("é" * 3000).encode())  # byte 4096 is half a character
    with pytest.raises(BadInput, match="a text file"):
        Video(path)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(BadInput, match="a folder"):
        Video(tmp_path)


def test_sound_alone_is_refused(tmp_path):
    with pytest.raises(BadInput, match="only sound"):
        Video(make_sound(tmp_path / "x.mp4"))


def test_an_mp4_without_its_index_is_named(uneven):
    data = uneven.read_bytes()
    uneven.write_bytes(data[: data.index(b"moov") - 4])
    with pytest.raises(BadInput, match="cut off"):
        Video(uneven)


def test_pictures_missing_from_a_cut_video_are_counted(tmp_path):
    path = make_video(tmp_path / "v.mp4", range(0, 2000, 40), options={"movflags": "faststart"})
    data = path.read_bytes()
    path.write_bytes(data[: (data.index(b"mdat") + len(data)) // 2])
    with Video(path) as video:
        delivered = len(list(video.frames()))
    assert 0 < delivered < 50
    assert sum(video.counts.values()) == 50 - delivered


def test_what_is_missing_from_a_cut_mkv_is_told(tmp_path):
    """Its head tells how long it was; a cut one ended without a word."""
    path = make_video(tmp_path / "v.mkv", range(500, 8500, 40), stream_options={"g": "10"})
    with Video(path) as video:
        assert len(list(video.frames())) == 200
        assert dict(video.counts) == {}
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with Video(path) as video:
        last_s = list(video.frames())[-1].stamp_ns / 1e9
    assert video.counts["seconds missing at the end of the file"] == pytest.approx(8 - last_s, abs=1)


@pytest.mark.parametrize("part", [{}, {"start_s": 3}])
def test_the_time_that_the_last_picture_is_shown_is_not_missing(tmp_path, part):
    with Video(make_video(tmp_path / "v.mkv", range(0, 20_000, 2000)), **part) as video:
        list(video.frames())
    assert dict(video.counts) == {}


def test_a_whole_video_misses_nothing(uneven):
    with Video(uneven) as video:
        list(video.frames())
    assert dict(video.counts) == {}


def test_hints_outlive_the_file(uneven):
    with Video(uneven) as video:
        pass
    assert video.duration_ns > 0
    assert video.size == (96, 64)


def test_pictures_of_another_size_are_left_out(tmp_path):
    path = tmp_path / "v.ts"
    small = make_video(tmp_path / "a.ts", range(0, 400, 40))
    large = make_video(tmp_path / "b.ts", range(400, 800, 40), width=128)
    path.write_bytes(small.read_bytes() + large.read_bytes())
    with Video(path) as video:
        frames = list(video.frames())
    assert {frame.image.shape for frame in frames} == {(64, 96, 3)}
    assert video.counts["frames of another size than the first"] > 0
    assert [frame.index for frame in frames] == list(range(len(frames)))


def test_a_part_after_the_end_is_refused(uneven):
    with pytest.raises(BadInput, match=r"--start"):
        Video(uneven, start_s=30)


@pytest.mark.parametrize(
    "part",
    [
        {"start_s": -1},
        {"start_s": float("nan")},
        {"start_s": 2, "end_s": 1},
        {"start_s": 1.7e18},  # nanoseconds
        {"end_s": 1e300},
    ],
)
def test_a_part_that_is_none_is_refused(uneven, part):
    with pytest.raises(BadInput):
        Video(uneven, **part)


def test_a_video_without_a_sound_picture_is_refused(uneven):
    data = bytearray(uneven.read_bytes())
    start, end = data.index(b"mdat") + 4, data.index(b"moov") - 4
    data[start:end] = bytes(end - start)
    uneven.write_bytes(data)
    with pytest.raises(BadInput, match="at least one picture"):
        Video(uneven)


def test_damaged_packets_are_counted_and_the_rest_is_read(tmp_path):
    path = make_video(tmp_path / "v.mov", range(0, 2000, 40), codec="png")
    data = bytearray(path.read_bytes())
    at = data.index(b"\x89PNG", len(data) // 2)
    data[at : at + 8] = bytes(8)
    path.write_bytes(data)
    with Video(path) as video:
        frames = list(video.frames())
        assert dict(video.counts) == {"damaged video packets": 1}
    assert len(frames) == 49


def test_after_a_hole_in_the_file_the_rest_is_read(tmp_path):
    """The rest was lost: FFmpeg looks through 64 KB, then wants to be asked again."""
    path = make_video(tmp_path / "v.ts", range(0, 4000, 40), stream_options={"g": "10"}, rate=25)
    data = path.read_bytes()
    middle = len(data) // 376 * 188
    path.write_bytes(data[:middle] + bytes(188 * 1600) + data[middle:])
    with Video(path) as video:
        frames = list(video.frames())
        assert video.counts[GAP] >= 1
    assert frames[-1].stamp_ns == 3_960_000_000
    assert len(frames) >= 88


def test_cut_anywhere_it_reads_or_refuses(tmp_path):
    whole = make_video(tmp_path / "v.mkv", range(0, 400, 40)).read_bytes()
    path = tmp_path / "cut.mkv"
    for size in range(0, len(whole), max(1, len(whole) // 60)):
        path.write_bytes(whole[:size])
        try:
            assert len(read(path)) <= 10
        except BadInput:
            continue


def test_trash_anywhere_it_reads_or_refuses(uneven, tmp_path):
    whole = uneven.read_bytes()
    path = tmp_path / "trash.mp4"
    for seed in range(60):
        rng = random.Random(seed)
        data = bytearray(whole)
        for _ in range(20):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            stamps = [frame.stamp_ns for frame in read(path)]
        except BadInput:
            continue
        assert stamps == sorted(set(stamps))
