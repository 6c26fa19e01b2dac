"""Where no terminal draws a bar, a line tells now and then how far a command is."""

import time

import pytest

from flightdepth.commands import terminal


def test_a_pipe_gets_lines_on_the_way(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "TOLD_EVERY_S", 0.0)
    told = []
    for _ in terminal.counted(range(3), "flight", "frames"):
        told.append(capsys.readouterr().out)
    assert told[:2] == ["", ""]  # one step says nothing of the speed
    assert told[2].startswith("flight: 2 of 3 frames, ")
    assert told[2].endswith(" min left\n")
    assert "3/3" in capsys.readouterr().out


def test_the_last_seconds_are_not_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It said "0 min left" for half a minute."""
    monkeypatch.setattr(terminal, "TOLD_EVERY_S", 0.0)
    for _ in terminal.counted(range(4), "flight", "frames"):
        pass
    said = capsys.readouterr().out.splitlines()
    assert said[0].endswith("/s, less than 1 min left")


def test_what_was_done_before_is_no_speed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "TOLD_EVERY_S", 0.0)
    with terminal.progress_bar("set", 3, "frames") as bar:
        bar.begin_at(1000, 1010)
        time.sleep(0.2)
        bar.step()
        said = capsys.readouterr().out
    assert said.startswith("set: 1,001 of 1,010 frames, ")
    assert float(said.split(", ")[1].split()[0]) <= 5


def test_a_quick_command_tells_its_end_alone(capsys: pytest.CaptureFixture[str]) -> None:
    for _ in terminal.counted(range(3), "flight", "frames"):
        pass
    assert len(capsys.readouterr().out.splitlines()) == 1
