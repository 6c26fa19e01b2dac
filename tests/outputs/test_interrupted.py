"""What killed recordings left, on a system without locks."""

from pathlib import Path

import pytest

from flightdepth import files
from flightdepth.outputs.interrupted import keep_interrupted


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
