"""Sets that are taken up where they stand: after a kill, with a full disk, made larger."""

import errno
import pathlib
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
import small_sets
from small_sets import A_FOLDER, SCENES, render_small, small_source, tree

from flightdepth.errors import BadInput
from flightdepth.stillbox import original_layout, shards
from flightdepth.stillbox.set_on_disk import Layout
from flightdepth.stillbox.stored import open_stored_set

LAYOUTS = list(Layout)


@pytest.fixture(autouse=True)
def small_folders(monkeypatch):
    """Three scenes a folder and a shard; metadata after every scene."""
    monkeypatch.setattr(original_layout, "SCENES_PER_FOLDER", A_FOLDER)
    monkeypatch.setattr(original_layout, "SAVE_EVERY_S", 0.0)
    monkeypatch.setattr(shards, "SCENES_PER_SHARD", A_FOLDER)


@pytest.fixture
def whole(tmp_path):
    """What an uninterrupted run of a layout writes."""

    def files(layout):
        folder = tmp_path / f"whole-{layout}"
        render_small(folder, Layout(layout))
        return tree(folder)

    return files


@pytest.mark.parametrize(
    ("layout", "when", "stand"),
    [
        ("folder", ("half a file", 15), 2),  # six files a scene
        ("folder", ("flush", 1), 0),  # in the record
        ("folder", ("flush", 4), 2),  # in the metadata after the third scene
        ("shards", ("half a shard", 30), 3),  # seven members a scene
        ("shards", ("flush", 3), 3),
    ],
)
def test_a_killed_render_goes_on_to_the_same_bytes(layout, when, stand, whole, tmp_path):
    folder = tmp_path / "killed"
    command = [sys.executable, small_sets.__file__, layout, folder, *when]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert done.returncode == -9, done.stderr
    assert render_small(folder, Layout(layout)) == stand
    assert tree(folder) == whole(layout)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_finished_set_is_left_alone(layout, tmp_path):
    render_small(tmp_path / "set", layout)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "set").rglob("*")}
    assert render_small(tmp_path / "set", layout) == SCENES
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "set").rglob("*")} == before


@pytest.mark.parametrize(("layout", "stand"), [("folder", 4), ("shards", 3)])
def test_a_set_is_made_larger(layout, stand, whole, tmp_path):
    render_small(tmp_path / "set", Layout(layout), scenes=4)
    assert render_small(tmp_path / "set", Layout(layout)) == stand
    assert tree(tmp_path / "set") == whole(layout)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"layout": Layout.SHARDS}, "format: expected folder as it was begun, got shards"),
        # Once told as too few scenes.
        ({"layout": Layout.SHARDS, "scenes": SCENES - 1}, "format: expected folder as it was begun, got"),
        ({"source": small_source(seed=2)}, "seed: expected 1 as it was begun, got 2"),
        ({"source": small_source(frames=4)}, "frames: expected 3 as it was begun, got 4"),
        ({"scenes": SCENES - 1}, "scenes: expected at least 7, got 6"),
    ],
)
def test_other_settings_are_refused(changes, said, tmp_path):
    render_small(tmp_path / "set")
    before = tree(tmp_path / "set")
    with pytest.raises(BadInput, match=said):
        render_small(tmp_path / "set", **changes)
    assert tree(tmp_path / "set") == before


def test_other_peoples_folders_are_refused(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"sun")
    with pytest.raises(BadInput, match="--out: expected a new or empty folder"):
        render_small(tmp_path)


def test_a_folder_that_somebody_looked_at_is_empty(tmp_path):
    """Found in review: Finder leaves .DS_Store in a new folder, and it was refused."""
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / ".DS_Store").write_bytes(b"icons")
    render_small(tmp_path / "set")
    assert open_stored_set(tmp_path / "set").entries


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(BadInput, match="--out: expected a new or empty folder"):
        render_small(tmp_path / "file")


@pytest.mark.parametrize("text", ["", "{", '{"args": {}}', "[]"])
def test_a_damaged_record_is_named(text, tmp_path):
    render_small(tmp_path / "set")
    (tmp_path / "set" / "stillbox.json").write_text(text)
    with pytest.raises(BadInput, match=r"record of a set .*stillbox\.json"):
        render_small(tmp_path / "set")


@contextmanager
def small_disk(folder, size):
    """A disk of `size` bytes; skips where this user may not mount one."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize(("layout", "size"), [("folder", "160k"), ("shards", "72k")])
def test_a_full_disk_leaves_what_is_valid(layout, size, whole, tmp_path):
    with small_disk(tmp_path / "disk", size) as disk:
        with pytest.raises(OSError, match="No space left"):
            render_small(disk / "set", Layout(layout))
        found = tree(disk / "set")
        if layout == "folder":
            assert 0 < len(list(open_stored_set(disk / "set"))) < SCENES
        else:
            assert list(found) == ["small-000000.tar", "stillbox.json"]
        subprocess.run(["mount", "-o", "remount,size=4m", str(disk)], check=True)
        assert 0 < render_small(disk / "set", Layout(layout)) < SCENES
        assert tree(disk / "set") == whole(layout)


def test_a_write_that_fails_leaves_what_is_valid(monkeypatch, whole, tmp_path):
    """The same without a small disk, for users who may not mount one."""
    left, write = [27], pathlib.Path.write_bytes

    def write_bytes(path: Path, data: bytes) -> int:
        left[0] -= 1
        if left[0] < 0:
            write(path, data[:10])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(pathlib.Path, "write_bytes", write_bytes)
        with pytest.raises(OSError, match="No space left"):
            render_small(tmp_path / "set")
    assert len(list(open_stored_set(tmp_path / "set"))) == 4
    assert render_small(tmp_path / "set") == 4
    assert tree(tmp_path / "set") == whole("folder")
