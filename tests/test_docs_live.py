"""The commands of docs/live.md: each is understood, and the one that needs no drone runs."""

import re
import shlex
from pathlib import Path

import pytest
import typer

from flightdepth import cli
from flightdepth.commands.live_settings import LiveSettings
from flightdepth.errors import BadInput
from flightdepth.live.mavlink_link import check_address
from flightdepth.live.video_address import video_address

TEXT = (Path(__file__).parents[1] / "docs" / "live.md").read_text(encoding="utf-8")
COMMANDS = [
    line for block in re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL) for line in block.strip().splitlines()
]
SAMPLE = Path(cli.__file__).parent / "sample"


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_is_understood(command, monkeypatch):
    monkeypatch.chdir(SAMPLE)
    root = typer.main.get_command(cli.app)
    name, *arguments = shlex.split(command)[1:]
    options = root.commands[name].make_context(name, arguments).params
    settings = LiveSettings(**options)
    assert video_address(settings.video).name == settings.video
    if settings.mavlink is not None:
        check_address(settings.mavlink)


def test_the_recorded_flight_plays(monkeypatch, capsys, save_difference_network):
    monkeypatch.chdir(SAMPLE)
    played = shlex.split(next(command for command in COMMANDS if "--duration" in command))[1:]
    played[played.index("--duration") + 1] = "7"  # the rate is of three seconds then, on a busy machine too
    assert cli.main([*played, "--network", str(save_difference_network())]) == 0
    said = capsys.readouterr().out
    assert "telemetry 2" in said  # 20 Hz, or a little more
    assert re.search(r"[1-9]\d* of \d+ pictures used in", said)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ([], "Give --telemetry LOG or --mavlink LINK."),
        (["--mavlink", "udpin:0.0.0.0:14550", "--telemetry", "telemetry.csv"], "one of them"),
        (["--telemetry", "telemetry.csv", "--obstacles"], "--dry-run"),
        (["--telemetry", "telemetry.csv", "--camera-delay-ms", "-1"], "0 to less than 10000"),
        (["--telemetry", "telemetry.csv", "--telemetry-offset", "nan"], "finite"),
        (["--telemetry", "telemetry.csv", "--duration", "inf"], "more than 0"),
        (["--telemetry", "telemetry.csv", "--ranges", "5"], "1 to 4"),
        (["--telemetry", "telemetry.csv", "--mount", "fixed", "--mount-pitch", "100"], "-90 to 90"),
    ],
)
def test_settings_that_make_no_sense_are_one_line(
    more, expected, monkeypatch, capsys, save_difference_network
):
    monkeypatch.chdir(SAMPLE)
    network = ["--network", str(save_difference_network())]
    assert cli.main(["live", "--video", "flight.mp4", "--hfov", "75", *network, *more]) == BadInput.exit_code
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
