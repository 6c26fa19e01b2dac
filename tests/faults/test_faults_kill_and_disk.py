"""Faults 19 and 20: kill -9 at any moment, and a full disk: nothing half-written is taken for whole."""

import gc
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import fault_victim
import numpy as np
import pytest
from fault_flights import film, log, run, table, tree

from flightdepth import cli
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.outputs import FlightFolder
from flightdepth.stillbox.stored import open_stored_set
from tests_recipes import recipe_text, stage_text

FRAMES = 40
RECIPE = recipe_text(*(stage_text(name, 16) for name in "abc"), more="scenes = {frames = 3}")
RENDER = ("render", "64", "--size", "16x12", "--procedural", "2", "--config", "short.toml", "--scenes", "40")
SCENES = int(RENDER[-1])
TRAIN = ("train", "small.toml", "--procedural", "2")


@pytest.fixture
def work(tmp_path, monkeypatch, save_difference_network):
    """A folder to work in, with a flight, a network, and settings for render and train."""
    monkeypatch.chdir(tmp_path)
    save_difference_network()
    film(tmp_path / "flight.mp4", FRAMES)
    log(tmp_path / "log.csv")
    (tmp_path / "short.toml").write_text("frames = 2\n")
    (tmp_path / "small.toml").write_text(RECIPE)
    return tmp_path


def run_words(out):
    fixed = ("--hfov", "90", "--network", "difference.onnx", "--telemetry", "log.csv")
    return ("run", "flight.mp4", *fixed, "--out", out)


def started(*words, room="any"):
    """The command in a process of its own, in this folder, on one thread."""
    command = [sys.executable, fault_victim.__file__, room, *map(str, words)]
    alone = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=alone)


def killed(words, moment, wait_s):
    """Kill the command with -9 `wait_s` after `moment()` came true; False where it had ended before."""
    process = started(*words)
    until = time.monotonic() + 120
    while process.poll() is None and not moment() and time.monotonic() < until:
        time.sleep(0.002)
    time.sleep(wait_s)
    process.kill()
    process.communicate()
    return process.returncode == -signal.SIGKILL


def timeless(out):
    """All of a run but what a clock says."""
    files = {name: data for name, data in tree(Path(out)).items() if name.startswith(("depth", "confidence"))}
    return files, [{**row, "latency_ms": ""} for row in table(Path(out))]


# Fault 19: kill -9.


def kill_a_run(work, out, seed):
    """Kill a run somewhere between its first file and its end; the folder that it was writing.

    What stands in `out` must be as it was. A fast machine may have come to the end before: then it must be whole, and
    the next run is killed sooner.
    """
    chance = random.Random(seed)
    least, wait_s = chance.randrange(1, FRAMES), chance.uniform(0, 0.1)

    def so_many_files():
        return sum(1 for _ in work.glob(f".{out}.*/depth/*.png")) >= least

    while True:
        before = tree(work / out)
        killed(run_words(out), so_many_files, wait_s)
        if left := list(work.glob(f".{out}.recording-*")):
            assert tree(work / out) == before
            return left[0]
        assert FlightFolder(work / out).record.whole
        assert least > 1 or wait_s > 0.001, "no kill came in time"
        least, wait_s = max(1, least // 2), wait_s / 2


def test_fault_19_a_killed_run_leaves_no_folder_that_looks_whole(work):
    left = kill_a_run(work, "killed", seed=1)
    assert not (work / "killed").exists()
    assert not FlightFolder(left).record.whole
    assert run(Path("flight.mp4"), Path("difference.onnx"), Path("killed")) == 0
    assert run(Path("flight.mp4"), Path("difference.onnx"), Path("whole")) == 0
    assert timeless("killed") == timeless("whole")


def test_fault_19_what_a_killed_run_had_flown_is_kept_by_the_next(work, capsys):
    """Found in review: it was removed, though Ctrl-C keeps it."""
    kill_a_run(work, "out", seed=2)
    assert run(Path("flight.mp4"), Path("difference.onnx"), Path("out")) == 0
    assert list(work.glob(".out.*")) == []
    kept = work / "out.interrupted-1"
    flight = FlightFolder(kept)
    assert not flight.record.whole
    assert 0 < len(flight.rows) < FRAMES
    assert all(np.isfinite(flight.depth_m(row.index)).any() for row in flight.rows if not row.reason)
    last_s = flight.rows[-1].stamp_ns / 1e9
    said = " ".join(capsys.readouterr().err.split())
    assert f"killed: what was flown stands in {kept}; --start {last_s:.2f} goes on from there" in said


def test_fault_19_of_several_flights_a_killed_one_is_begun_anew(work):
    """The same command does so."""
    several = (
        "run",
        "flight.mp4",
        "flight.mp4",
        "--hfov",
        "90",
        "--network",
        "difference.onnx",
        "--speed",
        "3",
    )
    assert killed((*several, "--out", "out"), lambda: any(work.glob("out/.flight.*/depth/*.png")), 0)
    assert cli.main([*several, "--out", "out"]) == 0
    assert sorted(path.name for path in (work / "out").iterdir()) == ["flight", "flight-2"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_fault_19_a_run_killed_at_a_random_moment_leaves_the_older_result(work, seed):
    assert run(Path("flight.mp4"), Path("difference.onnx"), Path("out")) == 0
    kill_a_run(work, "out", seed)
    assert run(Path("flight.mp4"), Path("difference.onnx"), Path("whole")) == 0
    assert timeless("out") == timeless("whole")


def kill_a_render(work, seed, layout):
    chance = random.Random(seed)
    least = chance.randrange(1, SCENES - 10)

    def so_much():
        files = list((work / "killed").rglob("*.npy"))
        return len(files) >= 2 * least or (layout == "shards" and any((work / "killed").glob("*.part")))

    return killed((*RENDER, "--format", layout, "--out", "killed"), so_much, chance.uniform(0, 0.05))


def check_render(layout):
    assert cli.main([*RENDER, "--format", layout, "--out", "killed"]) == 0
    assert cli.main([*RENDER, "--format", layout, "--out", "whole"]) == 0
    assert tree(Path("killed")) == tree(Path("whole"))


def test_fault_19_a_killed_render_goes_on_to_the_same_bytes(work):
    kill_a_render(work, 1, "folder")
    with suppress(BadInput):  # before the first record of scenes it is no set at all
        assert len(open_stored_set(work / "killed")) < SCENES
    check_render("folder")


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["folder", "shards"])
@pytest.mark.parametrize("seed", range(5))
def test_fault_19_a_render_killed_at_a_random_moment_goes_on_to_the_same_bytes(work, seed, layout):
    kill_a_render(work, seed, layout)
    check_render(layout)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_fault_19_a_training_killed_at_a_random_moment_goes_on_to_the_same_weights(work, seed, monkeypatch):
    torch = pytest.importorskip("torch")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # the number of threads decides how sums are rounded
    chance = random.Random(seed)
    stage = chance.choice("ab")
    killed(
        (*TRAIN, "--runs", "killed"),
        (work / "killed/small" / f"{stage}.safetensors").exists,
        chance.uniform(0, 1.0),
    )
    try:
        assert cli.main([*TRAIN, "--runs", "killed", "--resume"]) == 0
        assert cli.main([*TRAIN, "--runs", "whole"]) == 0
    finally:
        torch.set_num_threads(threads)
    names = ["checkpoint.safetensors", "a.safetensors", "b.safetensors", "c.safetensors"]
    for name in names:
        assert (work / "killed/small" / name).read_bytes() == (work / "whole/small" / name).read_bytes()


@pytest.mark.parametrize("share", [0.3, 0.99])
def test_fault_19_half_a_checkpoint_is_refused(tmp_path, share):
    torch = pytest.importorskip("torch")
    from safetensors.torch import save

    from flightdepth.training.checkpoint import read_progress

    data = save({"network.a": torch.zeros(100)}, metadata={"progress": "{}"})
    path = tmp_path / "checkpoint.safetensors"
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BadInput, match="a checkpoint of flightdepth train"):
        read_progress(path)


# Fault 20: a full disk.


@contextmanager
def small_disk(folder, size):
    """A disk of `size`; skips where this user may not mount one."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    try:
        yield folder
    finally:
        gc.collect()  # a film that could not be written is closed with its container
        subprocess.run(["umount", str(folder)], check=True)


def is_one_line_about_room(stderr):
    lines = [line for line in stderr.splitlines() if line.startswith("error: ")]
    return len(lines) == 1 and (
        "No space left" in lines[0] or "File too large" in lines[0] or "no room" in lines[0]
    )


@pytest.mark.parametrize("size", ["16k", "200k", "600k"])
def test_fault_20_a_full_disk_is_an_error_of_the_run_and_leaves_nothing(work, capsys, size):
    with small_disk(work / "disk", size) as disk:
        assert run(Path("flight.mp4"), Path("difference.onnx"), disk / "out") == 3
        assert list(disk.iterdir()) == []
    assert is_one_line_about_room(capsys.readouterr().err)


def test_fault_20_an_older_result_outlives_a_full_disk(work):
    with small_disk(work / "disk", "1500k") as disk:
        words = Path("flight.mp4"), Path("difference.onnx"), disk / "out"
        assert run(*words, "--end", "0.5") == 0
        before = tree(disk / "out")
        (disk / "ballast").write_bytes(bytes(os.statvfs(disk).f_bavail * os.statvfs(disk).f_bsize - 200_000))
        assert run(*words) == 3
        assert tree(disk / "out") == before
        assert sorted(path.name for path in disk.iterdir()) == ["ballast", "out"]


@pytest.mark.parametrize("room", [4_000, 60_000])  # in the first depth file; in the preview
def test_fault_20_a_file_that_may_not_grow_is_an_error_of_the_run(work, room):
    """For users who may not mount a disk."""
    process = started(*run_words("out"), room=str(room))
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 3
    assert is_one_line_about_room(stderr.decode())
    assert not list(work.glob("*out*"))


@pytest.mark.parametrize("layout", ["folder", "shards"])
def test_fault_20_a_full_disk_is_an_error_of_render_which_goes_on_later(work, capsys, layout):
    with small_disk(work / "disk", "150k") as disk:
        words = [*RENDER, "--format", layout, "--out", str(disk / "set")]
        assert cli.main(words) == 3
        assert is_one_line_about_room(capsys.readouterr().err)
        subprocess.run(["mount", "-o", "remount,size=8m", str(disk)], check=True)
        assert cli.main(words) == 0
        assert cli.main([*RENDER, "--format", layout, "--out", "whole"]) == 0
        assert tree(disk / "set") == tree(Path("whole"))


@pytest.mark.slow
def test_fault_20_a_full_disk_is_an_error_of_training(work, capsys):
    with small_disk(work / "disk", "96k") as disk:
        assert cli.main([*TRAIN, "--runs", str(disk)]) == 3
        assert is_one_line_about_room(capsys.readouterr().err)
        for path in disk.rglob("*.safetensors"):
            from flightdepth.training.checkpoint import read_progress

            read_progress(path)  # what stands is whole


def test_fault_20_weights_on_a_full_disk(tmp_path):
    from flightdepth.weights.store import read_network, save_network
    from tests_networks import difference_card

    with small_disk(tmp_path / "disk", "64k") as disk:
        save_network(disk, difference_card(), b"old")
        with pytest.raises(OSError, match="No space left"):
            save_network(disk, difference_card(), bytes(100_000))
        assert read_network(disk / "difference.onnx").onnx == b"old"
        assert len(list(disk.iterdir())) == 2


def test_fault_20_a_full_disk_is_not_bad_input():
    assert FlightDepthError.exit_code == 3
