import random
import shutil
import struct
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from output_samples import HEIGHT, SOURCE, WIDTH, frame, known

from flightdepth.errors import BadInput
from flightdepth.outputs import FlightFolder, FlightWriter, Preview, read_confidence, read_depth
from flightdepth.outputs.pictures import pictures


@pytest.fixture
def folder(tmp_path):
    with FlightWriter(tmp_path / "out", SOURCE, Preview(WIDTH, HEIGHT)) as writer:
        writer.add(frame(0), known(10))
    return tmp_path / "out"


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        FlightFolder(tmp_path / "nowhere")


def test_a_folder_shows_where_it_is_and_how_much_it_holds(folder):
    assert repr(FlightFolder(folder)) == f"FlightFolder({str(folder)!r}: 1 frames)"


def test_a_missing_frame_is_refused(folder):
    with pytest.raises(BadInput, match=r"000007\.png"):
        FlightFolder(folder).depth_m(7)


def test_an_8_bit_depth_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "depth.png"), np.zeros((4, 4), np.uint8))
    with pytest.raises(BadInput, match=r"depth\.png: expected a grey 16-bit PNG, got uint8 \[4, 4\]"):
        read_depth(tmp_path / "depth.png")


def test_a_colour_confidence_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "confidence.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(BadInput, match=r"confidence\.png: expected a grey 8-bit PNG, got uint8 \[4, 4, 3\]"):
        read_confidence(tmp_path / "confidence.png")


def test_a_head_of_more_pixels_than_opencv_takes_is_refused(tmp_path):
    """Found in review: OpenCV's own error came, with a traceback, where a damaged head told 40,000 x 40,000."""
    path = tmp_path / "depth.png"
    cv2.imwrite(str(path), np.zeros((4, 4), np.uint16))
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 40_000, 40_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    path.write_bytes(data)
    with pytest.raises(BadInput, match=r"depth\.png: expected a PNG"):
        read_depth(path)


@pytest.mark.parametrize("kind", ["depth", "confidence", "sigma", "farther_than"])
def test_a_map_of_another_size_than_the_pictures_is_refused(folder, kind):
    """A resized one ended `convert` with an IndexError, or went into a recording beside a camera of another size."""
    flight = FlightFolder(folder)
    (folder / kind).mkdir(exist_ok=True)
    small = np.full((HEIGHT // 2, WIDTH // 2), 200, np.uint8 if kind == "confidence" else np.uint16)
    cv2.imwrite(str(folder / kind / "000000.png"), small)
    read = {"depth": flight.depth_m, "confidence": flight.confidence, "sigma": flight.sigma_m}
    with pytest.raises(BadInput, match=r"000000\.png: expected \[64, 96\], .*, got \[32, 48\]"):
        read.get(kind, flight.farther_than_m)(0)


def test_what_is_no_folder_says_which_to_give(tmp_path):
    """Of a video it said "flight.mp4/flight.json: got Not a directory"."""
    video = tmp_path / "flight.mp4"
    video.write_bytes(b"")
    with pytest.raises(BadInput, match=r"flight\.mp4: expected .* writes, got a file\. First .* give DIR"):
        FlightFolder(video)
    with pytest.raises(BadInput, match=r"flight\.json: expected .* writes, got No such file .* give DIR"):
        FlightFolder(tmp_path)


def test_a_record_with_an_unknown_field_is_refused(folder):
    path = folder / "flight.json"
    path.write_text(path.read_text().replace('"flightdepth"', '"flightdeath"'))
    with pytest.raises(BadInput, match=r"flight folder .*flight\.json: expected what .* writes, got "):
        FlightFolder(folder)


@pytest.mark.parametrize("name", ["flight.json", "frames.csv"])
@pytest.mark.parametrize("seed", range(20))
def test_trash_in_the_texts_is_refused_or_read(folder, name, seed):
    data = bytearray((folder / name).read_bytes())
    rng = random.Random(seed)
    for _ in range(3):
        data[rng.randrange(len(data))] = rng.randrange(256)
    (folder / name).write_bytes(data)
    try:
        rows = FlightFolder(folder).rows
    except BadInput:
        return
    assert len(rows) <= 2


@pytest.mark.parametrize("suffix", [".png", ".npz"])
@pytest.mark.parametrize("size", [0, 1, 7, 60, 200])
def test_a_cut_depth_file_is_refused(tmp_path, suffix, size):
    depth_format = suffix[1:]
    ramp = np.arange(HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH) / 50
    with FlightWriter(tmp_path / "out", SOURCE, Preview(WIDTH, HEIGHT), depth_format=depth_format) as writer:
        writer.add(frame(0), known(ramp))
    path = tmp_path / "out" / "depth" / f"000000{suffix}"
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(BadInput):
        read_depth(path)


@pytest.mark.parametrize(
    ("at", "value"),
    [(6, 99), (8, 1), (10, 99)],
    ids=["a later version of zip", "encrypted", "another compression"],
)
def test_an_npz_whose_directory_is_damaged_is_refused(tmp_path, at, value):
    """One such byte ended `view` and `convert` with a traceback."""
    path = tmp_path / "depth.npz"
    np.savez(path, depth_m=np.ones((HEIGHT, WIDTH), np.float32))
    data = bytearray(path.read_bytes())
    data[data.rfind(b"PK\x01\x02") + at] = value
    path.write_bytes(data)
    with pytest.raises(BadInput, match=r"depth\.npz: expected an \.npz with depth_m"):
        read_depth(path)


def test_an_npz_of_another_map_is_refused(tmp_path):
    np.savez(tmp_path / "depth.npz", sigma_m=np.ones((HEIGHT, WIDTH), np.float32))
    with pytest.raises(BadInput, match=r"depth\.npz: expected an \.npz with depth_m"):
        read_depth(tmp_path / "depth.npz")


def test_a_lone_array_is_no_npz(tmp_path):
    with (tmp_path / "depth.npz").open("wb") as file:
        np.save(file, np.ones((HEIGHT, WIDTH), np.float32))
    with pytest.raises(BadInput, match=r"depth\.npz: expected an \.npz with depth_m"):
        read_depth(tmp_path / "depth.npz")


@pytest.mark.parametrize("name", ["frames.csv", "poses.csv"])
@pytest.mark.parametrize(
    "line",
    ["0", "0,7", "0,north", '0,"' + 140_000 * "x", "\xff"],
    ids=["short", "shorter", "word", "quote", "bytes"],
)
def test_a_broken_table_is_named(folder, name, line):
    """A quotation mark makes one cell of all that follows, and `csv` takes none of more than 131,072 characters."""
    table = folder / name
    header = table.read_bytes().splitlines()[0]
    table.write_bytes(header + b"\n" + line.encode("latin-1") + b"\n")
    with pytest.raises(
        BadInput, match=rf"flight folder .*{name}: expected what .* writes, got a broken table"
    ):
        FlightFolder(folder)


def test_a_table_without_a_column_that_each_has_is_refused(folder):
    table = folder / "frames.csv"
    table.write_text(table.read_text().replace("shifts", "shifty"))
    with pytest.raises(BadInput, match=r"frames\.csv: .*got a broken table \('shifts'\)"):
        FlightFolder(folder)


def test_a_folder_without_its_table_is_refused(folder):
    (folder / "frames.csv").unlink()
    with pytest.raises(BadInput, match=r"frames\.csv: expected .*, got No such file"):
        FlightFolder(folder)


def test_a_folder_of_an_older_version_tells_no_poses(folder):
    (folder / "poses.csv").unlink()
    flight = FlightFolder(folder)
    assert flight.poses == {}
    assert len(flight.rows) == 1


# What a kill or a loss of power leaves of a flight that cannot be flown again.


@pytest.fixture
def left(tmp_path):
    """A folder as it stands in flight, 20 frames of it, five a second."""
    with pytest.raises(KeyboardInterrupt), writer_once(tmp_path / "out") as writer:
        for i in range(20):
            writer.add(replace(frame(i), stamp_ns=200_000_000 * i), known(10 + i))
        writer._files.finish()
        writer._pictures.finish()
        shutil.copytree(writer._folder, tmp_path / "left")
        raise KeyboardInterrupt
    return tmp_path / "left"


def writer_once(target):
    return FlightWriter(target, SOURCE, Preview(WIDTH, HEIGHT), once=True)


def test_a_killed_flight_is_read(left):
    flight = FlightFolder(left)
    assert not flight.record.whole
    assert len(flight.rows) == flight.record.counts.frames == 20
    assert flight.depth_m(19).min() == pytest.approx(29, abs=0.01)


@pytest.mark.parametrize("name", ["depth", "confidence"])
@pytest.mark.parametrize("data", [b"", None], ids=["empty", "missing"])
def test_it_ends_before_a_map_that_did_not_come_to_the_disk(left, name, data):
    file = left / name / "000012.png"
    file.unlink()
    if data is not None:
        file.write_bytes(data)
    assert [row.index for row in FlightFolder(left).rows] == list(range(12))


@pytest.mark.parametrize("name", ["sigma", "farther_than", "nearer_than"])
def test_it_ends_before_an_error_bar_or_a_bound_that_did_not_come_to_the_disk(left, name):
    """Depth stood there, so the frame did; `convert` to .bt then ended with an error at that file."""
    (left / name).mkdir()
    (left / name / "000012.png").touch()
    assert [row.index for row in FlightFolder(left).rows] == list(range(12))


def test_it_ends_before_an_exact_error_bar_that_did_not_come_to_the_disk(tmp_path):
    wide = replace(known(10), sigma_m=np.ones((HEIGHT, WIDTH), np.float32))
    with (
        pytest.raises(KeyboardInterrupt),
        FlightWriter(
            tmp_path / "out", SOURCE, Preview(WIDTH, HEIGHT), depth_format="npz", stopped=True
        ) as writer,
    ):
        for i in range(4):
            writer.add(frame(i), wide)
        raise KeyboardInterrupt
    (writer.kept / "sigma" / "000002.npz").write_bytes(b"")
    assert [row.index for row in FlightFolder(writer.kept).rows] == [0, 1]


@pytest.mark.parametrize("lost", [1, 5, 30])
def test_a_last_line_that_was_cut_off_is_left_out(left, lost):
    table = left / "frames.csv"
    table.write_bytes(table.read_bytes()[:-lost])
    assert len(FlightFolder(left).rows) in (18, 19)


def test_a_whole_flight_whose_table_was_cut_off_is_refused(folder):
    table = folder / "frames.csv"
    table.write_bytes(table.read_bytes()[:-20])
    with pytest.raises(BadInput, match="broken table"):
        FlightFolder(folder)


def test_its_pictures_are_shown_until_its_film_ends(left):
    """The film comes to the disk in pieces of a second, and a loss of power cuts it anywhere."""
    film = left / "preview.mp4"
    data = film.read_bytes()
    seen = []
    for share in (1, 0.8, 0.6):
        film.write_bytes(data[: int(len(data) * share)])
        seen.append([index for index, _ in pictures(FlightFolder(left))])
    assert all(indices == list(range(len(indices))) for indices in seen)
    assert len(seen[0]) >= 10
    assert len(seen[0]) > len(seen[1]) > len(seen[2]) > 0


def test_without_a_film_it_is_refused(left):
    flight = FlightFolder(left)
    (left / "preview.mp4").unlink()
    with pytest.raises(BadInput, match=r"preview of this flight.*only \.bt needs no preview"):
        list(pictures(flight))
