"""`flightdepth convert` on a folder written by hand."""

import errno
import shutil
import sys

import laspy
import octomap
import pytest
from flown_folder import FRAMES, STEP_M, pose, write_flown
from rosbags.highlevel import AnyReader

from flightdepth.cli import main
from flightdepth.weights.card import NetworkCard

COARSE = ["--every", "1", "--voxel", "2"]  # a map of finer cells takes seconds


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    write_flown(folder / "out")
    return folder


@pytest.fixture
def convert(work, capsys):
    def call(name, *options, folder="out"):
        code = main(["convert", str(work / folder), str(work / name), *options])
        return code, *capsys.readouterr()

    return call


def test_a_cloud_as_ply(convert, work):
    code, stdout, _ = convert("flight.ply", "--every", "1")
    assert code == 0
    count = int((work / "flight.ply").read_bytes().split(b"element vertex ")[1].split()[0])
    assert count > 500
    assert f"{count:,} points" in stdout


@pytest.mark.parametrize("kind", ["ply", "las", "bt", "mcap"])
def test_only_its_own_older_result_is_replaced(convert, work, kind):
    """Found in review: any file was, a flight's own recording too."""
    target = work / f"again.{kind}"
    target.write_bytes(b"\x89MCAP0\r\n of somebody else")
    code, _, stderr = convert(target.name)
    assert (code, target.read_bytes()) == (2, b"\x89MCAP0\r\n of somebody else")
    assert "a new file, or an older one of the same that flightdepth wrote" in stderr
    target.unlink()
    options = [] if kind == "mcap" else COARSE
    assert [convert(target.name, *options)[0] for _ in range(2)] == [0, 0]


def test_a_flight_that_was_interrupted_is_converted_with_a_warning(convert, work):
    record = write_flown(work / "part").folder / "flight.json"
    record.write_text(record.read_text().replace('"whole": true', '"whole": false'))
    code, stdout, stderr = convert("part.ply", "--every", "1", folder="part")
    assert (code, "points from" in stdout) == (0, True)
    assert f"part was interrupted: {FRAMES} frames of the flight stand" in " ".join(stderr.split())


def test_a_recording_of_an_interrupted_flight_tells_its_own_number_of_frames(convert, work):
    """It told that of frames.csv, though a film that is cut off ends earlier."""
    folder = write_flown(work / "cut").folder
    shutil.copy(write_flown(work / "short", frames=8).folder / "preview.mp4", folder)
    record = folder / "flight.json"
    record.write_text(record.read_text().replace('"whole": true', '"whole": false'))
    code, stdout, stderr = convert("cut.mcap", folder="cut")
    assert (code, "cut.mcap: 8 frames of" in stdout) == (0, True)
    assert "4 frames are not in it: the preview of the interrupted flight ends before them" in stderr
    with AnyReader([work / "cut.mcap"]) as reader:
        assert {connection.msgcount for connection in reader.connections} == {8}


def test_frames_without_a_place_are_counted(convert, work):
    """Found in review: after a gap in the log half of a flight was missing from its cloud, without a word."""
    poses = [pose(i, STEP_M * i, segment=int(i >= FRAMES - 3)) for i in range(FRAMES)]
    poses[1] = pose(1, STEP_M, attitude="unknown")
    write_flown(work / "gap", poses=poses)
    code, _, stderr = convert("gap.ply", "--every", "1", folder="gap")
    assert code == 0
    assert "4 frames with depth are not in it" in stderr
    assert "not in it" not in convert("whole.ply", "--every", "1")[2]


def test_an_occupancy_map(convert, work):
    code, stdout, _ = convert("flight.bt", "--every", "1")
    assert (code, "m3 free from" in stdout, "metres east, north, up" in stdout) == (0, True, True)
    tree = octomap.OcTree(1.0)
    assert tree.readBinary((work / "flight.bt").read_bytes())
    assert tree.getResolution() == 0.5


@pytest.fixture
def unfilmed(work):
    """A flight whose preview could not be written."""
    (write_flown(work / "unfilmed").folder / "preview.mp4").unlink()
    return "unfilmed"


def test_an_occupancy_map_needs_no_preview(convert, work, unfilmed):
    """Found in review: it takes no colour from the preview, and was refused without one."""
    assert convert("unfilmed.bt", *COARSE, folder=unfilmed)[0] == 0
    assert convert("filmed.bt", *COARSE)[0] == 0
    assert (work / "unfilmed.bt").read_bytes() == (work / "filmed.bt").read_bytes()


@pytest.mark.parametrize("kind", ["ply", "las", "mcap"])
def test_without_a_preview_it_says_what_needs_none(convert, unfilmed, kind):
    outcome = convert(f"unfilmed.{kind}", folder=unfilmed)
    refused(outcome, "the preview of this flight", "only .bt needs no preview")


def test_a_map_of_space_that_nothing_tells_of(convert, work):
    code, _, stderr = convert("flight-none.bt", *COARSE, "--min-confidence", "1")
    assert (code, (work / "flight-none.bt").exists()) == (2, False)
    assert "expected space that is known, got none" in " ".join(stderr.split())


@pytest.mark.parametrize("kind", ["ply", "bt"])
@pytest.mark.parametrize(
    ("attitude", "true_north", "told"),
    [
        ("assumed", True, "; north and up are only assumed, since the log tells no attitude"),
        ("log", False, "; north may be any direction"),
        ("log", True, "metres east, north, up"),
    ],
)
def test_axes_that_the_log_does_not_tell(convert, work, *, kind, attitude, true_north, told):
    """Of a .laz it was said; a .ply was east, north and up whatever the log told."""
    folder = write_flown(work / "axes", poses=[pose(i, STEP_M * i, attitude=attitude) for i in range(FRAMES)])
    record = folder.folder / "flight.json"
    north = '"true_north": {}'
    record.write_text(record.read_text().replace(north.format("true"), north.format(str(true_north).lower())))
    code, stdout, _ = convert(f"axes.{kind}", *COARSE, folder="axes")
    assert (code, stdout.strip().endswith(told)) == (0, True)


def test_larger_voxels_make_fewer_points(convert, work):
    counts = []
    for voxel in ("0.25", "2"):
        assert convert("flight.laz", "--every", "1", "--voxel", voxel)[0] == 0
        counts.append(len(laspy.read(work / "flight.laz")))
    assert counts[0] > 5 * counts[1] > 0


def test_a_recording(convert, work):
    assert convert("flight.mcap")[0] == 0
    with AnyReader([work / "flight.mcap"]) as reader:
        assert {connection.msgcount for connection in reader.connections} == {FRAMES}


@pytest.mark.parametrize("kind", ["ply", "laz", "mcap"])
def test_a_full_disk_says_what_to_do(convert, work, monkeypatch, kind):
    """All that was said was `[Errno 28] No space left on device`."""
    monkeypatch.setattr("flightdepth.files.os.fsync", full)
    options = [] if kind == "mcap" else ["--every", "1"]
    code, _, stderr = convert(f"large.{kind}", *options)
    assert (code, (work / f"large.{kind}").exists()) == (3, False)
    assert stderr.splitlines()[-1] == (
        f"error: no room left on the disk of {work / 'large'}.{kind}; nothing of it was written."
        " Free some room and give the same command again"
    )


def full(descriptor):
    raise OSError(errno.ENOSPC, "No space left on device")


def refused(outcome, *words):
    code, _, stderr = outcome
    assert code == 2
    assert len(stderr.splitlines()) == 1
    assert [word for word in words if word not in stderr] == []


def test_an_unknown_kind(convert):
    refused(convert("flight.obj"), ".ply, .las, .laz, .bt, .mcap, .tum", "got .obj")


def test_options_of_clouds_beside_a_recording(convert):
    given = convert("flight.mcap", "--voxel", "1", "--max-range", "9", "--min-confidence", "0.5")
    refused(given, "got --min-confidence, --max-range, --voxel")


def test_a_folder_that_is_none(convert):
    refused(convert("flight.ply", folder="nowhere"), "nowhere")


def test_the_folder_of_several_flights_names_one(convert, work):
    """It said "No such file or directory" of a folder that `run` had just written."""
    for name in ("b", "a"):
        write_flown(work / "several" / name)
    refused(convert("flight.ply", folder="several"), "one flight's folder", "2 flights", "several/a")
    shutil.rmtree(work / "several/b")
    refused(convert("flight.ply", folder="several"), "got one that holds it. Give one, as", "several/a")


def test_a_file_in_no_folder(convert):
    refused(convert("nowhere/flight.ply"), "an existing folder")


def test_a_file_among_those_of_the_run(convert, work):
    refused(convert("out/flight.ply", "--every", "1"), "a place outside", "replaces")
    assert not (work / "out/flight.ply").exists()


def test_nothing_counts(convert, work):
    refused(
        convert("empty.ply", "--every", "1", "--min-confidence", "1"), "points that count", "--min-confidence"
    )
    assert not (work / "empty.ply").exists()


@pytest.mark.parametrize("seen", [False, True])
def test_a_flight_of_a_speed_alone_needs_another_log_or_a_network_that_sees_directions(
    convert, work, monkeypatch, seen
):
    """It was told to take such a network, which it had."""
    monkeypatch.setattr(NetworkCard, "knows_direction", seen)
    write_flown(work / "speed", posed=False)
    outcome = convert("speed.ply", folder="speed")
    refused(outcome, "a log that tells which way the drone flew", "--mount fixed")
    assert outcome[1] == ""  # it began with an empty bar
    assert ("network that knows directions" in outcome[2]) != seen


def test_a_flight_that_hovered_all_the_time(convert, work):
    """It was told to try other options, none of which makes depth."""
    write_flown(work / "hovered", frames=1)
    outcome = convert("hovered.ply", folder="hovered")
    refused(outcome, "a frame with depth", "frames.csv")
    assert "--min-confidence" not in outcome[2]


@pytest.mark.parametrize(
    ("kind", "module", "extra"),
    [
        ("las", "laspy", "clouds"),
        ("laz", "pyproj", "clouds"),
        ("bt", "octomap", "clouds"),
        ("mcap", "mcap.writer", "ros"),
    ],
)
def test_without_the_extra_it_says_which(convert, monkeypatch, kind, module, extra):
    monkeypatch.setitem(sys.modules, module, None)  # an import of it fails
    code, _, stderr = convert(f"missing.{kind}")
    assert code == 3
    assert f"flightdepth[{extra}]" in stderr
