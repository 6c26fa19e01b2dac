"""`flightdepth evaluate network --set`: a set on the disk as the test set."""

import json

import pytest

from flightdepth import cli
from flightdepth.stillbox.stored import open_stored_set


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """Two rooms of four frames, 256 px."""
    folder = tmp_path_factory.mktemp("stored")
    (folder / "knobs.toml").write_text("frames = 4\n")
    knobs = ["--scenes", "2", "--seed", "77", "--config", str(folder / "knobs.toml"), "--procedural", "20"]
    assert cli.main(["render", "256", *knobs, "--out", str(folder / "rooms")]) == 0
    return folder / "rooms"


@pytest.mark.parametrize("network", ["motion", "depthnet-256"])
def test_a_network_is_measured_on_a_set_of_the_disk(rooms, tmp_path, network):
    figures = tmp_path / "figures.json"
    assert cli.main(["evaluate", "network", network, "--set", str(rooms), "--json", str(figures)]) == 0
    found = json.loads(figures.read_text())
    assert found["set"].startswith("rooms, 256 px, 90 degrees, by raycast")
    assert found["pairs"] == 2
    assert 0 < found["network"]["l1_m"] < 0.6 * found["constant"]["l1_m"]
    assert sum(row["pixels"] for row in found["network"]["depth_bins"]) == 2 * 64 * 64


def test_held_out_scenes_are_those_that_training_leaves(rooms, tmp_path):
    """All scenes of the set were measured on: four fifths of them `train --set` had learnt from."""
    figures = tmp_path / "figures.json"
    asked = ["--set", str(rooms), "--held-out", "--json", str(figures)]
    assert cli.main(["evaluate", "network", "motion-tiny", *asked]) == 0
    found, held_out = json.loads(figures.read_text()), open_stored_set(rooms).split()[1]
    assert found["pairs"] == 1
    assert found["set"].endswith(f"held-out scenes {held_out.digest}")


def test_only_of_a_set_is_something_held_out(capsys):
    assert cli.main(["evaluate", "network", "motion-tiny", "--held-out"]) == 2
    assert "--held-out: expected --set beside it, got it alone" in capsys.readouterr().err


@pytest.mark.parametrize("beside", [["--outdoor"], ["--fov", "60"], ["--textures", "."]])
def test_one_set_at_a_time(rooms, beside, capsys):
    assert cli.main(["evaluate", "network", "motion", "--set", str(rooms), *beside]) == 2
    assert f"got {beside[0]}" in " ".join(capsys.readouterr().err.split())


def test_what_is_refused_leaves_no_folder(rooms, tmp_path):
    """Once folders were made, the network opened and all photos read before the options were looked at."""
    folders = [each for name in ("--pictures", "--report") for each in (name, str(tmp_path / name))]
    assert cli.main(["evaluate", "network", "motion", "--set", str(rooms), "--outdoor", *folders]) == 2
    assert not any(tmp_path.iterdir())


def test_a_network_for_one_lens_refuses_another(rooms, capsys):
    assert cli.main(["evaluate", "network", "tiny-clamped-512", "--set", str(rooms)]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "expected focal length 256 px, tiny-clamped-512's, got 128 px" in told
