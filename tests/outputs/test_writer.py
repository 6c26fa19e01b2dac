import errno
import os
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from output_samples import HEIGHT, SOURCE, WIDTH, frame, known, unknown

from flightdepth import __version__
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.outputs import FlightFolder, FlightWriter, Preview
from flightdepth.outputs.film import Film
from flightdepth.outputs.interrupted import keep_interrupted
from flightdepth.outputs.pictures import pictures


def writer(target, **options):
    return FlightWriter(target, SOURCE, Preview(WIDTH, HEIGHT), **options)


def write(target, results, **options):
    with writer(target, **options) as open_writer:
        for i, result in enumerate(results):
            open_writer.add(frame(i), result)
        open_writer.note_dropped({"damaged frames": 2})
    return open_writer


RAMP = np.broadcast_to(np.linspace(0.5, 90, WIDTH, dtype=np.float32), (HEIGHT, WIDTH))
HALF_KNOWN = np.where(np.arange(WIDTH) < WIDTH // 2, np.float32(25), np.float32(np.nan)) * np.ones(
    (HEIGHT, 1)
)


def test_the_folder_holds_what_is_promised(tmp_path):
    write(tmp_path / "out", [unknown(), known(RAMP)])
    names = {
        str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*") if path.is_file()
    }
    maps = {f"{kind}/{i:06d}.png" for kind in ("depth", "confidence") for i in (0, 1)}
    assert names == maps | {"frames.csv", "poses.csv", "flight.json", "preview.mp4"}


def test_what_is_called_whole_came_to_the_disk_before(tmp_path, monkeypatch):
    """A battery pulled after the end of a flight left empty maps in a folder that looked whole."""
    brought = []

    def sync():
        [folder] = tmp_path.iterdir()
        brought.append((len(list((folder / "depth").iterdir())), FlightFolder(folder).record.whole))

    monkeypatch.setattr("flightdepth.files.os.sync", sync, raising=False)
    write(tmp_path / "out", [known(10), known(20)], stopped=True)
    assert brought == [(2, False)]
    assert FlightFolder(tmp_path / "out").record.whole


def test_png_depth_comes_back_within_half_a_centimetre(tmp_path):
    write(tmp_path / "out", [known(RAMP)])
    assert np.abs(FlightFolder(tmp_path / "out").depth_m(0) - RAMP).max() <= 0.005 + 1e-4


def test_npz_depth_comes_back_exactly(tmp_path):
    write(tmp_path / "out", [known(RAMP)], depth_format="npz")
    assert np.array_equal(FlightFolder(tmp_path / "out").depth_m(0), RAMP)


@pytest.mark.parametrize("depth_format", ["png", "npz"])
def test_unknown_stays_unknown(tmp_path, depth_format):
    write(tmp_path / "out", [known(HALF_KNOWN)], depth_format=depth_format)
    assert np.array_equal(np.isnan(FlightFolder(tmp_path / "out").depth_m(0)), np.isnan(HALF_KNOWN))


def test_confidence_comes_back(tmp_path):
    write(tmp_path / "out", [known(HALF_KNOWN)])
    confidence = FlightFolder(tmp_path / "out").confidence(0)
    assert confidence == pytest.approx(known(HALF_KNOWN).confidence, abs=1 / 255)


def with_sigma(share):
    return replace(known(RAMP), sigma_m=RAMP * np.float32(share))


def test_sigma_png_comes_back_within_a_64th(tmp_path):
    write(tmp_path / "out", [unknown(), with_sigma(0.3)])
    folder = FlightFolder(tmp_path / "out")
    assert np.abs(folder.sigma_m(1) / (0.3 * RAMP) - 1).max() <= 1 / 64 + 0.005 / (0.3 * RAMP.min())
    assert folder.sigma_m(0) is None


def test_sigma_npz_comes_back_exactly(tmp_path):
    write(tmp_path / "out", [with_sigma(0.3)], depth_format="npz")
    assert np.array_equal(FlightFolder(tmp_path / "out").sigma_m(0), RAMP * np.float32(0.3))


def test_a_network_without_sigma_leaves_no_folder(tmp_path):
    write(tmp_path / "out", [known(RAMP)])
    assert not (tmp_path / "out/sigma").exists()
    assert FlightFolder(tmp_path / "out").sigma_m(0) is None


@pytest.mark.parametrize("depth_format", ["png", "npz"])
def test_bounds_come_back_where_there_are_any(tmp_path, depth_format):
    sky = np.where(np.isnan(HALF_KNOWN), np.float32(87.6), np.float32(np.nan))
    result = replace(known(HALF_KNOWN), farther_than_m=sky)
    write(tmp_path / "out", [unknown(), result], depth_format=depth_format)
    folder = FlightFolder(tmp_path / "out")
    assert folder.farther_than_m(1) == pytest.approx(sky, abs=0.005, nan_ok=True)
    assert folder.nearer_than_m(1) is None and folder.farther_than_m(0) is None
    assert not (tmp_path / "out/nearer_than").exists()


def test_an_upper_bound_that_the_files_cannot_hold_is_none(tmp_path):
    """Of "at most 700 m" was made "at most 655.35 m"."""
    for name, nearer_m, told in (("far", 700, False), ("near", 600, True)):
        bound_m = np.where(np.isnan(HALF_KNOWN), np.float32(nearer_m), np.float32(np.nan))
        write(tmp_path / name, [replace(known(HALF_KNOWN), nearer_than_m=bound_m)])
        assert (FlightFolder(tmp_path / name).nearer_than_m(0) is not None) == told


def test_depth_png_is_16_bit_grey(tmp_path):
    write(tmp_path / "out", [known(12.34)])
    stored = cv2.imread(str(tmp_path / "out/depth/000000.png"), cv2.IMREAD_UNCHANGED)
    assert (stored.dtype, stored.shape) == (np.uint16, (HEIGHT, WIDTH))
    assert (stored == 1234).all()


def test_pixels_beyond_the_png_scale_are_counted(tmp_path):
    depth_m = np.full((HEIGHT, WIDTH), 10, np.float32)
    depth_m[0, :5] = 700
    done = write(tmp_path / "out", [known(depth_m), known(depth_m)])
    assert FlightFolder(tmp_path / "out").record.counts.pixels_at_655_m_or_farther == 10
    assert done.summary.counts.pixels_at_655_m_or_farther == 10


def test_the_table_has_a_row_for_each_frame(tmp_path):
    write(tmp_path / "out", [unknown("hovering"), known(RAMP)])
    rows = FlightFolder(tmp_path / "out").rows
    assert [(row.index, row.reason, row.shifts) for row in rows] == [(0, "hovering", ()), (1, "", (3, 7))]


def test_the_record_says_what_was_run_and_dropped(tmp_path):
    write(tmp_path / "out", [unknown("hovering"), known(RAMP)])
    record = FlightFolder(tmp_path / "out").record
    assert record.source == SOURCE
    assert record.counts.dropped == {"damaged frames": 2}
    assert record.counts.frames_without_depth == {"hovering": 1}
    assert record.notes == ("taken not to turn (1 frame)",)


def test_a_doubt_of_the_log_is_a_warning(tmp_path):
    """It stood among the notes, as if it were an assumption."""
    doubted = [replace(known(RAMP), doubt=f"denied: it is {off} degrees off") for off in (88, 90)]
    done = write(tmp_path / "out", [known(RAMP), *doubted])
    record = FlightFolder(tmp_path / "out").record
    told = ("denied: it is 88 to 90 degrees off (2 frames)",)
    assert record.source.warnings == done.summary.warnings == told
    assert record.notes == done.summary.notes == ("taken not to turn (3 frames)",)


def test_the_preview_has_every_frame(tmp_path):
    write(tmp_path / "out", [known(RAMP)] * 12)
    with av.open(str(tmp_path / "out/preview.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == 12


def test_a_folder_with_a_time_in_its_name_is_no_address(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(Path("12:30"), [known(RAMP)])
    assert [index for index, _ in pictures(FlightFolder(Path("12:30")))] == [0]


def test_a_film_with_a_time_in_its_name_is_no_address(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    film = Film(Path("12:30.mp4"), 64, 32)
    film.add(0, np.zeros((32, 64, 3), np.uint8))
    film.close()
    assert Path("12:30.mp4").is_file()


@pytest.mark.parametrize("stopped", [False, True])
def test_an_error_in_the_loop_leaves_nothing(tmp_path, stopped):
    target = tmp_path / "new" / "out"
    with pytest.raises(ValueError, match="the loop broke"), writer(target, stopped=stopped) as open_writer:
        open_writer.add(frame(0), known(RAMP))
        raise ValueError("the loop broke")
    assert list(tmp_path.iterdir()) == []


def test_an_error_on_a_thread_is_raised_and_leaves_nothing(tmp_path):
    with pytest.raises(BadInput, match="film picture"), writer(tmp_path / "out") as open_writer:
        open_writer._preview = Preview(2 * WIDTH, HEIGHT)
        open_writer.add(frame(0), known(RAMP))
    assert list(tmp_path.iterdir()) == []


def test_an_error_leaves_an_older_result_as_it_was(tmp_path):
    write(tmp_path / "out", [known(RAMP)])
    with pytest.raises(ValueError, match="the loop broke"), writer(tmp_path / "out"):
        raise ValueError("the loop broke")
    assert len(FlightFolder(tmp_path / "out").rows) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def stop(target, frames, times=1, **options):
    """Ctrl-C in the frame loop after so many frames; more `times` while it is finished."""
    with pytest.raises(KeyboardInterrupt), writer(target, stopped=True, **options) as open_writer:
        for i in range(frames):
            open_writer.add(frame(i), known(RAMP))
        if times > 1:
            open_writer._film.close = signalled
        signalled()
    return open_writer


def signalled():
    raise KeyboardInterrupt


@pytest.mark.parametrize("depth_format", ["png", "npz"])
def test_what_was_flown_until_ctrl_c_is_kept(tmp_path, depth_format):
    write(tmp_path / "out", [known(RAMP)])
    kept = stop(tmp_path / "out", 7, depth_format=depth_format).kept
    assert kept == tmp_path / "out.interrupted-1"
    flight = FlightFolder(kept)
    assert not flight.record.whole
    assert [index for index, _ in pictures(flight)] == [row.index for row in flight.rows] == list(range(7))
    assert flight.record.counts.frames_with_depth == 7
    assert np.abs(flight.depth_m(6) - RAMP).max() <= 0.005 + 1e-4
    assert FlightFolder(tmp_path / "out").record.whole  # the older result, as it was
    assert stop(tmp_path / "out", 1).kept == tmp_path / "out.interrupted-2"


def test_what_an_interrupted_flight_dropped_stays_counted(tmp_path):
    far = np.full((HEIGHT, WIDTH), 10, np.float32)
    far[0, :5] = 700
    with pytest.raises(KeyboardInterrupt), writer(tmp_path / "out", stopped=True) as open_writer:
        open_writer.add(frame(0), known(far))
        open_writer.note_dropped({"damaged frames": 2})
        signalled()
    counts = FlightFolder(open_writer.kept).record.counts
    assert counts.dropped == {"damaged frames": 2}
    assert (counts.frames, counts.pixels_at_655_m_or_farther) == (1, 5)


@pytest.mark.parametrize(("frames", "times"), [(0, 1), (7, 2)], ids=["at once", "twice"])
def test_nothing_is_kept_where_there_is_nothing_or_ctrl_c_comes_again(tmp_path, frames, times):
    assert stop(tmp_path / "out", frames, times).kept is None
    assert list(tmp_path.iterdir()) == []


def test_an_error_in_a_flight_that_cannot_be_flown_again_leaves_what_was_written_complete(tmp_path):
    with (
        pytest.raises(FlightDepthError, match="the loop broke; what was written stands in"),
        writer(tmp_path / "out", once=True) as open_writer,
    ):
        open_writer.add(frame(0), known(RAMP))
        raise ValueError("the loop broke")
    assert len(list(pictures(FlightFolder(tmp_path / "out.interrupted-1")))) == 1


@pytest.mark.parametrize("depth_format", ["png", "npz"])
def test_of_a_frame_that_is_lost_nothing_stays_and_no_folder_is_searched(tmp_path, monkeypatch, depth_format):
    """Found in review: each lost frame listed every file of the flight, while the disk was too slow already."""
    write_bytes = Path.write_bytes

    def full(path, data):
        if path.parent.name == "depth" and path.stem == "000001":  # written after the frame's other maps
            raise OSError("No space left on device")
        return write_bytes(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    monkeypatch.setattr(Path, "glob", None)
    with writer(tmp_path / "out", once=True, depth_format=depth_format) as open_writer:
        for i in range(3):
            open_writer.add(frame(i), replace(with_sigma(0.1), farther_than_m=RAMP, nearer_than_m=RAMP))
    assert open_writer.lost == 1
    names = {path.name for path in (tmp_path / "out").rglob("*") if path.parent.name != "out"}
    assert {name.split(".")[0] for name in names} == {"000000", "000002"}
    assert len(list((tmp_path / "out" / "sigma").iterdir())) == 2


def test_of_several_frames_that_are_lost_one_line_warns(tmp_path, monkeypatch):
    write_bytes = Path.write_bytes

    def full(path, data):
        if path.parent.name == "depth" and path.stem in ("000001", "000003"):
            raise OSError(f"no room for {path.stem}")
        return write_bytes(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with writer(tmp_path / "out", once=True) as open_writer:
        for i in range(5):
            open_writer.add(frame(i), known(RAMP))
    assert (open_writer.lost, open_writer.loss) == (2, "no room for 000003")
    record = FlightFolder(tmp_path / "out").record
    assert record.source.warnings == ("frames that could not be written are left out: no room for 000001",)
    assert record.counts.dropped == {"could not be written": 2}


def test_a_preview_that_cannot_be_written_is_warned_of_once(tmp_path, monkeypatch):
    def broken(film, stamp_ns, picture):
        raise OSError("Input/output error")

    monkeypatch.setattr(Film, "add", broken)
    with writer(tmp_path / "out", once=True) as open_writer:
        for i in range(4):
            open_writer.add(frame(i), known(RAMP))
    told = ("no preview, which `view` and `convert` need, but for a .bt: Input/output error",)
    flight = FlightFolder(tmp_path / "out")
    assert flight.record.source.warnings == open_writer.summary.warnings == told
    assert len(flight.rows) == 4


def test_maps_that_cannot_be_written_end_a_flight_that_can_be_flown_again(tmp_path, monkeypatch):
    def full(path, data):
        raise OSError("No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"), writer(tmp_path / "out") as open_writer:
        open_writer.add(frame(0), known(RAMP))
    assert list(tmp_path.iterdir()) == []


def test_after_an_error_nothing_is_left_open_or_at_work(tmp_path):
    """Windows removes no folder whose files are open."""
    with pytest.raises(ValueError, match="the loop broke"), writer(tmp_path / "out") as open_writer:
        open_writer.add(frame(0), known(RAMP))
        raise ValueError("the loop broke")
    assert open_writer._rows._file.closed and open_writer._poses._file.closed
    with pytest.raises(RuntimeError, match="after shutdown"):
        open_writer._files.put(frame(1), known(RAMP), None)
    with pytest.raises(RuntimeError, match="after shutdown"):
        open_writer._pictures.put(frame(1), known(RAMP), None)


def test_what_came_up_in_flight_stands_behind_what_the_run_warned_of_before(tmp_path):
    source = SOURCE.model_copy(update={"warnings": ("the clock",)})
    with FlightWriter(tmp_path / "out", source, Preview(WIDTH, HEIGHT)) as open_writer:
        open_writer.warn("the lens")
    record = FlightFolder(tmp_path / "out").record
    assert record.source.warnings == ("the clock", "the lens")
    assert open_writer.summary.warnings == ("the lens",)
    assert record.flightdepth == __version__


def test_an_older_result_of_all_kinds_is_replaced(tmp_path):
    result = replace(with_sigma(0.1), farther_than_m=RAMP, nearer_than_m=RAMP)
    write(tmp_path / "out", [result])
    assert len(list((tmp_path / "out").iterdir())) == 9
    write(tmp_path / "out", [known(RAMP)])
    assert not (tmp_path / "out" / "sigma").exists()


def test_an_older_result_is_replaced(tmp_path):
    write(tmp_path / "out", [known(RAMP)] * 3)
    write(tmp_path / "out", [known(RAMP)])
    assert len(list((tmp_path / "out" / "depth").iterdir())) == 1


def test_an_older_result_that_cannot_be_removed_is_no_error_of_the_new_one(tmp_path, monkeypatch):
    """On NFS what another program has open stays in its folder, and a flight that was complete ended as an error."""
    write(tmp_path / "out", [known(10)])
    rmdir = os.rmdir

    def refuse(path, **where):
        if Path(path).name == "depth":
            raise OSError(errno.ENOTEMPTY, "Directory not empty")
        rmdir(path, **where)

    monkeypatch.setattr("os.rmdir", refuse)
    write(tmp_path / "out", [known(20)])
    monkeypatch.undo()
    assert FlightFolder(tmp_path / "out").depth_m(0).max() == 20
    write(tmp_path / "out", [known(30)])
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("exists", [False, True])
def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path, exists):
    """Where nothing was there yet the whole flight was lost at its end; else the link became a folder."""
    disk, link = tmp_path / "disk", tmp_path / "out"
    disk.mkdir()
    if exists:
        (disk / "depth").mkdir()
    link.symlink_to(disk if exists else disk / "new")
    write(link, [known(RAMP)])
    assert link.is_symlink()
    assert len(FlightFolder(disk if exists else disk / "new").rows) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "out"]


def test_a_folder_with_something_else_in_it_is_refused(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"precious")
    with pytest.raises(BadInput, match=r"holiday\.jpg"):
        writer(tmp_path)


@pytest.mark.parametrize("left", [".DS_Store", "Thumbs.db", "desktop.ini"])
def test_an_older_result_that_somebody_looked_at_is_replaced(tmp_path, left):
    """Found in review: one look with Finder or Explorer, and the next run was refused."""
    write(tmp_path / "out", [known(RAMP)] * 2)
    for folder in (tmp_path / "out", tmp_path / "out" / "depth"):
        (folder / left).write_bytes(b"icons")
    assert len(FlightFolder(tmp_path / "out").rows) == 2
    write(tmp_path / "out", [known(RAMP)])
    assert len(FlightFolder(tmp_path / "out").rows) == 1
    assert not list(tmp_path.rglob(left))


@pytest.mark.parametrize("where", [".", ".."])
def test_the_folder_where_the_user_is_is_not_taken_away(tmp_path, monkeypatch, where):
    """It would be renamed, and the shell be left in one that is gone."""
    (tmp_path / "out" / "inside").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "out" / ("" if where == "." else "inside"))
    with pytest.raises(BadInput, match=r"out, where you are\. Give one inside it"):
        write(Path(where), [known(RAMP)])
    write(Path("deeper"), [known(RAMP)])
    assert FlightFolder(Path("deeper")).rows


def test_a_folder_is_checked_where_paths_know_no_mounts(tmp_path, monkeypatch):
    """Windows before Python 3.12: `run` ended in that traceback."""

    def unknown(self):
        raise NotImplementedError("Path.is_mount() is unsupported on this system")

    monkeypatch.setattr(Path, "is_mount", unknown)
    write(tmp_path / "out", [known(RAMP)])


@pytest.mark.skipif(not Path("/proc").is_mount(), reason="Linux's")
def test_a_mount_point_is_refused_before_the_work():
    """No system renames one: the result would be lost at the end."""
    with pytest.raises(BadInput, match="got a mount point"):
        write(Path("/proc"), [known(RAMP)])


def test_a_file_in_the_folders_place_is_refused(tmp_path):
    (tmp_path / "out").write_bytes(b"precious")
    with pytest.raises(BadInput, match="got a file"):
        writer(tmp_path / "out")


def test_a_killed_flight_without_a_frame_is_removed_one_with_a_frame_is_named(tmp_path):
    for name, frames in (("aaaaaaaa", 0), ("bbbbbbbb", 1)):
        folder = tmp_path / f".out.recording-{name}" / "depth"
        folder.mkdir(parents=True)
        (folder / "Thumbs.db").touch()  # Explorer shows the folder, and leaves that
        for index in range(frames):
            (folder / f"{index:06d}.png").touch()
    assert keep_interrupted(tmp_path / "out") == [tmp_path / "out.interrupted-1"]
    assert [path.name for path in tmp_path.iterdir()] == ["out.interrupted-1"]
