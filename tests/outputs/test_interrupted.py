"""What killed recordings left; at first on a system without locks."""

import os
from pathlib import Path

import pytest

from flightdepth import files
from flightdepth.errors import BadInput
from flightdepth.outputs.interrupted import RECORDING, check_alone, keep_interrupted


@pytest.fixture
def windows(monkeypatch):
    """No locks; and a folder whose files are open cannot be moved, though what is not open in it can be removed."""
    monkeypatch.setattr(files, "fcntl", None)
    rename = Path.rename

    def moved(self, place):
        if (self / "open").exists():
            raise PermissionError(13, "Access is denied")
        return rename(self, place)

    monkeypatch.setattr(Path, "rename", moved)


def test_a_recording_that_is_being_written_is_left_alone(tmp_path, windows):
    """One without a frame yet lost its flight.json."""
    folder = tmp_path / ".out.recording-abcd1234"
    for name in ("depth/000000.png", "flight.json", "open"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    before = sorted(tmp_path.rglob("*"))
    assert keep_interrupted(tmp_path / "out") == []
    (folder / "depth/000000.png").unlink()
    assert keep_interrupted(tmp_path / "out") == []
    assert sorted(tmp_path.rglob("*")) == [path for path in before if path.name != "000000.png"]


def test_one_that_nobody_writes_is_named_or_removed(tmp_path, windows):
    for number, name in enumerate(("depth/000000.png", "flight.json")):
        file = tmp_path / f".out.recording-abcd123{number}" / name
        file.parent.mkdir(parents=True)
        file.touch()
    assert keep_interrupted(tmp_path / "out") == [tmp_path / "out.interrupted-1"]
    assert [path.name for path in tmp_path.iterdir()] == ["out.interrupted-1"]


def left_by_a_kill(folder, *names):
    """Folders of a frame each, in a folder."""
    for name in names:
        depth = folder / name / "depth"
        depth.mkdir(parents=True)
        (depth / "000000.png").write_text(name)


def test_the_oldest_is_named_first(tmp_path):
    names = [f".out.recording-{letter * 8}" for letter in "abc"]
    left_by_a_kill(tmp_path, *names)
    for name, stamp_s in zip(names, (300, 100, 200), strict=True):
        os.utime(tmp_path / name, (stamp_s, stamp_s))
    kept = keep_interrupted(tmp_path / "out")
    assert kept == [tmp_path / f"out.interrupted-{number}" for number in (1, 2, 3)]
    assert [(place / "depth/000000.png").read_text()[-1] for place in kept] == ["b", "c", "a"]


@pytest.mark.parametrize("name", ["flight (1) + more", "a.b", "[x]"])
def test_a_name_means_itself_alone(tmp_path, name):
    """Not what its brackets and dots mean in a pattern."""
    others = (".axb.recording-abcd1234", ".x.recording-abcd1234", f".{name}.recording-abcd1234.mine")
    left_by_a_kill(tmp_path, f".{name}.recording-abcd1234", *others)
    assert keep_interrupted(tmp_path / name) == [tmp_path / f"{name}.interrupted-1"]
    assert all((tmp_path / other).is_dir() for other in others)


def test_what_a_link_leads_to_is_kept_beside_it(tmp_path):
    """There it was written."""
    disk = tmp_path / "disk"
    left_by_a_kill(disk, ".flight.recording-abcd1234")
    (tmp_path / "out").symlink_to(disk / "flight")
    assert keep_interrupted(tmp_path / "out") == [disk / "flight.interrupted-1"]


def test_a_folder_is_written_by_one_at_a_time(tmp_path):
    with files.folder_in_progress(tmp_path / "out", kind=RECORDING):
        with pytest.raises(BadInput, match="no other run or recording that writes it"):
            check_alone(tmp_path / "out")
        check_alone(tmp_path / "other")
    check_alone(tmp_path / "out")


def test_what_a_killed_one_left_keeps_nobody_off(tmp_path):
    left_by_a_kill(tmp_path, ".out.recording-abcd1234")
    check_alone(tmp_path / "out")
