"""Comparing two renderers: what is an edge, what is counted, and the command's way out without Blender."""

import json

import numpy as np
import pytest

from flightdepth import cli
from flightdepth.commands.renderers import show
from flightdepth.evaluation.renderer import Frame, edges, figures, picture
from flightdepth.renderers.blender_process import VARIABLE, find_blender

SIZE = 24


def plane(slope: float) -> np.ndarray:
    """Depth of a plane: inverse depth is linear in pixels."""
    return (1 / (0.05 + slope * np.arange(SIZE) / SIZE)[None].repeat(SIZE, 0)).astype(np.float32)


def frame(ours, theirs, colour=0) -> Frame:
    image = np.full((SIZE, SIZE, 3), 100, np.uint8)
    return Frame(0, image, (image + colour).astype(np.uint8), ours, theirs)


@pytest.mark.parametrize("slope", [0.0, 0.05, 5.0])
def test_a_plane_has_no_edges_however_slanted(slope):
    assert not edges(plane(slope)).any()
    assert not edges(plane(slope).T).any()


def test_a_step_is_an_edge_on_both_sides_and_nowhere_else():
    depth = plane(0.0)
    depth[:, 10:] *= 1.05
    assert np.flatnonzero(edges(depth).any(axis=0)).tolist() == [8, 9, 10, 11]
    assert np.flatnonzero(edges(depth.T).any(axis=1)).tolist() == [8, 9, 10, 11]


def test_the_skyline_is_an_edge_and_the_sky_is_none():
    depth = plane(0.0)
    depth[:8] = np.inf
    assert np.flatnonzero(edges(depth).any(axis=1)).tolist() == [6, 7, 8, 9]


def test_equal_renderers_differ_in_nothing():
    result = figures([frame(plane(1.0), plane(1.0))])
    assert (
        result["depth"]["median"] == result["depth"]["off_share"] == result["colour"]["mean_difference"] == 0
    )
    assert result["within_limits"]


def test_a_pixel_off_inside_a_surface_counts_as_an_edge_of_the_one_that_has_it():
    """A speck in one picture makes edges there: it is counted among them, so that share is reported too."""
    speckled = plane(0.0)
    speckled[5, 5] *= 2
    depth = figures([frame(plane(0.0), speckled)])["depth"]
    assert depth["off_share"] == 0
    assert depth["edge_share"] == pytest.approx(21 / SIZE**2)  # a cross, three wide
    assert depth["edge_off_share"] == pytest.approx(1 / 21)


def test_a_surface_that_lies_two_percent_off_is_off():
    result = figures([frame(plane(1.0), plane(1.0) * np.float32(1.02), colour=3)])
    assert result["depth"]["median"] == pytest.approx(0.02, rel=1e-4)
    assert result["depth"]["off_share"] == 1
    assert result["colour"]["mean_difference"] == 3
    assert not result["within_limits"]


def test_sky_in_both_is_agreement_and_in_one_is_not(capsys):
    sky = np.full((SIZE, SIZE), np.inf, np.float32)
    assert figures([frame(sky, sky)])["depth"]["off_share"] == 0
    one = figures([frame(sky, plane(0.0))])
    assert one["depth"]["off_share"] == one["depth"]["sky_in_one_share"] == 1
    assert one["depth"]["median"] is None  # JSON has no infinity
    json.dumps(one, allow_nan=False)
    show(one)
    assert "do NOT agree" in capsys.readouterr().out


def test_small_pictures_may_be_all_edges(capsys):
    """Half of the rooms are at 8 px: nothing lies off edges, and JSON has no NaN for it."""
    crumpled = np.random.default_rng(0).uniform(2, 90, (SIZE, SIZE)).astype(np.float32)
    result = figures([frame(crumpled, crumpled)])
    assert result["depth"]["edge_share"] == 1
    assert json.loads(json.dumps(result, allow_nan=False))["colour"]["mean_difference_off_edges"] is None
    show(result)
    assert "off edges none;" in capsys.readouterr().out


def test_the_picture_shows_both_and_four_times_the_difference():
    drawn = picture([frame(plane(0.0), plane(0.0), colour=3)] * 2)
    assert drawn.shape == (2 * SIZE, 3 * SIZE, 3)
    assert [int(drawn[0, x, 0]) for x in (0, SIZE, 2 * SIZE)] == [100, 103, 12]


def test_without_blender_the_command_says_so_and_ends_with_3(monkeypatch, tmp_path, capsys):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("flightdepth.renderers.blender_process.SOURCES", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["evaluate", "renderer", "--scenes", "1"]) == 3
    error = capsys.readouterr().err
    assert error.startswith("error: Blender is not installed: `make blender-env`")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "value"),
    [("--json", "no/such/folder/a.json"), ("--picture", "no/a.jpg"), ("--picture", "a.exe")],
)
def test_a_target_that_cannot_be_written_is_found_before_rendering(option, value):
    assert cli.main(["evaluate", "renderer", option, value]) == 2


@pytest.mark.slow
@pytest.mark.skipif(find_blender() is None, reason="Blender is not installed: `make blender-env`")
@pytest.mark.parametrize("where", [[], ["--outdoor"]])
def test_the_two_renderers_agree(tmp_path, where):
    target = tmp_path / "figures.json"
    options = ["--scenes", "2", "--size", "64", "--samples", "8", "--threads", "1"]
    assert cli.main(["evaluate", "renderer", *options, *where, "--json", str(target)]) == 0
    assert json.loads(target.read_text())["within_limits"]
