"""Finding Blender, and what a Blender that fails looks like from outside: all with made-up programs."""

import json
import sys
import threading
import time

import pytest
from built_scenes import NO_TEXTURES, built

from flightdepth.camera import Camera
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.renderers import blender, blender_process
from flightdepth.renderers.blender import Blender
from flightdepth.renderers.blender_process import SCRIPT, VARIABLE, Program, find_blender, needed_blender

READY = 'print("flightdepth " + json.dumps({"ready": "9.9"}), flush=True)\n'
CAMERA = Camera.from_fov(8, 8, 90)


@pytest.fixture(autouse=True)
def nowhere(tmp_path, monkeypatch):
    """No Blender anywhere, and temporary files under the eyes of the test."""
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setattr(blender_process, "SOURCES", tmp_path / "sources")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    for name in ("bin", "temporary", "here"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path


def program(path, body):
    """An executable of a few lines of Python."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{sys.executable}\nimport json, sys, time\n{body}")
    path.chmod(0o755)
    return path


def failing(tmp_path, body, **options) -> FlightDepthError:
    """The error of rendering with a Blender that does `body`; checks that it leaves nothing behind."""
    made = Program(program(tmp_path / "bin" / "blender", body), "PATH")
    with pytest.raises(FlightDepthError) as caught, Blender(program=made, **options) as blender:
        blender.render(built(), NO_TEXTURES, CAMERA)
    assert not list((tmp_path / "temporary").iterdir())
    return caught.value


def test_none_is_a_clear_line():
    assert find_blender() is None
    with pytest.raises(FlightDepthError, match="Blender is not installed: `make blender-env`"):
        needed_blender()


def test_the_variable_goes_before_the_environment_and_that_before_the_path(nowhere, monkeypatch):
    on_path = program(nowhere / "bin" / "blender", "")
    assert find_blender() == Program(on_path, "PATH")
    own = program(nowhere / "sources" / ".venv-blender" / "bin" / "python", "")
    assert find_blender() == Program(own, ".venv-blender")
    here = program(nowhere / "here" / ".venv-blender" / "bin" / "python", "")
    assert find_blender() == Program(here, ".venv-blender")
    named = program(nowhere / "elsewhere" / "blender-4.5", "")
    monkeypatch.setenv(VARIABLE, str(named))
    assert find_blender() == Program(named, VARIABLE)


def test_a_variable_that_names_nothing_is_bad_input(monkeypatch):
    monkeypatch.setenv(VARIABLE, "/no/such/blender")
    with pytest.raises(BadInput, match=r"FLIGHTDEPTH_BLENDER: expected Blender, .* got /no/such/blender"):
        find_blender()


def test_a_python_and_a_blender_are_started_each_in_its_way(nowhere):
    assert Program(nowhere / "python3.11", "").command == (str(nowhere / "python3.11"), "-u", str(SCRIPT))
    command = Program(nowhere / "blender", "").command
    assert command[:3] == (str(nowhere / "blender"), "--background", "--factory-startup")
    assert command[-2:] == ("--python", str(SCRIPT))


def test_one_that_ends_at_once_is_quoted(nowhere):
    error = failing(nowhere, 'sys.exit("libXrender.so.1: cannot open shared object file")')
    assert "ended with code 1: libXrender.so.1: cannot open" in str(error)
    assert "\n" not in str(error)


def test_one_that_ends_in_the_middle_is_quoted(nowhere):
    error = failing(
        nowhere, READY + "sys.stdin.readline()\nprint('out of memory', file=sys.stderr)\nsys.exit(9)"
    )
    assert "ended with code 9: out of memory" in str(error)


def test_an_error_inside_blender_is_handed_on(nowhere):
    body = (
        READY
        + 'sys.stdin.readline()\nprint("flightdepth " + json.dumps({"error": "KeyError: tint"}), flush=True)'
    )
    assert "could not render the scene: KeyError: tint" in str(failing(nowhere, body))


def test_one_that_hangs_is_ended(nowhere, monkeypatch):
    monkeypatch.setattr(blender_process, "END_TIMEOUT_S", 0.1)
    began = time.monotonic()
    assert "gave no answer in 0.2 s" in str(failing(nowhere, READY + "time.sleep(60)", timeout_s=0.2))
    assert time.monotonic() - began < 20


def test_a_program_that_cannot_start(nowhere):
    path = nowhere / "bin" / "blender"
    path.write_bytes(b"\x7fELF no program")
    path.chmod(0o755)
    with pytest.raises(FlightDepthError, match="does not start"):
        Blender(program=Program(path, "PATH"))
    assert not list((nowhere / "temporary").iterdir())


def test_a_request_is_plain_data_and_the_frame_is_read_from_its_file(nowhere):
    """A Blender that repeats its request: JSON, arrays without pickles, and then no file is there."""
    body = (
        READY + "request = sys.stdin.readline()\nprint(request, file=sys.stderr)\n"
        'print("flightdepth " + json.dumps({"error": request}), flush=True)'
    )
    said = str(failing(nowhere, body)).split("could not render the scene: ")[1]
    request = json.loads(said)
    assert (request["width"], request["height"], request["samples"]) == (8, 8, 4)
    assert request["objects"] == [f"wall-{part}" for part in range(6)]


def test_threads_share_one_blender_and_each_failure_is_one_line(nowhere, monkeypatch):
    """Each thread began its own, and the failure of one was a traceback of another."""
    starts = nowhere / "starts"
    body = (
        f"open({str(starts)!r}, 'a').write('x')\n"
        + READY
        + "sys.stdin.readline()\ntime.sleep(0.3)\nsys.exit(9)"
    )
    monkeypatch.setenv(VARIABLE, str(program(nowhere / "bin" / "blender", body)))
    errors = []

    def render_one():
        try:
            blender.render(built(), NO_TEXTURES, CAMERA)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=render_one) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [type(error) for error in errors] == [FlightDepthError] * 3
    assert len(starts.read_text()) == 1
