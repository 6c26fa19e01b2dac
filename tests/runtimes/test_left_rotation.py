"""The rotation that a flow shows beside depth: against points that were moved and turned by hand."""

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.runtimes import alignment
from flightdepth.runtimes.left_rotation import left_rotation, mended_depth, rotated_flow
from flightdepth.runtimes.network import load_network
from flightdepth.stillbox import PairRule, Picture, TestSet
from flightdepth.stillbox.motion_noise import rotated
from flightdepth.triangulation import flow_of_depth, inverse_depth
from tests_textures import few_textures

CAMERA = Camera.from_fov(256, 192, 80)
SHAPE = (48, 64)
WAYS = [(1.0, 0.0, 0.0), (2 / 7, -3 / 7, 6 / 7), (0.0, 0.6, -0.8)]
TURN = np.array([0.0008, -0.0005, 0.001])
EVERYWHERE = np.ones(SHAPE, np.float32)
CONTRAST = 400 * EVERYWHERE


def flow_of(way, turn, *, noise_px=0.0, seed=0):
    """Flow [h, w, 2] in pixels of CAMERA, of blocks 3 to 40 displacements away, and where they had been seen."""
    rng = np.random.default_rng(seed)
    rays = CAMERA.resized(*SHAPE[::-1]).rays()
    before = rays * rng.uniform(3, 40, (*SHAPE, 1)) + np.array(way)
    before = before @ cv2.Rodrigues(np.asarray(turn, float))[0].T
    flow = (before[..., :2] / before[..., 2:] - rays[..., :2]) * CAMERA.fx
    return (flow + rng.normal(0, noise_px, flow.shape)).astype(np.float32)


@pytest.mark.parametrize("way", WAYS)
def test_a_rotation_is_found_beside_any_depth(way):
    found = left_rotation(flow_of(way, TURN), CONTRAST, EVERYWHERE, np.array(way), CAMERA)
    assert found == pytest.approx(TURN, abs=4e-5)


@pytest.mark.parametrize("way", WAYS)
def test_noise_and_things_that_move_by_themselves_hardly_matter(way):
    flow = flow_of(way, TURN, noise_px=0.1)
    flow[10:22, 20:40] += (3.0, -2.0)
    found = left_rotation(flow, CONTRAST, EVERYWHERE, np.array(way), CAMERA)
    assert np.linalg.norm(found - TURN) < 0.5 * np.linalg.norm(TURN)


def test_blocks_without_contrast_or_out_of_sight_say_nothing():
    flow, half = flow_of(WAYS[0], TURN), EVERYWHERE.copy()
    flow[:, :32] = 7.0
    half[:, :32] = 0
    for contrast, held in ((CONTRAST * half, EVERYWHERE), (CONTRAST, half)):
        found = left_rotation(flow, contrast, held, np.array(WAYS[0]), CAMERA)
        assert found == pytest.approx(TURN, abs=1.5e-4)


def test_what_the_blocks_cannot_tell_is_hardly_moved():
    """Sideways through a long lens a turn about the upright axis looks like parallax: it is not made up."""
    long = Camera.from_fov(256, 192, 12)
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 0.3, (*SHAPE, 2)).astype(np.float32)
        found = left_rotation(noise, CONTRAST, EVERYWHERE, np.array(WAYS[0]), long)
        assert np.linalg.norm(found) < np.radians(0.01)


def test_few_blocks_tell_nothing():
    few = np.zeros(SHAPE, np.float32)
    few[:3, :30] = 1
    assert (
        left_rotation(flow_of(WAYS[0], TURN), CONTRAST * few, EVERYWHERE, np.array(WAYS[0]), CAMERA) is None
    )


def test_blocks_of_hardly_any_contrast_do_not_count():
    """As on a blank wall, where flow only guesses."""
    flow = flow_of(WAYS[0], TURN)
    assert left_rotation(flow, EVERYWHERE, EVERYWHERE, np.array(WAYS[0]), CAMERA) is None


@pytest.mark.parametrize("way", WAYS)
def test_a_direction_that_is_a_little_off_does_not_pass_for_a_rotation(way):
    """By 0.4 degrees, to one side or the other."""
    aside_of = np.cross(way, (0.3, 0.8, 0.5))
    for sign in (-1, 1):
        told = np.array(way) + sign * np.tan(np.radians(0.4)) * aside_of / np.linalg.norm(aside_of)
        found = left_rotation(flow_of(way, TURN), CONTRAST, EVERYWHERE, told / np.linalg.norm(told), CAMERA)
        assert found == pytest.approx(TURN, abs=2e-4)


@pytest.mark.parametrize("way", WAYS)
def test_a_rotation_is_found_and_taken_out_where_pixels_are_not_square(way):
    camera = Camera(256, 192, 150.0, 190.0, 127.5, 95.5)
    turned, still = (np.stack(seen_through(camera, way, turn), axis=-1) for turn in (TURN, (0, 0, 0)))
    found = left_rotation(turned, CONTRAST, EVERYWHERE, np.array(way), camera)
    assert found == pytest.approx(TURN, abs=4e-5)
    assert turned - rotated_flow(turned, TURN, camera) == pytest.approx(still, abs=4e-3)


def seen_through(camera, way, turn):
    """Flow as `flow_of` makes it, along x and along y."""
    rays = camera.resized(*SHAPE[::-1]).rays()
    before = rays * np.random.default_rng(0).uniform(3, 40, (*SHAPE, 1)) + np.array(way)
    before = before @ cv2.Rodrigues(np.asarray(turn, float))[0].T
    moved = before[..., :2] / before[..., 2:] - rays[..., :2]
    return (camera.fx * moved[..., 0]).astype(np.float32), (camera.fy * moved[..., 1]).astype(np.float32)


def test_depth_of_what_moved_by_a_pixel_is_mended():
    depth = np.full(SHAPE, CAMERA.fx / 1.0, np.float32)
    assert (mended_depth(depth, TURN / 10, np.array(WAYS[0]), CAMERA) != depth).all()


@pytest.mark.parametrize("way", WAYS)
def test_its_flow_is_what_it_added(way):
    turned, still = flow_of(way, TURN), flow_of(way, (0, 0, 0))
    assert turned - rotated_flow(turned, TURN, CAMERA) == pytest.approx(still, abs=2e-3)
    assert np.abs(turned - still).max() > 0.1


@pytest.mark.parametrize("way", WAYS)
def test_depth_that_a_rotation_made_is_mended(way):
    """Who takes the turned flow for parallax is off; mended, by a tenth of that at most, but for what hardly moved."""
    rays = CAMERA.resized(*SHAPE[::-1]).rays()
    depth = np.random.default_rng(0).uniform(3, 400, (*SHAPE, 1))
    before = (rays * depth + np.array(way)) @ cv2.Rodrigues(TURN / 10)[0].T
    flow = (before[..., :2] / before[..., 2:] - rays[..., :2]) * CAMERA.fx / 4
    inverse, _ = inverse_depth(flow, way, CAMERA.resized(*SHAPE[::-1]))
    taken, depth = np.clip(1 / inverse, 1, 1e4).astype(np.float32), depth[..., 0]
    mended = mended_depth(taken, TURN / 10, np.array(way), CAMERA)
    moved_px = 4 * np.linalg.norm(flow_of_depth(taken, way, CAMERA.resized(*SHAPE[::-1])), axis=2)
    clear = moved_px > 2
    assert np.abs(mended / depth - 1)[clear].mean() < 0.1 * np.abs(taken / depth - 1)[clear].mean()
    hardly = moved_px < 0.5
    assert (mended[hardly] == taken[hardly]).all() and hardly.mean() > 0.1


@pytest.mark.parametrize(
    ("name", "textures"),
    [("motion-tiny", few_textures), pytest.param("motion", lambda: None, marks=pytest.mark.slow)],
)
def test_depth_of_pairs_that_turned_a_little_is_better_by_it(monkeypatch, name, textures):
    """A dozen rooms turned by 0.06 degrees, corners not asked: a sixth of the harm goes, and more.

    Of four rooms alone 8 to 40 % of it go.
    """
    network = load_network(name, threads=1)
    camera, errors = Camera.from_fov(256, 256, 90), {"still": [], "turned": [], "mended": []}
    rooms = TestSet(Picture(256, 256, 256), PairRule(), scenes=12, seed=0, textures=textures())
    for number, pair in enumerate(rooms):
        truth_m = cv2.resize(pair.depth_m, (64, 64), interpolation=cv2.INTER_AREA).clip(0, 100)

        def error_m(previous, *, pair=pair, truth_m=truth_m):
            found = network.predict([previous], pair.current, pair.displacement[None], camera).depth_m[0]
            return np.abs(found.clip(0, 100) - truth_m).mean()

        errors["still"].append(error_m(pair.previous))
        for axis in np.random.default_rng(number).normal(size=(2, 3)):
            seen = rotated(pair.previous, camera, axis / np.linalg.norm(axis) * np.radians(0.06))
            errors["mended"].append(error_m(seen))
            with monkeypatch.context() as patch:
                patch.setattr(alignment, "left_rotation", lambda *_: None)
                errors["turned"].append(error_m(seen))
    still, turned, mended = (np.mean(errors[kind]) for kind in ("still", "turned", "mended"))
    assert mended - still < 5 / 6 * (turned - still)


def test_no_rotation_makes_depth_more_than_so_much_another():
    """Sideways, 20 displacements away: a turn of 3 degrees is as much parallax as there is."""
    depth = np.full(SHAPE, 20, np.float32)
    mended = mended_depth(depth, np.array([0.0, 0.05, 0.0]), np.array(WAYS[0]), CAMERA)
    assert abs(np.log(mended / depth)) == pytest.approx(0.5, abs=1e-5)
