"""Laws of depth over fixed baselines, on a rendered flight whose true depth is known."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.evaluation.baseline_methods import PEER, Answer, PeerMethod
from flightdepth.evaluation.baseline_pairs import BaselinePair, BaselinePairs, Moment, Witness
from flightdepth.evaluation.baseline_sheets import SheetSights, sheet
from flightdepth.evaluation.baselines import CONSTANT, BaselineStudy, agreement
from flightdepth.evaluation.bootstrap import interval
from flightdepth.evaluation.warping import WarpedPair
from flightdepth.flight import Frame, VelocitySample
from flightdepth.motion import NED_FROM_CAMERA
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.sweep import motion_field
from tests_networks import difference_card

RATE_HZ, FRAMES = 15, 36
BASELINES = (0.8, 2.0)
CAMERA = Camera.from_fov(256, 192, 64.0)
ZOOMED = Camera.from_fov(256, 192, 32.0)


@dataclass
class Flown:
    """Stands for a `Flight`: rendered frames, velocities, the truth by frame."""

    images: np.ndarray
    depth_m: np.ndarray
    velocity: np.ndarray
    frame: str
    camera: Camera = CAMERA
    gyroscope: None = None
    turning: frozenset[int] = field(default_factory=frozenset)
    damaged: frozenset[int] = field(default_factory=frozenset)
    zoomed: frozenset[int] = field(default_factory=frozenset)

    def __iter__(self):
        for i, image in enumerate(self.images):
            at = i * 10**9 // RATE_HZ
            yield VelocitySample(at, self.velocity[i], self.frame)
            yield Frame(
                i,
                at,
                rolled(image) if i in self.turning else image,
                after_damage=i in self.damaged,
                camera=ZOOMED if i in self.zoomed else None,
            )


def rolled(image: np.ndarray) -> np.ndarray:
    """As a camera sees it that turned by 6 degrees about its axis."""
    turn = cv2.getRotationMatrix2D((CAMERA.cx, CAMERA.cy), 6.0, 1.0)
    return cv2.warpAffine(image, turn, image.shape[1::-1], borderMode=cv2.BORDER_REFLECT)


@pytest.fixture(scope="module")
def rendered():
    """36 frames straight ahead over fields and mounds, and nothing that hides anything else but those.

    A little out of focus: texture finer than the pixels cannot be interpolated, whatever the depth.
    """
    pytest.importorskip("numba")
    from flightdepth.renderers.raycast import render
    from flightdepth.scenes.outdoor import draw_outdoor, outdoor_velocity
    from flightdepth.scenes.outdoor_config import OutdoorConfig
    from flightdepth.scenes.outdoor_textures import outdoor_textures

    nothing = dict.fromkeys(("near_trees", "trees", "woods", "bushes", "houses"), (0, 0))
    config = OutdoorConfig(frames=100, rate_hz=RATE_HZ, orientation_noise_rad=0.0, **nothing)
    scene = draw_outdoor(config, 3)
    done = render(scene, outdoor_textures(0), CAMERA, frames=range(FRAMES))
    in_camera = outdoor_velocity(config, 3)[:FRAMES] @ scene.world_from_camera[0]
    images = np.stack([cv2.GaussianBlur(image, (0, 0), 1.5) for image in done.images])
    return images, done.depth_m, in_camera


@dataclass(frozen=True)
class Oracle:
    """The true depth, times a factor; up to `most_m` it counts as measured."""

    flown: Flown
    factor: float = 1.0
    name: str = "oracle"
    most_m: float = 80.0

    def answer(self, previous, current, displacement, camera) -> Answer:
        del previous, displacement
        which = next(i for i, image in enumerate(self.flown.images) if np.array_equal(image, current))
        size = (camera.width // 4, camera.height // 4)
        inverse = cv2.resize(1 / self.flown.depth_m[which], size, interpolation=cv2.INTER_AREA)
        depth_m = self.factor / np.maximum(inverse, 1e-9)
        return Answer(depth_m, depth_m < self.most_m * self.factor)


@dataclass(frozen=True)
class Guesser(Oracle):
    """The true depth where points move by a pixel, and a guess that always is the same elsewhere."""

    name: str = "guesser"

    def answer(self, previous, current, displacement, camera) -> Answer:
        true = super().answer(previous, current, displacement, camera)
        moved = np.hypot(*motion_field(displacement, camera)) * camera.fx >= true.depth_m
        return Answer(np.where(moved, true.depth_m, 40.0), np.ones_like(true.measured))


def flight_of(rendered, frame="camera", **changes) -> Flown:
    images, depth_m, in_camera = rendered
    velocity = in_camera if frame == "camera" else in_camera @ NED_FROM_CAMERA.T
    return Flown(images, depth_m, velocity, frame, **changes)


def studied(flown, methods, *, every=1):
    grid = NetworkGrid(CAMERA, CAMERA.fx)
    pairs = BaselinePairs(flown, grid, BASELINES, every=every)
    study = BaselineStudy(methods, grid.camera, grid.valid, pairs.known, BASELINES)
    sights = [study.add(moment) for moment in pairs]
    return study.result(), pairs, sights


def rows(result, what, method) -> list[dict]:
    return [row for row in result[what] if row["method"] == method]


@pytest.fixture(scope="module")
def measured(rendered):
    flown = flight_of(rendered)
    peer = PeerMethod((difference_card(),))
    return studied(flown, [Oracle(flown), Oracle(flown, 2.0, "doubled"), Guesser(flown), peer])


def warped(sight) -> WarpedPair:
    pair, everything = sight.pair, np.ones((CAMERA.height, CAMERA.width), np.bool_)
    known = {"known_previous": everything, "known_current": everything}
    return WarpedPair(pair.previous, sight.current, pair.displacement, CAMERA, **known)


def test_true_depth_explains_the_pictures(measured):
    """What is left lies in the distance, where nothing moves by a pixel and texture is finer than that."""
    for row in rows(measured[0], "photometric", "oracle"):
        assert row["error_share"]["high"] < 0.3
        assert row["pixels_inside"] > 0.95
        assert 0.3 < row["pixels_measured"] < 1


def test_no_multiple_of_the_true_depth_explains_them_better(measured):
    both = [sights for sights in measured[2] if len(sights) == 2]
    for sight in both[-1]:
        warp = warped(sight)
        depth_m = sight.answers["oracle"].depth_m
        errors = (warp.error_map(factor * depth_m) for factor in (0.9, 1.0, 1.1))
        nearer, true, farther = (warp.match(each).error for each in errors)
        assert true < 0.9 * min(nearer, farther)


def test_doubled_depth_explains_them_less(measured):
    result = measured[0]
    for true, doubled in zip(
        rows(result, "photometric", "oracle"), rows(result, "photometric", "doubled"), strict=True
    ):
        assert doubled["error_share"]["low"] > 2 * true["error_share"]["high"]
        assert doubled["error_share"]["high"] < 1


def test_the_best_constant_lies_between_true_depth_and_none(measured):
    for true, constant in zip(
        rows(measured[0], "photometric", "oracle"), rows(measured[0], "photometric", CONSTANT), strict=True
    ):
        assert true["error_share"]["high"] < constant["error_share"]["mean"] <= 1


@pytest.mark.parametrize("method", ["oracle", "doubled"])
def test_a_depth_that_does_not_hang_on_the_baseline_agrees(measured, method):
    (row,) = rows(measured[0], "agreement", method)
    assert row["median_log_ratio"]["mean"] == row["median_log_ratio"]["high"] == 0
    assert row["median_log_ratio_where_peer_measures"]["mean"] == 0
    assert 0.3 < row["measured_by_both"]["mean"] < 1


@pytest.mark.parametrize(("method", "factor"), [("oracle", 1), ("doubled", 2)])
def test_the_slope_is_the_ideal_times_the_scale(measured, method, factor):
    for row in rows(measured[0], "slope", method):
        assert row["points"] > 20
        assert row["ideal"] == pytest.approx(-0.99, abs=0.01)  # the camera looks a little down
        assert row["median"] == pytest.approx(factor * row["ideal"], abs=0.05 * factor)


@pytest.mark.parametrize(("method", "factor"), [("oracle", 1), ("doubled", 2)])
def test_the_slope_of_what_moved_is_the_ideal_times_the_scale_too(measured, method, factor):
    for row in rows(measured[0], "slope_of_moved", method):
        assert row["points"] > 20
        assert row["median"] == pytest.approx(factor * row["ideal"], abs=0.05 * factor)


def test_a_guess_where_nothing_moves_spoils_the_slope_but_not_that_of_what_moved(measured):
    result = measured[0]
    for row in rows(result, "slope_of_moved", "guesser"):
        assert row["median"] == pytest.approx(row["ideal"], abs=0.1)
    all_points, moved = (rows(result, what, "guesser")[0] for what in ("slope", "slope_of_moved"))
    assert all_points["points"] > moved["points"]
    assert abs(all_points["median"]) < 0.9


def test_on_its_own_pixels_the_peer_agrees_as_it_does_anyway(measured):
    (row,) = rows(measured[0], "agreement", "classical peer")
    assert row["median_log_ratio_where_peer_measures"] == row["median_log_ratio"]
    assert 0 < row["median_log_ratio"]["mean"] < 0.3


def test_the_peer_stands_between_the_truth_and_none(measured):
    for row in rows(measured[0], "photometric", "classical peer"):
        assert 0.05 < row["error_share"]["mean"] < 0.7


def test_all_that_was_flown_is_counted(measured):
    result, pairs, _ = measured
    assert set(result["frames_per_baseline"]) == {"0.8", "2"}
    assert min(result["frames_per_baseline"].values()) > 25
    assert result["directions_told_by"][Witness.LOG.value] == sum(result["frames_per_baseline"].values())
    assert pairs.left_out["frame: first frame"] == 1


def test_pairs_are_as_long_as_asked_for(measured):
    for sights in measured[2]:
        for sight in sights:
            length_m = np.linalg.norm(sight.pair.displacement)
            assert length_m == pytest.approx(sight.pair.wanted_m, rel=0.2)


def test_without_an_attitude_the_pictures_tell_the_direction(rendered):
    """A log in the world's axes knows only how far; the direction seen is near the true one."""
    flown = flight_of(rendered, "world")
    result, _, sights = studied(flown, [Oracle(flown)], every=6)
    assert result["directions_told_by"][Witness.LOG.value] == 0
    assert result["directions_told_by"][Witness.PICTURES.value] >= 6
    way = flown.velocity[0] @ NED_FROM_CAMERA
    for sight in (sight for each in sights for sight in each):
        found = sight.pair.displacement
        cosine = found @ way / np.linalg.norm(found) / np.linalg.norm(way)
        assert cosine > np.cos(np.radians(3))


def test_a_short_pair_takes_the_direction_of_a_longer_one(rendered, monkeypatch):
    from flightdepth.evaluation import baseline_pairs

    see, calls = baseline_pairs.estimate_direction, []

    def once_a_frame(*pair):
        calls.append(pair)
        return see(*pair) if len(calls) % 2 else None

    monkeypatch.setattr(baseline_pairs, "estimate_direction", once_a_frame)
    flown = flight_of(rendered, "world")
    result, _, sights = studied(flown, [Oracle(flown)], every=12)
    (short, long), *_ = [each for each in sights if len(each) == 2]
    assert (short.pair.witness, long.pair.witness) == (Witness.LONGER, Witness.PICTURES)
    ways = [sight.pair.displacement / np.linalg.norm(sight.pair.displacement) for sight in (short, long)]
    assert ways[0] == pytest.approx(ways[1])
    assert result["directions_told_by"][Witness.LONGER.value] > 0


def test_a_turn_leaves_out_its_frames_and_the_pairs_across_it(rendered):
    flown = flight_of(rendered, "world", turning=frozenset({18}))
    pairs = BaselinePairs(flown, NetworkGrid(CAMERA, CAMERA.fx), BASELINES, every=1)
    found = [[pair.wanted_m for pair in moment.pairs] for moment in pairs]
    assert pairs.left_out["frame in a fast turn"] == 2  # into it, and out of it
    assert found[17] == [0.8, 2.0]
    assert found[18:22] == [[], [], [], []]
    assert found[24] == [0.8]
    assert found[30] == [0.8, 2.0]


def test_nothing_is_paired_across_damage(rendered):
    """It was: `run` forgets the frames before damaged ones, this did not."""
    flown = flight_of(rendered, damaged=frozenset({18}))
    pairs = BaselinePairs(flown, NetworkGrid(CAMERA, CAMERA.fx), BASELINES, every=1)
    found = [[pair.wanted_m for pair in moment.pairs] for moment in pairs]
    assert found[17] == [0.8, 2.0]
    assert found[18:20] == [[], []]
    assert found[21] == [0.8]
    assert found[30] == [0.8, 2.0]


def test_damage_counts_before_a_frame_that_is_not_sampled_too(rendered):
    flown = flight_of(rendered, damaged=frozenset({19}))
    pairs = BaselinePairs(flown, NetworkGrid(CAMERA, CAMERA.fx), BASELINES, every=2)
    assert not list(pairs)[20].pairs


def test_what_is_seen_through_another_lens_is_left_out(rendered):
    """A flight that zoomed was measured with its first focal length."""
    flown = flight_of(rendered, zoomed=frozenset(range(18, 36)))
    pairs = BaselinePairs(flown, NetworkGrid(CAMERA, CAMERA.fx), BASELINES, every=2)
    moments = list(pairs)
    assert len(moments[16].pairs) == 2
    assert not any(moment.pairs for moment in moments[18:])
    assert {moment.flown_m for moment in moments[18:]} == {None}
    assert pairs.left_out["frame zoomed or cropped otherwise than the first"] == 9


def test_what_comes_after_a_zoom_is_paired_with_what_was_before(rendered):
    flown = flight_of(rendered, zoomed=frozenset({18}))
    pairs = BaselinePairs(flown, NetworkGrid(CAMERA, CAMERA.fx), BASELINES, every=1)
    found = [[pair.wanted_m for pair in moment.pairs] for moment in pairs]
    assert found[18] == []
    assert found[19] == [0.8, 2.0]


def test_damage_in_a_picture_that_zoomed_is_damage(rendered):
    flown = flight_of(rendered, zoomed=frozenset({18}), damaged=frozenset({18}))
    pairs = BaselinePairs(flown, NetworkGrid(CAMERA, CAMERA.fx), BASELINES, every=1)
    assert [len(moment.pairs) for moment in pairs][17:20] == [2, 0, 0]


def test_the_sheet_holds_a_row_for_each_pair(measured):
    kept = SheetSights(2)
    for sights in measured[2]:
        if len(sights) == 2:
            kept.add(sights)
    assert len(kept.chosen) == 2
    assert kept.chosen[1][0].index - kept.chosen[0][0].index > 10
    picture = sheet(kept.chosen, NetworkGrid(CAMERA, CAMERA.fx).valid)
    assert picture.shape == (4 * (192 + 22), 10 * 258 + 100, 3)
    assert picture.std() > 10


# Figures by hand


def answer(*depths_m, measured=None) -> Answer:
    known = [True] * len(depths_m) if measured is None else measured
    return Answer(np.array([depths_m], np.float32), np.array([known]))


def test_agreement_by_hand():
    one, other = answer(10, 20, 40, 80), answer(20, 20, 10, 1, measured=[True, True, True, False])
    log, share = agreement(one, other, np.array([[True, True, True, True]]))
    assert log == pytest.approx(np.log(2))  # of log 2, 0 and log 4
    assert share == 0.75
    assert agreement(one, other, np.array([[False, True, False, True]])) == (0, 0.5)


def test_agreement_is_the_median_of_the_ratios():
    one, other = answer(10, 10, 10), answer(10, 20, 1280)
    assert agreement(one, other, np.ones((1, 3), np.bool_))[0] == pytest.approx(np.log(2))


@dataclass(frozen=True)
class Says:
    """Maps [16, 16] of a depth less what was flown so far, by the displacement's length."""

    depth_m: dict[float, np.ndarray]
    measured: np.ndarray
    name: str = "says"

    def answer(self, previous, current, displacement, camera) -> Answer:
        del previous, current, camera
        return Answer(np.float32(self.depth_m[float(np.linalg.norm(displacement))]), self.measured)


SMALL = Camera(64, 64, 32.0, 32.0, 31.5, 31.5)
LEFT = np.arange(16) + np.zeros((16, 1), int) < 8  # of a map; of a picture the left half too
EVERYWHERE = np.ones((16, 16), np.bool_)


def enlarged(flags: np.ndarray) -> np.ndarray:
    return flags.repeat(4, axis=0).repeat(4, axis=1)


def moment(index: int = 0, flown_m: float = 0.0, lengths_m=(1.0,)) -> Moment:
    """A still picture, said to have been flown past sideways."""
    picture = np.random.default_rng(3).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    pairs = (
        BaselinePair(
            length, np.roll(picture, 1, 1), enlarged(EVERYWHERE), np.array([length, 0, 0]), Witness.LOG
        )
        for length in lengths_m
    )
    return Moment(index, picture, tuple(pairs), flown_m)


def points(
    measured: np.ndarray, *, valid=EVERYWHERE, depth_m: float = 20.0, flown_m: float = 3.1
) -> tuple[int, int]:
    """Of how many tracks there are slopes, of all and of those that moved, while so many metres are flown."""
    depths_m, known = {1.0: np.full((16, 16), depth_m)}, enlarged(valid)
    study = BaselineStudy([Says(depths_m, measured)], SMALL, valid, known, (1.0,))
    for index, flown in enumerate(np.linspace(0, flown_m, 15)):
        depths_m[1.0] = np.full((16, 16), depth_m - flown)
        study.add(moment(index, float(flown)))
    result = study.result()
    return rows(result, "slope", "says")[0]["points"], rows(result, "slope_of_moved", "says")[0]["points"]


def test_points_are_tracked_where_they_are_measured_within_the_picture():
    assert points(LEFT, valid=LEFT)[0] > 0
    assert points(~LEFT, valid=LEFT)[0] == 0


def test_points_are_tracked_over_three_metres():
    assert points(EVERYWHERE, flown_m=2.9)[0] == 0


@pytest.mark.parametrize(("depth_m", "moved"), [(31.5, True), (36.0, False)])
def test_points_that_moved_are_those_that_moved_by_a_pixel(depth_m, moved):
    """32 px of focal length, a metre: 31.5 to 28.4 m away by more than a pixel, 36 to 32.9 m away by less."""
    all_of_them, those = points(EVERYWHERE, depth_m=depth_m)
    assert all_of_them > 0
    assert (those > 0) == moved


def test_padding_is_not_counted_as_unmeasured():
    study = BaselineStudy([Says({1.0: np.full((16, 16), 9.0)}, LEFT)], SMALL, LEFT, enlarged(LEFT), (1.0,))
    study.add(moment())
    (row,) = rows(study.result(), "photometric", "says")
    assert row["pixels_measured"] == 1


def test_padding_of_the_current_picture_is_not_compared():
    study = BaselineStudy([Says({1.0: np.full((16, 16), 9.0)}, LEFT)], SMALL, LEFT, enlarged(LEFT), (1.0,))
    (sight,) = study.add(moment())
    assert np.isnan(sight.errors["says"][:, 32:]).all()
    assert np.isnan(sight.unmoved[:, 32:]).all()


def test_what_agrees_where_the_peer_measures_is_told_apart():
    """On the right, where the peer measures nothing, depth doubles with the baseline; padding aside."""
    valid = EVERYWHERE.copy()
    valid[:, :6] = False
    depths_m = {1.0: np.full((16, 16), 9.0), 2.0: np.where(LEFT, 9.0, 18.0)}
    peer = Says({1.0: depths_m[1.0], 2.0: depths_m[1.0]}, LEFT, PEER)
    study = BaselineStudy([Says(depths_m, EVERYWHERE), peer], SMALL, valid, enlarged(EVERYWHERE), (1.0, 2.0))
    study.add(moment(lengths_m=(1.0, 2.0)))
    (row,) = rows(study.result(), "agreement", "says")
    assert row["median_log_ratio"]["mean"] == pytest.approx(np.log(2))
    assert row["median_log_ratio_where_peer_measures"]["mean"] == 0
    assert row["measured_by_both"]["mean"] == 1


def test_nothing_measured_by_both_agrees_on_nothing():
    one, other = answer(1, 2, measured=[True, False]), answer(1, 2, measured=[False, True])
    log, share = agreement(one, other, np.ones((1, 2), np.bool_))
    assert np.isnan(log)
    assert share == 0


def test_the_interval_holds_the_mean_of_what_is_known():
    found = interval([1.0, 2.0, 3.0, float("nan")])
    assert (found["mean"], found["frames"]) == (2, 3)
    assert 1 <= found["low"] < 2 < found["high"] <= 3
    assert interval([float("nan")])["frames"] == 0


def test_what_the_peer_cannot_see_is_not_measured():
    """Straight ahead, nothing moves in the middle."""
    from plane_pairs import plane_pair

    pair = plane_pair(CAMERA, (0.0, 0.0, 0.8))
    found = PeerMethod((difference_card(),)).answer(pair.previous, pair.current, pair.displacement, CAMERA)
    assert found.depth_m.shape == found.measured.shape == (48, 64)
    assert not found.measured[23:25, 31:33].any()
    assert found.measured[4:10, 4:10].mean() > 0.9
    assert np.median(found.depth_m[found.measured]) == pytest.approx(10, rel=0.05)
