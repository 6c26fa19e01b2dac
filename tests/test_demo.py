"""The sample flight that ships with the package, and `flightdepth demo` on it."""

import runpy
import signal
import subprocess
import sys
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from flightdepth import flight
from flightdepth.cli import main
from flightdepth.commands.demo import (
    CALIBRATION,
    LOG,
    POSES,
    SAMPLE,
    TRUTH,
    TRUTH_OFFSET_PX,
    TRUTH_STEP_PX,
    VIDEO,
    Moment,
    Witness,
    peer_depth,
)
from flightdepth.flight import AttitudeSample, Frame, VelocitySample, open_flight, read_csv
from flightdepth.flight.camera_file import read_camera
from flightdepth.motion import rotation_from_quaternion
from flightdepth.outputs import FlightFolder, read_depth
from flightdepth.ranges import RangedDepth
from flightdepth.ranges.displacement import integrate
from tests_networks import difference_card

FRAMES = 300
CAMERA = read_camera(CALIBRATION)
SKY_M = 655.35
MAKER = Path(__file__).parents[1] / "benchmarks" / "make_sample.py"


@pytest.fixture(scope="module")
def poses():
    return np.loadtxt(POSES, delimiter=",", skiprows=1)


@pytest.fixture(scope="module")
def frames():
    """The first 100 pictures."""
    with open_flight(VIDEO, LOG, CALIBRATION) as flight:
        return list(islice((event for event in flight if isinstance(event, Frame)), 100))


def truth(frame):
    return read_depth(TRUTH / f"{frame:06d}.png")


def truth_rays():
    return CAMERA.rays()[TRUTH_OFFSET_PX::TRUTH_STEP_PX, TRUTH_OFFSET_PX::TRUTH_STEP_PX]


# The sample


def test_the_sample_fits_into_the_package():
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*")) < 4_000_000


def test_the_video_has_the_stated_length():
    with open_flight(VIDEO, LOG, CALIBRATION) as flight:
        stamps = [event.stamp_ns for event in flight if isinstance(event, Frame)]
        assert flight.counts == {}
    assert len(stamps) == FRAMES
    assert np.diff(stamps) == pytest.approx(1e9 / 30, abs=2)


def test_there_is_a_pose_for_every_frame(poses):
    assert poses[:, 0] == pytest.approx(np.arange(FRAMES) * 1e9 / 30, abs=2)


def test_the_log_spans_the_video(poses):
    first, last = read_csv(LOG).span_ns
    assert first <= 0
    assert last >= poses[-1, 0]


def test_the_logged_velocity_integrates_to_the_true_path(poses):
    samples = [sample for sample in read_csv(LOG).samples if isinstance(sample, VelocitySample)]
    stamps = np.array([sample.stamp_ns for sample in samples])
    velocity = np.array([sample.velocity for sample in samples])
    position, _ = integrate(stamps, velocity, poses[:, 0].astype(np.int64))
    drift = np.linalg.norm(position - (poses[:, 1:4] - poses[0, 1:4]), axis=1)
    assert drift.max() < 0.15  # noise of 0.05 m/s at 20 Hz walks by 0.04 m in 10 s, per axis


def test_the_log_and_the_poses_agree_on_the_orientation(poses):
    logged = {tuple(s.world_from_camera) for s in read_csv(LOG).samples if isinstance(s, AttitudeSample)}
    assert len(logged) == 1
    assert poses[:, 4:8] == pytest.approx(np.tile(logged.pop(), (FRAMES, 1)), abs=1e-8)


@pytest.mark.parametrize(("first", "second"), [(60, 70), (150, 160), (230, 240)])
def test_the_truth_of_two_frames_agrees_with_the_motion(poses, first, second):
    turn = rotation_from_quaternion(poses[first, 4:8])
    displacement = (poses[first, 1:4] - poses[second, 1:4]) @ turn
    moved = truth_rays() * truth(first)[..., None] + displacement  # X_previous = X_current + displacement
    x = (moved[..., 0] / moved[..., 2] * CAMERA.fx + CAMERA.cx - TRUTH_OFFSET_PX) / TRUTH_STEP_PX
    y = (moved[..., 1] / moved[..., 2] * CAMERA.fy + CAMERA.cy - TRUTH_OFFSET_PX) / TRUTH_STEP_PX
    there = truth(second)
    inside = (x >= 0) & (x <= there.shape[1] - 1) & (y >= 0) & (y <= there.shape[0] - 1)
    seen = inside & (truth(first) < SKY_M)
    found = there[y[seen].round().astype(int), x[seen].round().astype(int)]
    # What is hidden in one of the frames, and slopes within a pixel, keep this from being all. With the
    # displacement the wrong way round it is under 0.4.
    assert (np.abs(found / moved[..., 2][seen] - 1) < 0.05).mean() > 0.8


def test_the_truth_knows_every_pixel_and_holds_near_far_and_sky():
    depths = np.stack([truth(frame) for frame in range(10, FRAMES, 10)])
    assert np.isfinite(depths).all()
    assert (depths < 15).mean() > 0.1
    assert ((depths > 50) & (depths < SKY_M)).mean() > 0.1
    assert (depths >= SKY_M).mean() > 0.2
    assert not ((depths > 500) & (depths < SKY_M)).any()


def test_the_truth_can_be_made_again():
    pytest.importorskip("numba")
    from flightdepth.outputs.encoding import centimetres_from_depth, depth_from_centimetres

    maker = runpy.run_path(str(MAKER))
    scene, textures = maker["draw_outdoor"](maker["CONFIG"], maker["SEED"]), maker["outdoor_textures"](0)
    depth_m = maker["render"](scene, textures, maker["truth_camera"](), frames=[120]).depth_m[0]
    again = depth_from_centimetres(centimetres_from_depth(depth_m))
    assert (np.abs(again - truth(120)) < 0.011).all()


def test_the_video_shows_the_scene(frames):
    pytest.importorskip("numba")
    maker = runpy.run_path(str(MAKER))
    scene, textures = maker["draw_outdoor"](maker["CONFIG"], maker["SEED"]), maker["outdoor_textures"](0)
    part = CAMERA.cropped(200, 100, 160, 96)
    image = maker["render"](scene, textures, part, frames=[80]).images[0].astype(float)
    shown = frames[80].image[100:196, 200:360].astype(float)
    assert 10 * np.log10(255**2 / ((image - shown) ** 2).mean()) > 27  # dB


# The comparison


def unknown(height, width):
    return np.full((height, width), np.nan, np.float32)


def test_the_witness_keeps_the_pictures_that_were_paired(frames):
    witness = Witness()
    depth_m = unknown(CAMERA.height, CAMERA.width)
    one = np.ones(1)
    for frame in frames[:30]:
        result = RangedDepth(
            depth_m, depth_m, None, unknown(2, 2)[None], np.array([5]), one, one, depth_m, depth_m, 1.0
        )
        if frame.index >= 5:
            witness.see(frame, result)
        else:
            witness.see(frame, RangedDepth.unknown(CAMERA.height, CAMERA.width, "first frames", 0.0))
    assert [moment.index for moment in witness.moments] == [10, 20]
    assert witness.moments[1].previous[0] is frames[15].image


def test_the_peer_finds_the_depth(frames, poses):
    moment = Moment(80, frames[80].image, unknown(CAMERA.height, CAMERA.width), (6,), (frames[74].image,))
    depth_m = peer_depth(moment, poses, CAMERA, difference_card())
    at_truth = depth_m[TRUTH_OFFSET_PX::TRUTH_STEP_PX, TRUTH_OFFSET_PX::TRUTH_STEP_PX]
    near = truth(80) < 50
    assert np.nanmedian(np.abs(at_truth / truth(80) - 1)[near]) < 0.06


def test_the_peer_has_no_depth_without_a_pair(frames, poses):
    moment = Moment(10, frames[10].image, unknown(CAMERA.height, CAMERA.width), (), ())
    assert np.isnan(peer_depth(moment, poses, CAMERA, difference_card())).all()


# The command


@pytest.fixture
def demo(save_difference_network, tmp_path, capsys):
    """Run the command with the hand-made network; (exit code, stdout, stderr)."""
    network = save_difference_network()

    def call(*arguments):
        code = main(["demo", "--out", str(tmp_path / "out"), "--network", str(network), *arguments])
        return code, *capsys.readouterr()

    return call


@pytest.fixture(params=[pytest.param(FRAMES, marks=pytest.mark.slow), 60])
def shown(request, monkeypatch):
    """How many pictures of the sample the command sees: all, or those of its first two seconds."""
    end_s = None if request.param == FRAMES else request.param / 30
    monkeypatch.setattr(flight, "open_flight", partial(open_flight, end_s=end_s))
    return request.param


def test_sigterm_clears_away_what_the_demo_began(demo, monkeypatch):
    """It ended Python at once, and left a hidden folder."""

    def interrupted(*_):
        handler = signal.getsignal(signal.SIGTERM)
        assert callable(handler)
        handler(signal.SIGTERM, None)

    monkeypatch.setattr(flight, "open_flight", interrupted)
    assert demo()[0] == 130


def test_the_demo_runs_end_to_end(demo, shown, tmp_path):
    code, stdout, _ = demo()
    assert code == 0
    for word in ("near, 0-15 m", "middle, 15-50 m", "far, 50-150 m", "network", "classical", "preview.mp4"):
        assert word in stdout
    folder = FlightFolder(tmp_path / "out")
    assert folder.record.counts.frames == shown
    assert sum(bool(row.shifts) for row in folder.rows) > shown - 0.02 * FRAMES
    assert folder.record.counts.dropped == {}


def test_the_comparison_needs_no_extra():
    extras = ("torch", "numba", "accelerate", "onnx", "onnxruntime")
    script = (
        f"import sys; sys.modules.update(dict.fromkeys({extras}))\n"  # None makes an import of them fail
        "import numpy, flightdepth.commands.demo as demo\n"
        "from flightdepth.flight.camera_file import read_camera\n"
        "assert demo.compare([], read_camera(demo.CALIBRATION), None)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_an_unknown_network_leaves_nothing_behind(demo, tmp_path):
    code, _, stderr = demo("--network", "alexnet")
    assert code == 2
    assert "alexnet" in stderr
    assert not (tmp_path / "out").exists()
