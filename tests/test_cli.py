"""The frame of the command line: help, version, exit codes, and that it starts quickly."""

import os
import subprocess
import sys

import pytest
import typer

from flightdepth import __version__, cli
from flightdepth.errors import BadInput, FlightDepthError


@pytest.fixture
def failing(monkeypatch):
    """A command line whose only command, `fail`, raises what it is given."""

    def main(error, *arguments):
        app = typer.Typer(pretty_exceptions_enable=False)

        @app.callback()
        def root():
            pass

        @app.command()
        def fail():
            raise error

        monkeypatch.setattr(cli, "app", app)
        return cli.main(["fail", *arguments])

    return main


def test_bad_input_is_one_line_and_2(failing, capsys):
    assert failing(BadInput("camera", expected="a focal length", got="none", mend="Give --hfov.")) == 2
    assert capsys.readouterr().err == "error: camera: expected a focal length, got none. Give --hfov.\n"


def test_what_could_not_run_is_3(failing, capsys):
    assert failing(FlightDepthError("no such device")) == 3
    assert capsys.readouterr().err == "error: no such device\n"


def test_a_full_disk_is_3(failing, capsys):
    assert failing(OSError(28, "No space left on device")) == 3
    assert capsys.readouterr().err == "error: [Errno 28] No space left on device\n"


def test_ctrl_c_is_130(failing, capsys):
    assert failing(KeyboardInterrupt()) == 130
    assert "Traceback" not in capsys.readouterr().err


def test_our_own_bugs_are_not_hidden(failing):
    with pytest.raises(ZeroDivisionError):
        failing(ZeroDivisionError())


def test_an_error_of_several_lines_becomes_one(failing, capsys):
    failing(FlightDepthError("first\nsecond"))
    assert capsys.readouterr().err == "error: first second\n"


def test_a_long_error_is_not_wrapped(failing, capsys):
    failing(FlightDepthError("word " * 100 + "end"))
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_brackets_in_an_error_are_kept(failing, capsys):
    failing(FlightDepthError("pip install 'flightdepth[train]'"))
    assert "flightdepth[train]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("encoding", "shown"), [("cp1252", b"Fl\xfcge \\u03a9\n"), ("ascii:strict", b"Fl\\xfcge \\u03a9\n")]
)
def test_a_name_that_stdout_cannot_write_ends_nothing(encoding, shown):
    """On Windows a file or a pipe takes the letters of one language only."""
    code = (
        "from flightdepth import cli\n"
        "from flightdepth.commands.terminal import say\n"
        "cli.app = lambda *_, **named: say('Fl\\u00fcge \\u03a9')\n"
        "cli.main([])\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
        capture_output=True,
    )
    assert (told.stdout, told.stderr) == (shown, b"")


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"flightdepth {__version__}\n"


def test_help_shows_how_to_start(capsys):
    assert cli.main(["--help"]) == 0
    examples = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert "flightdepth run VIDEO" in examples


def test_the_help_of_run_has_examples(capsys):
    assert cli.main(["run", "--help"]) == 0
    examples = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert "flightdepth run flight.mp4" in examples


def every_command(command, words=()):
    """The words of each command, and its parameters."""
    if not isinstance(command, typer.core.TyperGroup):
        return {words: command.params}
    parts = (every_command(part, (*words, name)) for name, part in command.commands.items())
    return {name: parameters for part in parts for name, parameters in part.items()}


COMMANDS = every_command(typer.main.get_command(cli.app))


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_says_all_in_80_columns(words, monkeypatch, capsys):
    """Names of options were cut short, and --start of an evaluation said nothing but S."""
    monkeypatch.setenv("COLUMNS", "80")
    assert cli.main([*words, "--help"]) == 0
    assert "\N{HORIZONTAL ELLIPSIS}" not in capsys.readouterr().out
    assert [parameter.name for parameter in COMMANDS[words] if not parameter.help] == []


@pytest.fixture
def help_paragraphs(monkeypatch, capsys):
    """What the help of a command says above its options in so many columns, paragraph by paragraph."""

    def paragraphs(words, columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        assert cli.main([*words, "--help"]) == 0
        above, *_ = capsys.readouterr().out.partition("\N{BOX DRAWINGS LIGHT ARC DOWN AND RIGHT}")
        return "\n".join(line.rstrip() for line in above.splitlines()).strip().split("\n\n")

    return paragraphs


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_help_is_not_broken_anew_in_80_columns(words, help_paragraphs):
    """A line of `convert` ended after its first two words, and an example of `render` ran over two."""
    after_usage_and_summary = slice(2, None)
    narrow, wide = (help_paragraphs(words, columns)[after_usage_and_summary] for columns in (80, 200))
    assert narrow == wide


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_examples_in_a_help_can_be_pasted(words, help_paragraphs):
    """Those of `live` ran over two lines, and the shell took the first for all of it."""
    examples = [part for part in help_paragraphs(words, 80) if part.startswith("   flightdepth ")]
    assert [line for part in examples for line in part.splitlines()[:-1] if not line.endswith(" \\")] == []


def test_an_unknown_option_is_2(capsys):
    assert cli.main(["run", "flight.mp4", "--frobnicate"]) == 2


def test_an_unknown_command_is_2(capsys):
    assert cli.main(["fly"]) == 2


def test_networks_lists_what_ships(capsys):
    assert cli.main(["networks"]) == 0
    assert capsys.readouterr().out.strip()


def test_the_command_line_loads_nothing_heavy():
    heavy = ("numpy", "cv2", "av", "openvino", "pydantic", "torch", "numba")
    script = f"import sys, flightdepth.cli; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
