"""Files and folders where Windows says no: what is open there cannot be moved."""

from pathlib import Path

import pytest

from flightdepth import files
from flightdepth.errors import FlightDepthError
from flightdepth.files import folder_in_progress, move_folder, write_atomic

IN_USE = PermissionError(13, "Access is denied")


@pytest.fixture
def scanner(monkeypatch):
    """Refuses the first moves of what a rule says, as a virus scanner does that looks at new files."""

    def refuse(name, times, of=lambda path: True):
        move, left = getattr(Path, name), [times]

        def moved(self, place):
            if of(self) and left[0] > 0:
                left[0] -= 1
                raise IN_USE
            return move(self, place)

        monkeypatch.setattr(Path, name, moved)
        return left

    monkeypatch.setattr(files, "PATIENCE_S", (0.0, 0.0))  # as on Windows, but for the time
    return refuse


def test_a_file_that_a_scanner_looks_at_is_written_all_the_same(tmp_path, scanner):
    scanner("replace", 2)
    write_atomic(tmp_path / "flight.ply", b"ply")
    assert (tmp_path / "flight.ply").read_bytes() == b"ply"


def test_nor_is_a_folder_lost(tmp_path, scanner):
    scanner("rename", 2)
    with folder_in_progress(tmp_path / "out") as folder:
        (folder / "new").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "new"]


def test_what_stays_in_use_is_told(tmp_path, scanner):
    left = scanner("rename", 9)
    (tmp_path / "a").mkdir()
    with pytest.raises(PermissionError):
        move_folder(tmp_path / "a", tmp_path / "b")
    assert left == [6]


def test_an_older_result_that_is_open_in_a_player_costs_no_flight(tmp_path, scanner):
    target = tmp_path / "out"
    (target / "old").mkdir(parents=True)
    (tmp_path / "out.new-1").mkdir()
    scanner("rename", 99, of=lambda path: path == target)
    with (
        pytest.raises(
            FlightDepthError, match=r"open in another program\? The new one stands in .*out\.new-2"
        ),
        folder_in_progress(target) as folder,
    ):
        (folder / "new").touch()
    names = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")}
    assert names == {"out", "out/old", "out.new-1", "out.new-2", "out.new-2/new"}


def test_the_folder_is_not_its_owners_alone(tmp_path, monkeypatch):
    """Of a mode of 0o700 Windows makes a list of who may enter, which no chmod changes (Python 3.11.10, 3.12.4)."""
    made, mkdir = [], files.os.mkdir
    monkeypatch.setattr(
        "os.mkdir", lambda path, mode=0o777, **rest: (made.append(mode), mkdir(path, mode, **rest))
    )
    (tmp_path / "out").mkdir()
    with folder_in_progress(tmp_path / "out"):
        pass
    assert set(made) == {0o777}
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o755
