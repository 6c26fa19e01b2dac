import struct
import threading
from collections import Counter
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from flight_files import make_video
from hypothesis import given
from hypothesis import strategies as st
from photograph_files import photograph

from flightdepth.errors import BadInput
from flightdepth.flight import Frame, open_flight
from flightdepth.flight.cameras import choose_camera
from flightdepth.flight.flight_log import choose_telemetry
from flightdepth.flight.picture_folder import DAMAGED, LEFT_OUT, NOT_LATER, PictureFolder
from flightdepth.flight.picture_names import by_number, by_time, pictures_in
from flightdepth.flight.still import decoded, turn_in
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.flight.video import Video

SAMPLE = Path(__file__).parents[2] / "src" / "flightdepth" / "sample" / "flight.mp4"
MS, S = 1_000_000, 1_000_000_000
EUROC_NS = 1_403_636_579_763_555_584
KINDS = ("png", "jpg", "bmp", "tif", "webp", "ppm", "pgm")


def picture(grey, size=(64, 48)):
    """Grey, with a mark in the top left corner."""
    image = np.full((size[1], size[0], 3), grey, np.uint8)
    image[: size[1] // 4, : size[0] // 4] = 250
    return image


def textured(size=(96, 64)):
    noise = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2)


def encoded(image, kind="png"):
    done, data = cv2.imencode(f".{kind}", image[..., 0] if kind == "pgm" else image)
    assert done
    return data.tobytes()


def fill(folder, names):
    """A picture for each name, each 10 levels of grey brighter, in the order that is given."""
    folder.mkdir(exist_ok=True)
    for index, name in enumerate(names):
        (folder / name).write_bytes(encoded(picture(10 * index), Path(name).suffix[1:].lower()))
    return folder


def read(path, **part):
    with Video(path, **part) as video:
        return list(video.frames())


def greys(frames):
    return [round(float(frame.image[24:, 32:].mean()) / 10) for frame in frames]


def refused(path, **part):
    """The one line with which it is refused."""
    with pytest.raises(BadInput) as caught:
        Video(path, **part)
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


# The law


def test_the_pictures_of_a_video_are_the_video(tmp_path):
    own = read(SAMPLE, end_s=0.4)
    for frame in own:
        (tmp_path / f"{frame.index}.png").write_bytes(encoded(frame.image[..., ::-1]))
    told = read(tmp_path, rate_hz=30)
    assert len(told) == len(own) == 12
    for ours, theirs in zip(told, own, strict=True):
        assert abs(ours.stamp_ns - theirs.stamp_ns) <= 1
        assert np.array_equal(ours.image, theirs.image)
        assert (ours.index, ours.picture) == (theirs.index, f"{theirs.index}.png")


# Order and times


def test_pictures_come_in_the_order_of_their_numbers(tmp_path):
    fill(tmp_path, [f"left_{number}.png" for number in range(9, 21)])
    assert greys(read(tmp_path, rate_hz=10)) == list(range(12))


@given(st.sets(st.integers(0, 10**12), min_size=2), st.integers(0, 14), st.randoms())
def test_any_numbers_are_in_order_however_they_are_padded(numbers, digits, chance):
    names = {f"a1_{number:0{digits}}.b.png": number for number in sorted(numbers)}
    shuffled = chance.sample(list(names), len(names))
    assert [named.name for named in by_number(Path("x"), shuffled)] == list(names)


@pytest.mark.parametrize(
    "names",
    [
        ["1403636579763555584", "1403636579813555456", "1403636579863555584"],
        ["1403636579763555", "1403636579813555", "1403636579863555"],
        ["1403636579763", "1403636579813", "1403636579863"],
        ["1403636579.763555", "1403636579.813555", "1403636579.863555"],
        ["1403636579.7", "1403636579.75", "1403636579.8"],
        ["img__0_1403636579763555584", "img__0_1403636579813555456", "img__0_1403636579863555584"],
    ],
    ids=["EuRoC", "microseconds", "milliseconds", "TUM", "few decimals", "AirSim"],
)
def test_names_that_are_times_tell_them(tmp_path, names):
    fill(tmp_path, [f"{name}.png" for name in names])
    frames = read(tmp_path)
    assert greys(frames) == [0, 1, 2]
    assert [frame.stamp_ns for frame in frames] == pytest.approx([0, 50 * MS, 100 * MS], abs=200)
    with Video(tmp_path) as video:
        assert video.utc.at(0) == pytest.approx(EUROC_NS, abs=S // 10)
        assert video.duration_ns == pytest.approx(150 * MS, abs=300)


def test_nanoseconds_in_names_are_exact():
    names = ["1403636579.763555584.png", "1403636579.8.png"]
    assert [named.number for named in by_time(names)] == [EUROC_NS, 1_403_636_579_800_000_000]


@pytest.mark.parametrize(
    "name",
    [
        "0000000000001",
        "0000000000000000001",
        "1000000000000",
        "1234567890",
        "9999999999999999999",
        "20140624190259",
        "2014062419025917",
    ],
)
def test_numbers_that_are_no_time_of_a_flight_are_none(name):
    assert by_time([f"{name}.png"]) is None


def test_a_time_that_comes_twice_is_left_out_and_counted(tmp_path):
    fill(tmp_path, ["1403636579.70.png", "1403636579.7.png", "1403636579.8.png"])
    with Video(tmp_path) as video:
        assert [frame.stamp_ns for frame in video.frames()] == [0, 100 * MS]
        assert video.counts == {NOT_LATER: 1}


def test_where_numbers_are_left_out_time_passes(tmp_path):
    fill(tmp_path, ["000004.png", "000005.png", "000008.png"])
    with Video(tmp_path, rate_hz=10) as video:
        assert [frame.stamp_ns // MS for frame in video.frames()] == [0, 100, 400]
        assert video.counts == {LEFT_OUT: 2}


def test_numbers_may_count_by_tens(tmp_path):
    fill(tmp_path, ["10.png", "20.png", "40.png"])
    with Video(tmp_path, rate_hz=3) as video:
        assert [frame.stamp_ns for frame in video.frames()] == [0, 333_333_333, S]
        assert video.counts == {LEFT_OUT: 1}


def test_one_picture_is_a_series(tmp_path):
    assert [frame.stamp_ns for frame in read(fill(tmp_path, ["a7_1.png"]), rate_hz=10)] == [0]


def test_start_is_included_and_end_is_not(tmp_path):
    fill(tmp_path, [f"{number}.png" for number in range(20)])
    frames = read(tmp_path, rate_hz=10, start_s=0.5, end_s=0.9)
    assert greys(frames) == [5, 6, 7, 8]
    assert [frame.stamp_ns // MS for frame in frames] == [500, 600, 700, 800]
    assert [frame.index for frame in frames] == [0, 1, 2, 3]
    with Video(tmp_path, rate_hz=10, start_s=0.5, end_s=0.9) as video:
        assert (video.frame_count_hint, video.duration_ns) == (4, 2 * S)
    assert "got a video of 2.000 s" in refused(tmp_path, rate_hz=10, start_s=5)


def test_another_pass_has_the_same_rate(tmp_path):
    with (
        Video(fill(tmp_path, ["1.png", "2.png", "3.png"]), rate_hz=10) as video,
        video.again(start_s=0.1) as other,
    ):
        assert [frame.stamp_ns // MS for frame in other.frames()] == [100, 200]


# What lies in the folder


def test_other_files_are_left_alone(tmp_path):
    fill(tmp_path, ["1.PNG", "2.png", ".3.png"])
    for name in ("times.txt", "log.csv", "data.json", "Thumbs.db"):
        (tmp_path / name).write_text("1.0\n")
    fill(tmp_path / "4.png", ["5.png"])
    assert greys(read(tmp_path, rate_hz=10)) == [0, 1]


def test_names_may_hold_anything(tmp_path):
    fill(tmp_path / "d'été %d", ["l'été %03d 1.png", "l'été %03d 2.png"])
    assert greys(read(tmp_path / "d'été %d", rate_hz=10)) == [0, 1]


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_picture_is_read(tmp_path, kind):
    fill(tmp_path, [f"{number}.{kind}" for number in range(5)])
    assert greys(read(tmp_path, rate_hz=10)) == list(range(5))


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_that_is_cut_off_is_none(kind):
    data = encoded(textured(), kind)
    assert decoded(data) is not None
    for size in [0, 1, 2, 8, 20, *(len(data) * share // 100 for share in (10, 30, 50, 70, 90, 98))]:
        assert decoded(data[:size]) is None, size


def test_a_jpeg_that_is_cut_off_behind_its_thumbnail_is_none():
    data = encoded(textured(), "jpg")
    app1 = b"\xff\xe1" + struct.pack(">H", len(data) + 2) + data
    whole = data[:2] + app1 + data[2:]
    assert decoded(whole) is not None
    assert decoded(whole + data + b"more") is not None
    assert decoded(whole[:-20]) is None


def test_trash_within_a_png_is_found():
    data, chance = encoded(textured((48, 32))), np.random.default_rng(1)
    for _ in range(20):
        at = int(chance.integers(len(data) // 2, len(data) - 60))
        assert decoded(data[:at] + chance.bytes(40) + data[at + 40 :]) is None, at


def test_trash_at_a_head_raises_nothing():
    chance = np.random.default_rng(2)
    for kind in KINDS:
        data = bytearray(encoded(textured(), kind))
        for _ in range(50):
            data[int(chance.integers(0, 64))] = int(chance.integers(256))
            decoded(bytes(data))
            turn_in(bytes(data))


@pytest.mark.parametrize(
    "damage",
    [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: b"version https://git-lfs\n"],
    ids=["cut off", "empty", "a pointer to a picture"],
)
@pytest.mark.parametrize("kind", ["png", "jpg"])
def test_a_damaged_picture_is_left_out_alone(tmp_path, kind, damage):
    fill(tmp_path, [f"{number}.{kind}" for number in range(5)])
    (tmp_path / f"2.{kind}").write_bytes(damage((tmp_path / f"2.{kind}").read_bytes()))
    with Video(tmp_path, rate_hz=10) as video:
        frames = list(video.frames())
        assert video.counts == {DAMAGED: 1}
    assert greys(frames) == [0, 1, 3, 4]
    assert [frame.stamp_ns // MS for frame in frames] == [0, 100, 300, 400]
    assert [frame.index for frame in frames] == [0, 1, 2, 3]
    assert not any(frame.after_damage for frame in frames)


def test_time_counts_from_the_first_picture_even_where_that_is_damaged(tmp_path):
    fill(tmp_path, ["1.png", "2.png"])
    (tmp_path / "1.png").write_bytes(b"")
    assert [frame.stamp_ns // MS for frame in read(tmp_path, rate_hz=10)] == [100]


def test_a_link_that_leads_nowhere_is_a_damaged_picture(tmp_path):
    fill(tmp_path, ["1.png", "2.png"])
    (tmp_path / "3.png").symlink_to("gone.png")
    with Video(tmp_path, rate_hz=10) as video:
        assert len(list(video.frames())) == 2
        assert video.counts == {DAMAGED: 1}
        assert video.size_bytes == sum((tmp_path / name).stat().st_size for name in ("1.png", "2.png"))


def test_pictures_of_another_size_are_left_out(tmp_path):
    fill(tmp_path, ["1.png", "2.png", "3.png"])
    (tmp_path / "2.png").write_bytes(encoded(picture(0, (48, 64))))
    with Video(tmp_path, rate_hz=10) as video:
        assert greys(video.frames()) == [0, 2]
        assert video.counts == {"frames of another size than the first": 1}


# What a picture may be


def with_exif(jpeg, orientation):
    tiff = struct.pack(">2sHIHHHIHHI", b"MM", 42, 8, 1, 0x112, 3, 1, orientation, 0, 0)
    block = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:]


@pytest.mark.parametrize("orientation", range(10))
def test_pictures_are_turned_upright_as_their_exif_tags_say(tmp_path, orientation):
    data = with_exif(encoded(textured(), "jpg"), orientation)
    (tmp_path / "1.jpg").write_bytes(data)
    with Video(tmp_path, rate_hz=10) as video:
        [frame] = video.frames()
        assert video.size == frame.image.shape[1::-1]
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert frame.image.shape == expected.shape
    assert np.abs(frame.image.astype(int) - expected).mean() < 3


def test_pictures_that_are_turned_otherwise_are_of_another_size(tmp_path):
    upright = encoded(picture(0), "jpg")
    (tmp_path / "1.jpg").write_bytes(upright)
    (tmp_path / "2.jpg").write_bytes(with_exif(upright, 6))
    with Video(tmp_path, rate_hz=10) as video:
        assert len(list(video.frames())) == 1
        assert video.counts == {"frames of another size than the first": 1}


def test_a_motion_jpeg_whose_pictures_have_tags_is_read(tmp_path):
    """It ended in a traceback: PyAV 18 cannot list what a decoder gives beside such a picture."""
    path = tmp_path / "tagged.avi"
    data = with_exif(encoded(textured(), "jpg"), 1)
    with av.open(path, "w") as container:
        stream = container.add_stream("mjpeg", rate=10, width=96, height=64, pix_fmt="yuvj420p")
        for number in range(3):
            packet = av.Packet(data)
            packet.stream, packet.time_base, packet.pts, packet.dts = stream, Fraction(1, 10), number, number
            container.mux(packet)
    with Video(path) as video:
        assert [frame.image.shape for frame in video.frames()] == [(64, 96, 3)] * 3


def test_tags_that_are_cut_off_turn_nothing():
    data = with_exif(b"\xff\xd8", 6)
    for size in range(len(data) - 6):
        assert turn_in(data[:size]).quarter_turns == 0


@pytest.mark.parametrize(
    "image",
    [
        np.full((48, 64), 100 * 257, np.uint16),
        np.full((48, 64, 3), 100 * 257, np.uint16),
        np.full((48, 64, 4), (100, 100, 100, 7), np.uint8),
        np.full((48, 64), 100, np.uint8),
    ],
    ids=["grey of 16 bits", "colour of 16 bits", "alpha", "grey"],
)
def test_what_is_no_colour_of_8_bits_is_made_one(tmp_path, image):
    (tmp_path / "1.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    [frame] = read(tmp_path, rate_hz=10)
    assert np.abs(frame.image.astype(int) - 100).max() <= 1


def test_a_picture_whose_name_lies_of_its_kind_is_read(tmp_path):
    (tmp_path / "1.png").write_bytes(encoded(picture(100), "jpg"))
    assert greys(read(tmp_path, rate_hz=10)) == [10]


# What is refused


def test_what_run_wrote_is_no_flight(tmp_path):
    """Its masks are pictures, and the advice was to run on its maps."""
    for name in ("flight.json", "mask.png"):
        (tmp_path / name).touch()
    with pytest.raises(BadInput, match=r"got what `run` wrote of one.*flightdepth view"):
        pictures_in(tmp_path)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], ["got a folder without files", "or a video"]),
        (["1.mp4.txt"], ["got a folder of 1 other files"]),
        (["1.png", "2.jpg", "3.jpg"], ["2 .jpg and 1 .png", "a folder of its own"]),
        (["left_1.png", "right_1.png"], ["left_1.png and right_1.png among 2"]),
        (["1_1.png", "1_2.png", "2_1.png"], ["1_1.png and 2_1.png among 3"]),
        (["a.png", "b.png"], ["a.png and b.png"]),
        (["l_1403636579763555584.png", "r_1403636579763555584.png"], ["l_1403636579763555584.png"]),
        (["0000000.000.png", "0000016.667.png"], ["0000000.000.png and 0000016.667.png"]),
        (["0.png", "33333334.png", "66666667.png"], ["3 numbered 0 to 66666667", "19 digits"]),
    ],
)
def test_what_is_no_series_is_refused(tmp_path, names, words):
    for name in names:
        (tmp_path / name).write_bytes(b"")
    told = refused(tmp_path, rate_hz=10)
    assert [word for word in words if word not in told] == []


def test_folders_among_which_the_pictures_lie_are_named(tmp_path):
    for name in ("rgb", "depth", ".hidden"):
        (tmp_path / name).mkdir()
    assert refused(tmp_path).endswith("Give the folder in which they lie (here are depth, rgb), or a video.")


def test_of_many_folders_some_are_named(tmp_path):
    for number in range(8):
        (tmp_path / f"seq{number}").mkdir()
    assert "(here are seq0, seq1, seq2, seq3, seq4 and 3 more)" in refused(tmp_path)


def test_names_without_times_need_a_rate(tmp_path):
    assert refused(fill(tmp_path, ["1.png", "2.png"])).endswith(": --rate HZ.")


def test_names_that_are_times_need_none(tmp_path):
    assert refused(fill(tmp_path, [f"{EUROC_NS}.png"]), rate_hz=20).startswith("--rate: expected pictures")


def test_a_video_needs_no_rate(tmp_path):
    assert refused(make_video(tmp_path / "v.mp4", [0, 40]), rate_hz=25).startswith(
        "--rate: expected a folder"
    )
    assert "no such file" in refused(tmp_path / "none.mp4", rate_hz=25)


@pytest.mark.parametrize("rate_hz", [0, -1, 1e-9, 1e9, float("nan"), float("inf")])
def test_no_camera_has_such_a_rate(tmp_path, rate_hz):
    assert refused(fill(tmp_path, ["1.png", "2.png"]), rate_hz=rate_hz).startswith("--rate: expected 0.001")


def test_pictures_of_which_none_can_be_read_are_refused(tmp_path):
    (tmp_path / "1.png").write_bytes(b"no picture")
    assert "at least one picture" in refused(tmp_path, rate_hz=10)


# As a flight

ROWS = ["time_s,vn_m_s,ve_m_s,vd_m_s", *(f"{t / 10:.1f},3.0,0.0,0.0" for t in range(8))]


@pytest.mark.parametrize("name", ["images", "images.v2"])
def test_a_log_of_the_folders_name_beside_it_is_its_log(tmp_path, monkeypatch, name):
    folder = fill(tmp_path / name, ["1.png", "2.png", "3.png"])
    (tmp_path / f"{name}.csv").write_text("\n".join(ROWS) + "\n")
    monkeypatch.chdir(folder)
    for path in (folder, "."):
        with open_flight(path, hfov_deg=90, rate_hz=10) as flight:
            assert flight.telemetry_name.startswith(f"CSV {name}.csv")
            assert flight.video_bytes == sum(file.stat().st_size for file in folder.iterdir())
            assert [event.picture for event in flight if isinstance(event, Frame)] == [
                "1.png",
                "2.png",
                "3.png",
            ]


def test_a_folder_without_a_log_asks_for_one(tmp_path):
    folder = fill(tmp_path / "images", ["1.png", "2.png"])
    with pytest.raises(BadInput, match="no log beside it whose name is images and an ending"):
        open_flight(folder, hfov_deg=90, rate_hz=10)


POSES = [
    f"{1403636579.5 + t / 10:.3f} {0.3 * t:.2f} 0 0 0 0 0 1" for t in range(20)
]  # forward is not the point


def test_pictures_and_poses_of_one_clock_meet_by_their_times(tmp_path):
    folder = fill(tmp_path / "rgb", [f"{1403636579.763555 + t / 20:.6f}.png" for t in range(8)])
    (tmp_path / "groundtruth.txt").write_text("\n".join(POSES) + "\n")
    with open_flight(folder, tmp_path / "groundtruth.txt", hfov_deg=90) as flight:
        assert not flight.begun_together
        assert flight.utc == UniversalTime(1_403_636_579_763_555_000, "names")
        assert "; moved by -0.264 s to the times that the pictures' names tell" in flight.telemetry_name
        assert not any("clock" in line for line in flight.warnings)
        stamps = [event.stamp_ns for event in flight if not isinstance(event, Frame)]
    assert min(stamps) == pytest.approx((1403636579.5 - 1403636579.763555) * S, abs=S // 10)
    assert all(early <= late for early, late in pairwise(stamps))


def test_a_log_that_counts_from_the_first_picture_stays(tmp_path):
    folder = fill(tmp_path / "rgb", [f"{EUROC_NS + t * 50 * MS}.png" for t in range(8)])
    rows = [f"{row},{'utc_ns' if row.startswith('time_s') else EUROC_NS + 5 * S}" for row in ROWS]
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    with Video(folder) as video:
        log, _ = choose_telemetry(video, tmp_path / "log.csv", None, 0.0)
    assert log.span_ns == (0, 700 * MS)
    with open_flight(folder, tmp_path / "log.csv", hfov_deg=90) as flight:
        (told,) = [line for line in flight.warnings if "by its name" in line]
    assert told.startswith("at the first picture it was 2014-06-24T19:02:59.763Z by its name")
    assert told.endswith("by the column of the log, 4.6 s apart")


def test_a_table_whose_times_count_from_1970_meets_pictures_of_one_clock(tmp_path):
    folder = fill(tmp_path / "rgb", [f"{EUROC_NS + t * 50 * MS}.png" for t in range(8)])
    rows = [f"{EUROC_NS - S + t * 100 * MS},1,0,0" for t in range(30)]
    (tmp_path / "log.csv").write_text("\n".join(["stamp_ns,vn_m_s,ve_m_s,vd_m_s", *rows]) + "\n")
    alone = read_telemetry(tmp_path / "log.csv")
    assert alone.span_ns == (0, 2900 * MS) and alone.utc == UniversalTime(EUROC_NS - S, "computer")
    assert "; its time 0 is 1403636578.764 s of its clock" in alone.name and not alone.time_0_told
    with open_flight(folder, tmp_path / "log.csv", hfov_deg=90) as flight:
        assert next(iter(flight)).stamp_ns == -S


@pytest.mark.parametrize(("ahead_ms", "told"), [(3000, ["3.0 s apart"]), (200, [])])
def test_satellites_beside_it_do_not_move_it_off_that_clock(tmp_path, ahead_ms, told):
    """Pictures and rows stamped by one computer, and what the receiver said beside it: it came 3 s wrong."""
    folder = fill(tmp_path / "rgb", [f"{EUROC_NS + t * 50 * MS}.png" for t in range(8)])
    stamps_ns = [EUROC_NS - S + t * 100 * MS for t in range(30)]
    rows = [f"{stamp_ns},1,0,0,{stamp_ns + ahead_ms * MS}" for stamp_ns in stamps_ns]
    (tmp_path / "log.csv").write_text("\n".join(["stamp_ns,vn_m_s,ve_m_s,vd_m_s,utc_ns", *rows]) + "\n")
    with open_flight(folder, tmp_path / "log.csv", hfov_deg=90) as flight:
        assert [line[-11:] for line in flight.warnings if "by its name" in line] == told
        assert not any("as if" in line for line in flight.warnings)
        assert next(iter(flight)).stamp_ns == -S


def test_two_clocks_that_are_taken_to_agree_are_told(tmp_path):
    folder = fill(tmp_path / "rgb", [f"{EUROC_NS + t * 50 * MS}.png" for t in range(8)])
    seconds = ("02:58", "02:59", "03:00", "03:01", "03:02")
    points = [
        f'<trkpt lat="{47 + t * 1e-4:.6f}" lon="8"><ele>9</ele><time>2014-06-24T19:{second}Z</time></trkpt>'
        for t, second in enumerate(seconds)
    ]
    (tmp_path / "track.gpx").write_text(f"<gpx><trk><trkseg>{''.join(points)}</trkseg></trk></gpx>")
    with open_flight(folder, tmp_path / "track.gpx", hfov_deg=90) as flight:
        (told,) = [line for line in flight.warnings if "brought together" in line]
    assert "as if the log's clock (track) and that of the pictures' names agreed" in told


def test_a_closed_folder_gives_no_more_and_leaves_no_thread(tmp_path):
    fill(tmp_path, [f"{k}.png" for k in range(20)])
    with Video(tmp_path, rate_hz=10) as video:
        frames = video.frames()
        next(frames)
        assert any(thread.name.startswith("pictures") for thread in threading.enumerate())
    assert list(frames) == []
    assert not any(thread.name.startswith("pictures") for thread in threading.enumerate())


def test_what_exif_tags_tell_of_the_lens_is_named_not_taken(tmp_path):
    photograph(tmp_path / "1.jpg", equivalent_mm=24)
    with Video(tmp_path, rate_hz=10) as video, pytest.raises(BadInput, match=r"Likely: --hfov 76\.\d"):
        choose_camera(video, None, None)


def test_a_calibration_without_a_size_is_of_the_pictures(tmp_path):
    fill(tmp_path, ["1.png"])
    matrix = "718.856 0 {} 0 0 718.856 {} 0 0 0 1 0"
    with Video(tmp_path, rate_hz=10) as video:
        width, height = video.size
        (tmp_path / "calib.txt").write_text(f"P0: {matrix.format(width / 2, height / 2)}\n")
        camera = choose_camera(video, tmp_path / "calib.txt", None).camera
    assert (camera.width, camera.height, camera.fx) == (width, height, 718.856)


def test_a_folder_read_by_itself_counts_what_it_leaves_out(tmp_path):
    fill(tmp_path, ["1.png", "2.png", "4.png"])
    counts = Counter()
    assert len(list(PictureFolder(tmp_path, 10).pictures(0, counts))) == 3
    assert counts == {LEFT_OUT: 1}
