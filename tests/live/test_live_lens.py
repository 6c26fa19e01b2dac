"""What --camera and --hfov of `flightdepth live` mean for pictures of each size, and what turns say of them."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_peers import SAMPLE, skip_where_time_is_not_real, until
from live_runs import running

from flightdepth.errors import BadInput
from flightdepth.flight import BodyAttitudeSample, Telemetry, VelocitySample
from flightdepth.flight.lenses import find_lens
from flightdepth.live import lens_watch
from flightdepth.live.depth_stage import Lens
from flightdepth.live.health import LENS
from flightdepth.live.status import State
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.runtimes.network import load_network

sys.path.append(str(Path(__file__).parents[1] / "flight"))
from turning_videos import looking, simulated, write_video

NAME = "gopro-hero11-linear"


def test_a_name_of_the_table_is_that_lens():
    assert Lens.given(Path(NAME), None).at(1920, 1080) == find_lens(NAME).seen(1920, 1080)


def test_a_field_of_view_holds_for_any_size():
    lens = Lens.given(None, 80.0)
    assert {round(lens.at(*size).horizontal_fov_deg, 6) for size in [(640, 480), (1280, 720)]} == {80.0}


@pytest.mark.parametrize(
    ("given", "hfov_deg", "told"),
    [
        (Path(NAME), None, f"{NAME} in the table of lenses: "),
        (SAMPLE / "camera.json", None, "calibration camera.json"),
        (None, 80.0, "--hfov 80, an ideal lens"),
    ],
)
def test_where_a_camera_comes_from_is_told(given, hfov_deg, told):
    assert Lens.given(given, hfov_deg).source.startswith(told)


def test_a_name_that_no_one_knows_is_refused():
    with pytest.raises(BadInput, match="gopro-hero11"):
        Lens.given(Path("gopro-hero11-liner"), None)


@pytest.mark.parametrize("given", [(None, None), (Path(NAME), 80.0)])
def test_one_of_the_two_is_needed(given):
    with pytest.raises(BadInput, match="one of them"):
        Lens.given(*given)


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A clip of a far landscape through a camera that is screwed to a turning drone, its log, and the camera."""
    case = simulated.Case(simulated.PINHOLE.resized(192, 108), lasts_s=16.0, turn_deg=15.0)
    turned, path = (
        simulated.angles(case, np.random.default_rng(8)),
        tmp_path_factory.mktemp("turns") / "v.mp4",
    )
    write_video(path, case.camera, lambda at_s: looking(case, turned, at_s), lasts_s=16)
    samples, bodies = [], []
    for stamp_ns in range(0, 16 * 10**9, 10**9 // 20):
        body = looking(case, turned, stamp_ns / 1e9) @ NED_FROM_CAMERA.T
        samples.append(VelocitySample(stamp_ns, [1.0 + stamp_ns % 7 * 1e-3, 0, 0]))
        bodies.append(BodyAttitudeSample(stamp_ns, quaternion_from_rotation(body)))
    return path, Telemetry("turns", tuple(samples), body_attitudes=tuple(bodies)), case.camera


@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_live_a_lens_that_its_turns_deny_is_told_while_flying(
    turning, factor, save_difference_network, monkeypatch
):
    skip_where_time_is_not_real()
    for name in ("ENOUGH", "LEAST_NEW"):
        monkeypatch.setattr(lens_watch, name, 25)  # else it would take half a minute
    clip, log, camera = turning
    given = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
    network = load_network(save_difference_network(), device="cpu", threads=1)
    with running(network, str(clip), telemetry=log, camera=given, ranges=1) as run:
        until(lambda: run.engine.status().lens is not None)
        verdict = run.engine.status().lens
        assert verdict.agrees == (factor == 1.0), str(verdict)
        if factor != 1.0:
            assert verdict.found.camera.fx * 192 / 160 == pytest.approx(camera.fx, rel=0.05)
            run.until(State.DEGRADED, LENS)
