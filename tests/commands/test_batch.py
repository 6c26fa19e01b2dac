"""Several flights: what stands is skipped, what failed or was cut short is done again; on a Ray cluster too."""

import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from command_flights import FRAMES, make_video

from flightdepth.cli import main
from flightdepth.commands.batch import Job, here, jobs_of
from flightdepth.commands.run_settings import RunSettings
from flightdepth.commands.signals import heed_interrupt, interrupts_heeded, stopped_as_by_ctrl_c
from flightdepth.errors import FlightDepthError
from flightdepth.outputs import FlightFolder
from flightdepth.outputs.pictures import pictures


@pytest.fixture
def work(tmp_path, save_difference_network):
    save_difference_network()
    make_video(tmp_path / "one.mp4")
    make_video(tmp_path / "two.mp4", frames=8)
    return tmp_path


@pytest.fixture
def run(work, capsys):
    def call(*arguments, flights=("one.mp4", "two.mp4")):
        options = ["--hfov", "90", "--speed", "3", "--network", str(work / "difference.onnx")]
        paths = [str(work / flight) for flight in flights]
        code = main(["run", *paths, *options, "--out", str(work / "out"), *arguments])
        return code, *capsys.readouterr()

    return call


def written(work, name):
    return (work / "out" / name / "flight.json").stat().st_mtime_ns


def test_a_finished_flight_is_skipped_and_said_to_be(run, work):
    assert "2 flights: 2 done" in run()[1]
    before = written(work, "one")
    code, stdout, _ = run()
    assert code == 0
    assert "one.mp4: finished before, skipped" in stdout
    assert "2 flights: 2 finished before" in stdout
    assert written(work, "one") == before


def test_no_two_flights_share_a_folder():
    jobs = jobs_of([Path("1/a.mp4"), Path("a-2.mp4"), Path("2/a.mp4"), Path("3/a.mp4")], Path("out"))
    assert [job.target.name for job in jobs] == ["a", "a-2", "a-3", "a-4"]


@pytest.mark.parametrize(
    ("flight", "name"), [(".", "inner"), ("..", "outer"), ("a/..", "inner"), ("a/.", "a")]
)
def test_a_folder_told_by_dots_gets_one_of_its_own_name(tmp_path, monkeypatch, flight, name):
    """It was given the output folder itself, or that of all flights."""
    (tmp_path / "outer/inner/a").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "outer/inner")
    assert [job.target for job in jobs_of([Path(flight)], Path("out"))] == [Path("out", name)]


def test_nor_on_a_disk_that_knows_no_capitals():
    """On Windows and macOS the second flight replaced the first."""
    jobs = jobs_of([Path("1/DJI_0001.MP4"), Path("2/dji_0001.mp4")], Path("out"))
    assert [job.target.name for job in jobs] == ["DJI_0001", "dji_0001-2"]


def test_an_unfinished_flight_is_done(run, work):
    run()
    (work / "out/two/flight.json").unlink()  # as a folder of another program, or of a crash
    code, stdout, _ = run()
    assert code == 0
    assert "1 finished before, 1 done" in stdout
    assert len(FlightFolder(work / "out/two").rows) == 8


@pytest.mark.slow
@pytest.mark.parametrize("option", [("--ranges", "3"), ("--end", "0.5"), ("--depth-format", "npz")])
def test_other_settings_are_another_result(run, option):
    run()
    assert "2 flights: 2 done" in run(*option)[1]


@pytest.mark.slow
def test_another_video_of_the_same_name_is_run(run, work):
    run()
    make_video(work / "one.mp4", frames=10)
    assert "1 done, 1 finished before" in run()[1]
    assert len(FlightFolder(work / "out/one").rows) == 10


@pytest.mark.slow
def test_another_log_beside_a_video_is_another_flight(run, work):
    def write(speed):
        lines = [f"{time},{speed},0,0" for time in (0, 5)]
        (work / "one.csv").write_text("\n".join(["time_s,vn_m_s,ve_m_s,vd_m_s", *lines]))

    def fly():
        options = ["--hfov", "90", "--network", str(work / "difference.onnx"), "--out", str(work / "logged")]
        return main(["run", str(work / "one.mp4"), str(work / "two.mp4"), *options])

    write(3)
    (work / "two.csv").write_text((work / "one.csv").read_text())
    assert fly() == 0
    before = (work / "logged/one/flight.json").stat().st_mtime_ns
    write(4)
    assert fly() == 0
    assert (work / "logged/one/flight.json").stat().st_mtime_ns > before


def test_a_flight_that_fails_is_counted_and_does_not_stop_the_others(run, work):
    (work / "two.mp4").write_bytes(b"")
    code, stdout, stderr = run(flights=("two.mp4", "one.mp4"))
    assert code == 2
    assert "2 flights: 1 failed, 1 done" in stdout
    assert "two.mp4" in stderr.splitlines()[0]


@pytest.mark.parametrize("flights", [("one.mp4",), ("one.mp4", "two.mp4")])
def test_a_flight_without_any_depth_is_written_and_told_by_the_exit_code(run, work, flights):
    code, stdout, stderr = run("--speed", "0", flights=flights)
    assert code == 3
    assert "no frame has depth" in stderr
    assert ("2 flights: 2 without any depth" in stdout) == (len(flights) > 1)
    folder = work / "out" / ("" if len(flights) == 1 else "one")
    assert all(row.reason for row in FlightFolder(folder).rows)
    if len(flights) > 1:
        code, stdout, _ = run("--speed", "0")
        assert code == 3
        assert "one.mp4: finished before, skipped" in stdout
        assert "2 flights: 2 finished before without any depth" in stdout


def test_what_an_interrupted_flight_left_is_not_taken_for_all_of_it(run, work):
    run()
    record = work / "out/one/flight.json"
    record.write_text(record.read_text().replace('"whole": true', '"whole": false'))
    _, stdout, _ = run()
    assert "2 flights: 1 done, 1 finished before" in stdout


def test_a_single_flight_is_run_again(run, work):
    run(flights=("one.mp4",))
    before = (work / "out/flight.json").stat().st_mtime_ns
    run(flights=("one.mp4",))
    assert (work / "out/flight.json").stat().st_mtime_ns > before


def test_what_a_single_flight_replaces_of_another_is_told(run):
    assert "replaces" not in run(flights=("one.mp4",))[2]
    assert "replaces" not in run(flights=("one.mp4",))[2]
    code, _, stderr = run(flights=("two.mp4",))
    assert code == 0
    assert "out holds the result of one.mp4, which this one replaces when it is done" in stderr


def test_what_another_card_s_flight_of_that_name_replaces_is_told(run, work):
    run(flights=("one.mp4",))
    (work / "card").mkdir()
    make_video(work / "card" / "one.mp4", frames=8)
    assert "out holds the result of another one.mp4, which" in run(flights=("card/one.mp4",))[2]


def begun(work):
    """Pictures of flights that are not finished; a folder may be renamed while it is looked through."""
    try:
        return len(list(work.rglob(".*.*-*/depth/*.png")))
    except FileNotFoundError:
        return 0


@pytest.fixture(scope="module")
def long_video(tmp_path_factory):
    return make_video(tmp_path_factory.mktemp("long") / "long.mp4", frames=2000)


def stopped_run(work, number, long_video, *flights):
    """Exit code and stderr of a run that got a signal once it had written some frames."""
    for flight in flights:
        shutil.copy(long_video, work / flight)
    options = ["--hfov", "90", "--speed", "3", "--network", "difference.onnx", "--out", "out"]
    command = [sys.executable, "-m", "flightdepth", "run", *flights, *options]
    heeding: dict[str, Any] = {  # under nohup too
        "preexec_fn": partial(signal.signal, number, signal.SIG_DFL)
    }
    with subprocess.Popen(command, cwd=work, stderr=subprocess.PIPE, text=True, **heeding) as running:
        while begun(work) < 5:
            assert running.poll() is None
            time.sleep(0.05)
        running.send_signal(number)
        _, stderr = running.communicate(timeout=60)
    return running.returncode, " ".join(stderr.split())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_a_signal_ends_a_flight_and_what_was_flown_stays(work, number, long_video):
    """As systemd, Slurm, `timeout` and `docker stop` send SIGTERM, and a terminal that is closed SIGHUP."""
    code, stderr = stopped_run(work, number, long_video, "long.mp4")
    assert code == 130
    kept = work / "out.interrupted-1"
    assert list(work.glob("*out*")) == [kept]  # so no hidden folder either
    flight = FlightFolder(kept)
    assert not flight.record.whole
    assert 5 <= len(flight.rows) == flight.record.counts.frames < 2000
    assert len(list(pictures(flight))) in (len(flight.rows), len(flight.rows) - 1)
    last_s = flight.rows[-1].stamp_ns / 1e9
    assert f"what was flown stands in {kept}; --start {last_s:.2f} goes on from there" in stderr


def test_a_signal_clears_away_what_was_begun_of_several_flights(work, long_video):
    """The same command begins anew with that one."""
    code, stderr = stopped_run(work, signal.SIGTERM, long_video, "long.mp4", "longer.mp4")
    assert code == 130
    assert "nothing of this flight was written" in stderr
    assert not list(work.glob("*out*/*"))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_python_drops_is_raised_again(number):
    """As it does with what a destructor raises; the flight went on to its end then."""

    class Dropped:
        def __del__(self):
            os.kill(os.getpid(), number)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a script's `&` has it ignored
    try:
        with stopped_as_by_ctrl_c():
            Dropped()
            with pytest.raises(KeyboardInterrupt):
                heed_interrupt()
        with stopped_as_by_ctrl_c():
            heed_interrupt()
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.fixture
def interruptible():
    """A script's `&` has Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with stopped_as_by_ctrl_c():
        yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_while_frames_are_flown_an_interrupt_waits_for_the_frames_end(number, interruptible):
    """Raised in the midst of OpenCV's arguments it ended the process with a segmentation fault."""
    steps = []
    with pytest.raises(KeyboardInterrupt), interrupts_heeded():
        heed_interrupt()
        os.kill(os.getpid(), number)
        steps.append("the frame's rest")
        heed_interrupt()
        steps.append("another frame")
    assert steps == ["the frame's rest"]


def test_an_interrupt_of_the_last_frame_is_not_lost(interruptible):
    steps = []
    with pytest.raises(KeyboardInterrupt), interrupts_heeded():
        os.kill(os.getpid(), signal.SIGINT)
        steps.append("the frame's rest")
    assert steps == ["the frame's rest"]


def test_who_insists_does_not_wait(interruptible):
    steps = []
    with pytest.raises(KeyboardInterrupt), interrupts_heeded():
        os.kill(os.getpid(), signal.SIGINT)
        steps.append("the frame's rest")
        os.kill(os.getpid(), signal.SIGINT)
        steps.append("more of it")
    assert steps == ["the frame's rest"]


def test_before_and_after_the_frames_an_interrupt_is_raised_at_once(interruptible):
    with interrupts_heeded():
        pass
    steps = []
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
        steps.append("more")
    assert not steps


def test_the_process_keeps_its_own_handlers_of_signals(run):
    """Who calls `run` from a program of their own was left with Ctrl-C for SIGTERM."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    assert run(flights=("two.mp4",))[0] == 0
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


@pytest.mark.parametrize("option", ["network", "fallback"])
def test_a_folder_of_a_network_s_name_is_not_that_network(tmp_path, monkeypatch, option):
    """That of `--out motion` was taken for it, and several flights ended."""
    monkeypatch.chdir(tmp_path)
    Path("motion").mkdir()
    assert getattr(RunSettings(**{option: "motion"}).anywhere(), option) == "motion"
    Path("own.onnx").touch()
    assert getattr(RunSettings(**{option: "own.onnx"}).anywhere(), option) == str(tmp_path / "own.onnx")


def test_a_folder_of_a_lens_s_name_is_not_that_lens(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("dji-mini-2").mkdir()
    assert RunSettings(camera=Path("dji-mini-2")).anywhere().camera == Path("dji-mini-2")
    Path("own.yaml").touch()
    assert RunSettings(camera=Path("own.yaml")).anywhere().camera == tmp_path / "own.yaml"


def test_an_address_without_ray(run):
    code, _, stderr = run("--address", "auto")
    assert code == 2
    assert "--engine ray" in stderr


@pytest.mark.slow
def test_a_cluster_gives_the_same_files(run, work):
    pytest.importorskip("ray", reason="needs flightdepth[cluster]")
    run()
    alone = {name: (work / "out" / name / "frames.csv").read_text() for name in ("one", "two")}
    depth = (work / f"out/one/depth/{FRAMES - 1:06d}.png").read_bytes()
    (work / "out").rename(work / "alone")
    (work / "three.mp4").write_bytes(b"")
    code, stdout, stderr = run("--engine", "ray", flights=("one.mp4", "three.mp4", "two.mp4"))
    assert code == 2
    assert "3 flights: 2 done, 1 failed" in stdout
    assert "three.mp4" in stderr
    assert (work / f"out/one/depth/{FRAMES - 1:06d}.png").read_bytes() == depth
    for name, table in alone.items():
        rows = (work / "out" / name / "frames.csv").read_text()
        both = ([row.split(",")[:6] for row in text.splitlines()] for text in (rows, table))
        assert next(both) == next(both)  # all but the time it took
    assert "2 finished before" in run("--engine", "ray")[1]


def test_a_flight_that_may_not_be_read_does_not_stop_the_others():
    """As an error of a file system comes, not of a flight."""
    jobs = [Job(Path(name), Path("out", name)) for name in ("locked", "fine")]

    def run_one(flight, target):
        if flight.name == "locked":
            raise PermissionError(13, "Permission denied", "locked")
        return "done"

    locked, fine = here(jobs, run_one)
    assert isinstance(locked, FlightDepthError)
    assert "Permission denied" in str(locked)
    assert fine == "done"


def test_a_fault_of_ours_in_one_flight_does_not_stop_the_others():
    """A traceback ended all, where a cluster went on."""
    jobs = [Job(Path(name), Path("out", name)) for name in ("odd", "fine")]

    def run_one(flight, target):
        if flight.name == "odd":
            raise ValueError("of no shape")
        return "done"

    odd, fine = here(jobs, run_one)
    assert isinstance(odd, FlightDepthError)
    assert str(odd) == "flight odd: ValueError: of no shape"
    assert fine == "done"
