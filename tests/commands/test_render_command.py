"""`flightdepth render`: what it writes, how it goes on, what it says."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flightdepth import cli
from flightdepth.files import held
from flightdepth.stillbox.stored import open_stored_set

SMALL = ("--size", "16x12", "--procedural", "2", "--config", "short.toml")


@pytest.fixture(autouse=True)
def short_scenes(monkeypatch, tmp_path):
    """A folder to work in, with a file of knobs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text("frames = 2\n")


def render(*arguments, name="64", out="set"):
    return cli.main(["render", name, "--out", out, *SMALL, *arguments])


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in Path(folder).rglob("*") if p.is_file()}


def test_a_folder(capsys):
    assert render("--scenes", "3") == 0
    assert [scene.frames for scene in open_stored_set(Path("set"))] == [2, 2, 2]
    out = capsys.readouterr().out
    assert "set: 3 scenes; --scenes all is 80,000" in out
    assert "set: 3 scenes of 2 frames, 16x12 px, in the folder layout" in out


def test_shards(capsys):
    assert render("--scenes", "3", "--format", "shards", name="256") == 0
    assert sorted(files("set")) == ["stillbox-256-000000.tar", "stillbox.json"]
    assert "in the shards layout" in capsys.readouterr().out


def test_a_hundred_scenes_where_nothing_is_said():
    assert render() == 0
    assert len(open_stored_set(Path("set"))) == 100


def test_the_number_of_scenes_may_stand_in_the_config():
    Path("short.toml").write_text("frames = 2\nscenes = 4\n")
    assert render() == 0
    assert len(open_stored_set(Path("set"))) == 4


def test_all_is_what_the_set_has():
    Path("short.toml").write_text("frames = 2\nscenes = 4\n")  # instead of 80,000
    assert render("--scenes", "all") == 0
    assert len(open_stored_set(Path("set"))) == 4


@pytest.mark.slow  # its textures alone take half a minute of a busy core
def test_an_outdoor_set_has_its_own_textures(capsys):
    assert cli.main(["render", "outdoor", "--scenes", "1", "--size", "16x12", "--out", "set"]) == 0
    scene = open_stored_set(Path("set")).scene(0)
    assert scene.depth_m.max() == np.float32(200)  # the sky, as far as the original's depth goes
    assert "procedural" not in capsys.readouterr().out


@pytest.mark.parametrize(("option", "value"), [("--textures", "photos"), ("--procedural", "2")])
def test_other_textures_for_an_outdoor_set_are_refused(option, value, capsys):
    """`--procedural` was passed over."""
    assert cli.main(["render", "outdoor", option, value, "--size", "16x12", "--out", "set"]) == 2
    assert f"{option}: expected none: this set brings its own, got {value}" in capsys.readouterr().err
    assert not Path("set").exists()


def test_the_same_command_says_that_all_is_done(capsys):
    render("--scenes", "2")
    before = files("set")
    assert render("--scenes", "2") == 0
    assert "set: finished before, nothing to do; a larger --scenes makes it larger" in capsys.readouterr().out
    assert files("set") == before


def test_a_set_goes_on(capsys):
    render("--scenes", "3")
    assert render("--scenes", "5") == 0
    assert "set: 3 of 5 scenes stand; going on" in capsys.readouterr().out
    render("--scenes", "5", out="whole")
    assert files("set") == files("whole")


def test_ctrl_c_leaves_what_is_valid(monkeypatch):
    from flightdepth.stillbox.original_layout import OriginalLayout

    add = OriginalLayout.add

    def interrupted(layout, scene):
        if scene.number == 2:
            raise KeyboardInterrupt
        add(layout, scene)

    with monkeypatch.context() as patch:
        patch.setattr(OriginalLayout, "add", interrupted)
        assert render("--scenes", "4") == 130
    assert len(list(open_stored_set(Path("set")))) == 2
    assert render("--scenes", "4") == 0
    render("--scenes", "4", out="whole")
    assert files("set") == files("whole")


def test_the_seed_and_the_knobs_stand_in_the_metadata():
    assert render("--scenes", "1", "--seed", "7") == 0
    facts = json.loads(Path("set/00/metadata.json").read_text())["args"]
    assert (facts["seed"], facts["frames"], facts["resolution"], facts["textures"]) == (7, 2, [16, 12], 2)


def test_a_full_disk_is_one_line(tmp_path, capsys):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=120k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    try:
        assert render("--scenes", "40", out=str(disk / "set")) == 3
        assert 0 < len(list(open_stored_set(disk / "set"))) < 40
    finally:
        subprocess.run(["umount", str(disk)], check=True)
    error = capsys.readouterr().err
    assert error == (
        f"error: no room left on the disk of {disk / 'set'}; what stands there is valid."
        " Free some room and give the same command again\n"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--scenes", "0"], "--scenes: expected a number from 1 on, or all, got 0"),
        (["--scenes", "many"], "--scenes: expected a number from 1 on, or all, got many"),
        (["--size", "64"], "--size: expected WIDTHxHEIGHT in pixels, such as 512x288, got 64"),
        (["--size", "0x12"], "width of a set: expected a whole number from 1 on"),
        (["--size", "70000x12"], "pictures of a set: expected at most 65,500 px a side, as JPEG"),
        (["--config", "nowhere.toml"], "config nowhere.toml"),
        (["--address", "auto"], "--address: expected --engine ray beside it, got --engine threads"),
        (["--out", "."], "--out: expected a new or empty folder"),
        (["--procedural", "0"], "--procedural: expected at least 1"),
    ],
)
def test_bad_input_is_one_line(arguments, said, capsys):
    assert render(*arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_pictures_that_no_memory_holds_are_one_line(monkeypatch, capsys):
    """numpy's MemoryError ended it, in a traceback."""
    monkeypatch.setattr("flightdepth.renderers.raycast.memory_bytes", lambda: 1e9)
    assert cli.main(["render", "64", "--size", "30000x30000", "--scenes", "1", "--out", "set"]) == 2
    assert capsys.readouterr().err == (
        "error: pictures of a scene: expected at most 0.8 GB of memory,"
        " got 88.2 GB, for 10 of 30000x30000 px. Smaller pictures, or fewer frames.\n"
    )
    assert not Path("set").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks")
@pytest.mark.parametrize("layout", ["folder", "shards"])
def test_a_set_is_one_render_s_at_a_time(layout, capsys):
    """Two cut each other's shards short: one took its name with a hole in it."""
    command = ("--scenes", "2", "--format", layout)
    with held(Path("set"), "set", "render", "wait"):
        assert render(*command) == 2
        assert not files("set")
    assert "set set: expected no other render in it, got one that is running. Wait" in capsys.readouterr().err
    assert render(*command) == 0


def test_a_config_is_a_table_of_knobs(capsys):
    Path("short.toml").write_text('name = "mine"\n')
    assert render() == 2
    assert "set, name: expected keys from scenes, width" in capsys.readouterr().err


def test_an_option_comes_before_the_config():
    Path("short.toml").write_text("frames = 2\nseed = 3\n")
    assert render("--scenes", "1", "--seed", "4") == 0
    assert json.loads(Path("set/00/metadata.json").read_text())["args"]["seed"] == 4


def test_without_a_terminal_there_are_lines(monkeypatch, capsys):
    monkeypatch.setattr("flightdepth.commands.terminal.TOLD_EVERY_S", 0.0)
    assert render("--scenes", "3") == 0
    lines = [
        line for line in capsys.readouterr().out.splitlines() if "frames/s" in line and "min left" in line
    ]
    assert [line.split(",")[0] for line in lines] == [f"Still Box 64: {n} of 6 frames" for n in (2, 4, 6)]


def test_an_unknown_set_is_one_line(capsys):
    assert render(name="1024") == 2
    assert "set: expected one of 64, 128, 256, 512, outdoor, got '1024'" in capsys.readouterr().err


def test_other_settings_are_refused(capsys):
    render("--scenes", "1")
    assert render("--scenes", "1", "--seed", "2") == 2
    error = capsys.readouterr().err
    assert (
        "set set, seed: expected 1 as it was begun, got 2. Give the same settings, or another --out." in error
    )


def test_without_ray_it_says_which_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert render("--engine", "ray") == 3
    assert "pip install 'flightdepth[cluster]'" in capsys.readouterr().err
    assert not Path("set").exists()


def test_help_teaches(capsys):
    assert cli.main(["render", "--help"]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert "flightdepth render 64 --out stillbox-64" in lines
    assert "flightdepth render 256 --scenes all --out stillbox-256" in lines
