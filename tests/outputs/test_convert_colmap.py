"""`flightdepth convert` to a COLMAP project: a folder, where its other kinds are files."""

import errno
import shutil

import cv2
import numpy as np
import pytest
from colmap_model import read_model
from flown_folder import FRAMES, STEP_M, pose, write_flown
from output_samples import HEIGHT, WIDTH

from flightdepth.cli import main
from flightdepth.commands.demo import VIDEO
from flightdepth.flight.video import Video

FINE = ["--every", "1"]
NAMES = {"images", "depths", "sparse", "flightdepth.json"}


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return write_flown(tmp_path_factory.mktemp("flown") / "out").folder


@pytest.fixture
def work(flown, tmp_path):
    shutil.copytree(flown, tmp_path / "out")
    return tmp_path


@pytest.fixture
def convert(work, capsys):
    def call(name="flight.colmap", *options, folder="out"):
        code = main(["convert", str(work / folder), str(work / name), *options])
        stdout, stderr = capsys.readouterr()
        return code, stdout, " ".join(stderr.split())

    return call


def refused(outcome, *words):
    code, _, stderr = outcome
    assert code == 2
    assert [word for word in words if word not in stderr] == []


def left(work):
    return sorted(path.name for path in work.iterdir())


def test_a_project(convert, work):
    code, stdout, stderr = convert("flight.colmap", *FINE)
    model = read_model(work / "flight.colmap/sparse/0")
    assert {path.name for path in (work / "flight.colmap").iterdir()} == NAMES
    assert (code, len(model.images), len(model.points) > 500) == (0, FRAMES - 1, True)
    told = (
        f"flight.colmap: {FRAMES - 1} pictures of {WIDTH}x{HEIGHT} px and {len(model.points):,} points from"
    )
    assert told in stdout
    assert stdout.strip().endswith("metres east, north, up")
    assert (
        f"1 of {FRAMES} pictures are not in it: they show no point of the cloud" in stderr
    )  # the first has no depth


def test_every_so_many_frames_have_a_picture_and_the_cloud_is_as_a_files(convert, work):
    write_flown(work / "longer", frames=30)
    assert convert("few.colmap", "--every", "10", folder="longer")[0] == 0
    model = read_model(work / "few.colmap/sparse/0")
    assert [image.name for image in model.images.values()] == ["000010.jpg", "000020.jpg"]
    _, stdout, _ = convert("cloud.ply", folder="longer")
    assert f": {len(model.points):,} points" in stdout


def test_only_its_own_older_result_is_replaced(convert, work):
    target = work / "flight.colmap"
    (target / "images").mkdir(parents=True)
    (target / "images" / "mine.jpg").write_bytes(b"mine")
    refused(
        convert("flight.colmap", *FINE), "an older one of the same that flightdepth wrote", "holds images"
    )
    assert (target / "images" / "mine.jpg").read_bytes() == b"mine"
    shutil.rmtree(target)
    assert [convert("flight.colmap", *FINE)[0] for _ in range(2)] == [0, 0]
    (target / "sparse_pc.ply").write_bytes(b"a trainer's")
    refused(convert("flight.colmap", *FINE), "holds sparse_pc.ply")


def test_an_empty_folder_is_filled(convert, work):
    (work / "flight.colmap").mkdir()
    assert convert("flight.colmap", *FINE)[0] == 0
    assert left(work) == ["flight.colmap", "out"]


def test_a_place_where_no_folder_can_be(convert, work, monkeypatch):
    (work / "flight.colmap").write_bytes(b"")
    refused(convert(), "expected a folder, got a file")
    refused(convert("nowhere/flight.colmap"), "an existing folder")
    refused(convert("out/flight.colmap"), "a place outside")
    (work / "here.colmap").mkdir()
    monkeypatch.chdir(work / "here.colmap")
    refused(convert("here.colmap"), "can be replaced, got where you are")


def test_a_link_stays_one(convert, work):
    (work / "there").mkdir()
    (work / "flight.colmap").symlink_to(work / "there")
    assert convert("flight.colmap", *FINE)[0] == 0
    assert (work / "flight.colmap").is_symlink()
    assert {path.name for path in (work / "there").iterdir()} == NAMES


@pytest.mark.parametrize("before", [False, True])
def test_after_an_error_all_is_as_it_was(convert, work, monkeypatch, before):
    """A full disk, at the last of its files."""
    if before:
        assert convert("flight.colmap", *FINE)[0] == 0
        held = (work / "flight.colmap/sparse/0/images.bin").read_bytes()
    monkeypatch.setattr("flightdepth.files.os.fsync", full)
    code, _, stderr = convert("flight.colmap", *FINE)
    assert code == 3
    assert "no room left on the disk" in stderr
    assert "nothing of it was written. Free some room" in stderr
    assert left(work) == (["flight.colmap", "out"] if before else ["out"])
    if before:
        assert (work / "flight.colmap/sparse/0/images.bin").read_bytes() == held


def full(descriptor):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_nothing_counts(convert, work):
    refused(convert("flight.colmap", *FINE, "--min-confidence", "1"), "points that count", "--min-confidence")
    assert left(work) == ["out"]


def test_a_flight_without_places_or_without_depth(convert, work):
    write_flown(work / "speed", posed=False)
    refused(convert(folder="speed"), "a log that tells which way the drone flew")
    write_flown(work / "hovered", frames=1)
    refused(convert(folder="hovered"), "a frame with depth")


def test_frames_without_a_place_are_counted(convert, work):
    poses = [pose(i, STEP_M * i, segment=int(i >= FRAMES - 3)) for i in range(FRAMES)]
    write_flown(work / "gap", poses=poses)
    code, stdout, stderr = convert("flight.colmap", *FINE, folder="gap")
    assert (code, f"{FRAMES - 4} pictures" in stdout) == (0, True)
    assert f"3 of {FRAMES} pictures are not in it: attitude unknown, or not of the longest segment" in stderr


def test_axes_that_the_log_does_not_tell(convert, work):
    write_flown(work / "assumed", poses=[pose(i, STEP_M * i, attitude="assumed") for i in range(FRAMES)])
    _, stdout, _ = convert("flight.colmap", *FINE, folder="assumed")
    assert "; north and up are only assumed, since the log tells no attitude" in stdout


def test_a_flight_that_was_interrupted(convert, work):
    folder = write_flown(work / "cut").folder
    shutil.copy(write_flown(work / "short", frames=8).folder / "preview.mp4", folder)
    record = folder / "flight.json"
    record.write_text(record.read_text().replace('"whole": true', '"whole": false'))
    code, stdout, stderr = convert("flight.colmap", *FINE, folder="cut")
    assert (code, "7 pictures of" in stdout) == (0, True)
    assert f"was interrupted: {FRAMES} frames of the flight stand" in stderr
    assert "4 of 12 pictures are not in it: the preview of the interrupted flight ends before them" in stderr


def test_pictures_of_a_smaller_preview_keep_its_size(convert, work, monkeypatch):
    """Made larger they would weigh more, and show no more."""
    monkeypatch.setattr("flightdepth.outputs.preview.MAX_PANEL", (WIDTH // 2, HEIGHT // 2))
    monkeypatch.setattr("flightdepth.outputs.preview.MIN_PANEL_WIDTH", 1)
    write_flown(work / "small")
    code, stdout, _ = convert("flight.colmap", *FINE, folder="small")
    assert (code, "pictures are the preview's, 48x32 of 96x64: --video VIDEO takes" in stdout) == (0, True)
    ((_, width, height, (fx, _, cx, cy)),) = read_model(work / "flight.colmap/sparse/0").cameras.values()
    assert (width, height, cx, cy) == (48, 32, 24, 16)
    assert fx == pytest.approx(24)  # 90 degrees across
    for file in ("images/000004.jpg", "depths/000004.png"):
        assert cv2.imread(str(work / "flight.colmap" / file), cv2.IMREAD_UNCHANGED).shape[:2] == (32, 48)


def test_the_videos_own_pictures(work, sample_flown, capsys):
    """Packed once, by a JPEG of high quality, not by the preview's encoder too."""
    apart = {}
    with Video(VIDEO) as video:
        true = next(frame.image for frame in video.frames() if frame.index == 20).astype(float)
    for name, options in (("preview", []), ("video", ["--video", str(VIDEO)])):
        assert main(["convert", str(sample_flown), str(work / f"{name}.colmap"), *options]) == 0
        shown = cv2.imread(str(work / f"{name}.colmap/images/000020.jpg"))[..., ::-1]
        apart[name] = np.sqrt(np.mean((shown - true) ** 2))
    assert apart["video"] < 0.7 * apart["preview"]
    assert apart["video"] < 4


def test_a_video_that_is_none_of_this_flight(convert, work):
    refused(convert("flight.colmap", "--video", str(VIDEO)), "96x64 px", "640x360 px", "flight.mp4")
    refused(convert("flight.colmap", "--video", str(work / "none.mp4")), "none.mp4")
    assert left(work) == ["out"]


def test_a_video_beside_another_kind(convert):
    refused(
        convert("flight.ply", "--video", str(VIDEO)), "a FILE that ends in .colmap, got one that ends in .ply"
    )


def test_universal_time_beside_a_project(convert):
    refused(convert("flight.colmap", "--utc"), ".mcap or .tum, got one that ends in .colmap")
