"""A thing that moves by itself is where it should be in both pictures, and by how far it left its line is told."""

import importlib
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges.fusion import WORST_SIGMA
from flightdepth.runtimes.network import load_network
from flightdepth.scenes import Textures
from flightdepth.stillbox.pairs import Pair
from flightdepth.triangulation import flow_of_depth

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
moving = importlib.import_module("moving")
with_moving_thing = moving.with_moving_thing
judging_pairs = importlib.import_module("judging_pairs")

CAMERA = Camera.from_fov(256, 192, 80)
BEHIND_M = 40.0


@pytest.fixture(scope="module")
def textures():
    return Textures.procedural(4, 3)


@pytest.fixture
def fitting_pairs(monkeypatch, textures):
    """In few textures, and of one shape: what many take is the time to make them, and to compile for the shapes."""
    monkeypatch.setattr(judging_pairs, "TEXTURE_SETS", 1)
    monkeypatch.setattr(judging_pairs, "SHAPES", judging_pairs.SHAPES[1:2])
    monkeypatch.setattr(judging_pairs, "_room_textures", lambda seed: textures)
    return judging_pairs.fitting_pairs


def wall(displacement):
    grey = np.full((CAMERA.height, CAMERA.width, 3), 128, np.uint8)
    depth_m = np.full(grey.shape[:2], BEHIND_M, np.float32)
    return Pair(grey, grey.copy(), depth_m, np.array(displacement), CAMERA)


def things(displacement, textures, count=40):
    found = [
        with_moving_thing(wall(displacement), textures, np.random.default_rng(seed)) for seed in range(count)
    ]
    return [each for each in found if each is not None]


def changed(picture):
    return (picture != 128).any(axis=2)


def flow_found(thing):
    """By phase correlation of what is seen of it, a reference that knows no motion: pixels, current to previous."""
    windows = [
        cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32) - 128
        for image in (thing.pair.current, thing.pair.previous)
    ]
    return np.array(cv2.phaseCorrelate(*windows)[0])


@pytest.mark.parametrize("displacement", [[1.0, 0.0, 0.0], [0.4, -0.8, 0.0]])
def test_it_moves_by_its_depth_and_by_itself(displacement, textures):
    checked = 0
    for thing in things(displacement, textures):
        rows, columns = np.nonzero(thing.inside)
        if min(rows.min(), columns.min()) < 30 or rows.max() > 160 or columns.max() > 225:
            continue  # the picture cuts it
        depth_m = thing.pair.target_m[thing.inside]
        assert np.ptp(depth_m) == 0
        assert 0.4 * BEHIND_M <= depth_m[0] <= BEHIND_M
        at_rest = flow_of_depth(thing.pair.target_m, displacement, CAMERA)[thing.inside].mean(axis=0)
        own = flow_found(thing) - at_rest
        line = np.array(displacement[:2])
        assert abs(own[0] * line[1] - own[1] * line[0]) / np.hypot(*line) == pytest.approx(
            thing.off_px, abs=0.6
        )
        checked += 1
    assert checked >= 5


def test_it_grows_on_the_way_to_it(textures):
    for thing in things([0.0, 0.0, 6.0], textures):
        depth_m = float(thing.pair.target_m[thing.inside][0])
        shown = [changed(image) for image in (thing.pair.current, thing.pair.previous)]
        if any(each[[0, -1]].any() or each[:, [0, -1]].any() for each in shown):
            continue
        grown = np.sqrt(shown[0].sum() / shown[1].sum())
        assert grown == pytest.approx((depth_m + 6.0) / depth_m, rel=0.06)


def test_nothing_else_changes(textures):
    for thing in things([1.0, 0.0, 0.0], textures):
        before = wall([1.0, 0.0, 0.0])
        assert (thing.pair.target_m[~thing.inside] == BEHIND_M).all()
        near = cv2.dilate(thing.inside.astype(np.uint8), np.ones((9, 9))) > 0
        assert (thing.pair.current[~near] == before.current[~near]).all()
        assert thing.pair.camera is CAMERA


def test_a_thing_at_the_camera_is_none(textures, monkeypatch):
    monkeypatch.setattr(moving, "NEARER", (0.01, 0.02))
    assert things([0.0, 0.0, -2.0], textures) == []


def test_things_change_nothing_else_that_is_drawn(fitting_pairs):
    """Found in review: pictures were compared where nothing moves, and in each of them something did."""
    without, with_some = (
        list(fitting_pairs(6, 4, 5, moving_share=share, wrong_share=0.0)) for share in (0.0, 1.0)
    )
    pairs = list(zip(without, with_some, strict=True))
    assert any(not np.array_equal(a.target_m, b.target_m, equal_nan=True) for a, b in pairs)
    assert all(a.camera == b.camera for a, b in pairs)
    assert all((a.current == b.current).all(axis=2).mean() > 0.5 for a, b in pairs)


def test_the_error_bar_is_large_where_something_left_its_line(fitting_pairs, textures):
    network = load_network("motion", precision="f32", threads=1)
    bars = []
    for number, pair in enumerate(fitting_pairs(16, seed=5)):
        thing = with_moving_thing(pair, textures, np.random.default_rng(number))
        if thing is None or thing.off_px < 3:
            continue
        grid = network.grid(pair.camera)
        inside = cv2.resize(
            thing.inside.astype(np.float32), grid.valid.shape[::-1], interpolation=cv2.INTER_AREA
        )
        shares = []
        for seen in (pair, thing.pair):
            found = network.predict([seen.previous], seen.current, seen.displacement[None], seen.camera)
            shares.append(float(np.median((found.sigma_m / found.depth_m)[0][inside > 0.95])))
        bars.append(shares)
    without, with_it = np.array(bars).T
    assert len(bars) >= 8
    assert np.median(with_it) > WORST_SIGMA  # which flights take for unknown
    assert np.median(with_it) > 3 * np.median(without)
