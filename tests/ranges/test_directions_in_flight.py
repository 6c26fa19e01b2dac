"""Which way the estimator tells a network that asks: from the log, from the pictures, or not at all."""

import numpy as np
import pytest
from sideways_flight import CAMERA, FRAME_NS, picture

from flightdepth.ranges import MultiRangeEstimator, derotation, direction, estimator, exposure, temporal
from flightdepth.ranges.choice import NO_DIRECTION, PairChoice
from flightdepth.ranges.log_check import LogCheck
from flightdepth.ranges.seen_turns import SeenTurns
from flightdepth.ranges.tracks import Tracker
from flightdepth.runtimes.network import Network
from tests_networks import BestHypothesis, difference_card, swept_card


class Told(Network):
    """Remembers the displacements that it was given."""

    def __init__(self):
        super().__init__(swept_card(), BestHypothesis())
        self.displacements = []

    def predict(self, previous_n, current, displacements, camera):
        self.displacements.extend(np.asarray(displacements))
        return super().predict(previous_n, current, displacements, camera)


class NearAndFar:
    """A DepthNet without weights: 5 m on the left, 90 m on the right, as it were at D0."""

    description = "numpy"
    architecture = "DepthNet"

    def __call__(self, inputs):
        n, height, width, _ = inputs["pairs"].shape
        depth_m = np.full((n, height // 4, width // 4), 5.0, np.float32)
        depth_m[..., width // 8 :] = 90.0
        return {"depth_m": depth_m}


def blank(number):
    """Nothing to see; not the same picture twice, which would be a frozen one."""
    return np.full((128, 192, 3), 90 + number % 2, np.uint8)


def flown(velocity, frame, *, attitude=None, pictures=picture):
    """Network and last result of a flight of six frames at 1 m/s."""
    network = Told()
    estimator = MultiRangeEstimator(network, CAMERA, ranges=1)
    for number in range(7):
        estimator.add_velocity(number * FRAME_NS, velocity, frame=frame)
        if attitude is not None:
            estimator.add_attitude(number * FRAME_NS, attitude)
    results = [estimator.add_frame(number * FRAME_NS, pictures(number)) for number in range(6)]
    return network, results[-1]


def test_a_velocity_in_the_camera_s_frame_is_taken_as_it_is():
    network, result = flown([0.6, 0.8, 0.0], "camera", pictures=blank)
    units = [moved / np.linalg.norm(moved) for moved in network.displacements]
    assert np.allclose(units, [0.6, 0.8, 0.0])
    assert result.doubt is None


def test_a_log_that_the_pictures_deny_is_not_followed():
    """Flown to the right, told as downwards and to the right: after a quarter of a second the pictures direct."""
    network, result = flown([0.6, 0.8, 0.0], "camera")
    units = [moved / np.linalg.norm(moved) for moved in network.displacements]
    assert np.allclose(units[:3], [0.6, 0.8, 0.0])
    assert np.degrees(np.arccos(np.clip(np.array(units[3:]) @ [1.0, 0.0, 0.0], -1, 1))).max() < 3
    assert "it is 53 degrees off" in result.doubt
    assert np.nanmedian(result.depth_m) == pytest.approx(96 * 0.1 / 3, rel=0.25)


def test_a_world_velocity_is_turned_into_the_camera():
    """Facing north, level: east is right."""
    north = [0.5, 0.5, 0.5, 0.5]
    network, _ = flown([0.0, 1.0, 0.0], "world", attitude=north)
    units = [moved / np.linalg.norm(moved) for moved in network.displacements]
    assert np.allclose(units, [1.0, 0.0, 0.0])


def test_without_an_attitude_the_pictures_tell():
    network, result = flown([0.0, 0.0, 1.0], "world")
    lengths = [np.linalg.norm(moved) for moved in network.displacements]
    units = np.array(network.displacements) / np.array(lengths)[:, None]
    assert np.degrees(np.arccos(np.clip(units @ [1.0, 0.0, 0.0], -1, 1))).max() < 3
    assert result.displacements_m == pytest.approx(lengths[-1:], rel=1e-6)
    np.testing.assert_array_equal(result.moved_m, network.displacements[-1:])
    # 3 px a frame, 0.1 m a frame, 96 px of focal length.
    assert np.nanmedian(result.depth_m) == pytest.approx(96 * 0.1 / 3, rel=0.25)


def test_blank_pictures_tell_nothing():
    _, result = flown([0.0, 0.0, 1.0], "world", pictures=blank)
    assert result.reason == NO_DIRECTION
    assert np.isnan(result.depth_m).all()


def test_pairs_whose_direction_the_log_tells_come_before_those_of_an_earlier_time_without():
    """Blank pictures; attitudes begin with the fifth frame: facing north, so that east is right."""
    network = Told()
    estimator = MultiRangeEstimator(network, CAMERA, ranges=2)
    reasons = []
    for number in range(8):
        estimator.add_velocity(number * FRAME_NS, [0.0, 1.0, 0.0], frame="world")
        if number >= 4:
            estimator.add_attitude(number * FRAME_NS, [0.5, 0.5, 0.5, 0.5])
        reasons.append(estimator.add_frame(number * FRAME_NS, blank(number)).reason)
    assert reasons[1:] == [NO_DIRECTION] * 4 + [None] * 3
    units = [moved / np.linalg.norm(moved) for moved in network.displacements]
    np.testing.assert_allclose(units, [[1.0, 0.0, 0.0]] * len(units), atol=1e-9)


def test_a_direction_holds_for_a_moment_and_no_longer():
    """Blank pictures from the fourth on, ten a second: the fourth to the eighth have a depth, not the tenth."""
    network = Told()
    estimator = MultiRangeEstimator(network, CAMERA, ranges=1)
    reasons = []
    for number in range(12):
        estimator.add_velocity(number * FRAME_NS, [0.0, 0.0, 1.0], frame="world")
        shown = picture(number) if number < 4 else blank(number)
        reasons.append(estimator.add_frame(number * FRAME_NS, shown).reason)
    assert reasons[1:9] == [None] * 8
    assert reasons[9:] == [NO_DIRECTION] * 3


def test_a_direction_does_not_hold_round_a_bend():
    network = Told()
    estimator = MultiRangeEstimator(network, CAMERA, ranges=1)
    for number in range(8):
        velocity = [0.0, 0.0, 1.0] if number < 4 else [0.0, 1.0, 0.0]
        estimator.add_velocity(number * FRAME_NS, velocity, frame="world")
        shown = picture(number) if number < 4 else blank(number)
        result = estimator.add_frame(number * FRAME_NS, shown)
    assert result.reason == NO_DIRECTION


def test_a_frame_s_direction_is_seen_once_for_all_its_pairs(monkeypatch):
    """To see it may take as long as the network; one that asks for the length alone needs it for the rotation."""
    calls, see = [], direction.direction_seen
    for module in (direction, derotation):
        monkeypatch.setattr(
            module, "direction_seen", lambda *rays: calls.append(1) or see(*rays), raising=False
        )
    estimator = MultiRangeEstimator(Network(difference_card(focal_px=64.0), NearAndFar()), CAMERA, ranges=2)
    pairs = 0
    for number in range(12):
        estimator.add_velocity(number * FRAME_NS, [0.0, 0.0, 1.0], frame="world")
        pairs += len(estimator.add_frame(number * FRAME_NS, picture(number)).shifts)
    assert pairs > 14
    assert len(calls) == 11  # each frame but the first


def test_a_plan_is_told_the_smaller_side_of_the_view():
    """192 x 128 pixels, whatever the lens zooms to."""
    told = []

    class Plan:
        def __init__(self, card, *, sides):
            told.append(sides)

        def look_through(self, card, sides):
            told.append(sides)

    network = Network(swept_card(), BestHypothesis())
    choice = PairChoice(
        network, CAMERA, Tracker(CAMERA), SeenTurns(), planner=Plan, derotate=True, fallback=None
    )
    zoomed = CAMERA.zoomed(2.0)
    choice.look_through(zoomed, Tracker(zoomed))
    assert told == pytest.approx([128 / 96, 128 / 192])
    # And so is a fallback's, once it is open.
    choice._fallback = choice._opened(Network(difference_card(focal_px=64.0), NearAndFar()))
    choice.look_through(CAMERA, Tracker(CAMERA))
    assert told[2:] == pytest.approx([128 / 192, 128 / 96, 128 / 96])


@pytest.mark.parametrize(("frame", "unit"), [("world", [1.0, 0.0, 0.0]), ("camera", None)])
def test_depth_is_averaged_along_the_direction_that_is_seen_where_the_log_tells_none(
    monkeypatch, frame, unit
):
    units = []
    monkeypatch.setattr(temporal, "step_between", lambda *given: units.append(given[2]))
    flown([1.0, 0.0, 0.0], frame)
    assert len(units) == 4  # from the second depth on
    for each in units:
        assert each is None if unit is None else np.linalg.norm(each - unit) < 0.05


def test_a_frame_whose_pairs_are_all_left_out_says_why(monkeypatch):
    monkeypatch.setattr(derotation.Derotation, "of", lambda *_: ())
    _, result = flown([1.0, 0.0, 0.0], "camera")
    assert result.reason == estimator.NOT_RIGID
    assert np.isnan(result.depth_m).all()


def test_no_frame_is_made_as_bright_for_a_look_that_is_not_due(monkeypatch):
    """The log is asked four times a second; in between only what the network sees is."""
    exposed = []
    monkeypatch.setattr(exposure, "_exposed_as", lambda image, *_, **__: exposed.append(1) or image)
    asked = []
    monkeypatch.setattr(LogCheck, "_off_rad", lambda self, pair, current: asked.append(1) or 0.0)
    network, _ = flown([1.0, 0.0, 0.0], "camera")
    assert len(asked) == 2
    assert len(exposed) <= len(network.displacements) + len(asked)
