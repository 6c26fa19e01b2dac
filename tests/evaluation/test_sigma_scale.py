"""The scale of an error bar, fitted with a network whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest
from plane_pairs import plane_pair

from flightdepth.camera import Camera
from flightdepth.evaluation import sigma_scale
from flightdepth.evaluation.fixed_set import fixed_set, outdoor_set
from flightdepth.evaluation.network import evaluate_network
from flightdepth.evaluation.sigma_scale import (
    believed,
    calibration_set,
    fitted_sigma_scale,
    outdoor_calibration_set,
)
from flightdepth.ranges.fusion import WORST_SIGMA, ends
from flightdepth.runtimes.error_bar import USUAL_BETA
from flightdepth.runtimes.network import Network
from flightdepth.stillbox import testset
from flightdepth.weights.store import SHIPPED, read_card
from tests_textures import few_textures

CARD = read_card(SHIPPED / "motion.onnx").model_copy(
    update={"sigma_scale": 1.0, "sigma_growth": 0.0, "sigma_far": 0.0, "sigma_lens": 0.0}
)
CAMERA = Camera.from_fov(128, 128, 90)


class Drawn:
    """Errs by normal errors of 2 m around 25 m at D0, and says that sigma is `told_m`."""

    description, architecture = "drawn", "MotionNet"

    def __init__(self, told_m: float, more_through: int = 0) -> None:
        """Errors are twice as large in pictures `more_through` pixels wide."""
        self._told_m, self._more_through, self._rng = told_m, more_through, np.random.default_rng(0)

    def __call__(self, inputs):
        n, height, width = inputs["current"].shape[:3]
        shape = n, height // 4, width // 4
        spread_m = 4 if width == self._more_through else 2
        depth_m = self._rng.normal(25, spread_m, shape).astype(np.float32)
        depth_m[:, : height // 128] = 99.0  # at the end of the range: not believed, whatever its error
        return {"depth_m": depth_m, "sigma_m": np.full(shape, self._told_m, np.float32)}


@pytest.mark.parametrize(("told_m", "card_scale"), [(1.0, 1.0), (2.0, 1.0), (4.0, 1.0), (4.0, 0.25)])
def test_the_scale_makes_the_error_bar_honest(told_m: float, card_scale: float) -> None:
    card = CARD.at_focal(CAMERA.fx).model_copy(update={"sigma_scale": card_scale})
    network = Network(card, Drawn(told_m), aligned=False)
    pairs = [plane_pair(CAMERA, (card.D0_m, 0.0, 0.0), distance_m=25.0, seed=seed) for seed in range(3)]
    assert fitted_sigma_scale(network, pairs) == (
        pytest.approx(2 / told_m, rel=0.05),
        0.0,
        0.0,
        0.0,
    )


def test_a_scale_that_grows_with_the_focal_length_is_found() -> None:
    """Twice the error at four times the focal length, half a power: 2 m at 64 px is 4 m at 256, the usual one."""
    pairs = [
        plane_pair(camera, (CARD.at_focal(camera.fx).D0_m, 0.0, 0.0), distance_m=25.0, seed=seed)
        for seed in range(2)
        for camera in (CAMERA, Camera.from_fov(512, 512, 90))
    ]
    network = Network(CARD, Drawn(1.0, more_through=512), aligned=False)
    assert fitted_sigma_scale(network, pairs) == (
        pytest.approx(4, rel=0.05),
        0.0,
        0.0,
        pytest.approx(0.5, abs=0.051),
    )


class UnderSky(Drawn):
    """Half of each other picture is sky, where the errors of the rest are e^0.4 times as large."""

    calls = 0

    def __call__(self, inputs):
        found = super().__call__(inputs)
        depth_m, self.calls = found["depth_m"], self.calls + 1
        if self.calls % 2:
            depth_m[:] = 25 + (depth_m - 25) * np.float32(np.exp(0.4))
            depth_m[:, :16] = 99.0
        return found


def test_a_scale_that_grows_with_the_sky_is_found() -> None:
    """By e^0.4 from 1/32 of it to 1/2."""
    card = CARD.at_focal(CAMERA.fx)
    pairs = [plane_pair(CAMERA, (card.D0_m, 0.0, 0.0), distance_m=25.0, seed=seed) for seed in range(8)]
    found = fitted_sigma_scale(Network(card, UnderSky(1.0), aligned=False), pairs)
    # All that is believed is as far: what grows with the sky alone and with its distance too cannot be told apart.
    growth = found.sigma_growth + found.sigma_far * np.log(0.25 / USUAL_BETA)
    assert growth == pytest.approx(0.4 / (1 / 2 - 1 / 32), abs=0.11)
    assert found.sigma_scale * np.exp(growth / 32) == pytest.approx(2, rel=0.06)
    assert found.sigma_lens == 0


class FarUnderSky(Drawn):
    """Half a picture is sky, a quarter 10 m away, a quarter 20, with an error that is 2^0.75 as large a share there."""

    def __call__(self, inputs):
        found = super().__call__(inputs)
        depth_m, off_m = found["depth_m"], (found["depth_m"] - 25) / 4
        depth_m[:, :16], depth_m[:, 16:24], depth_m[:, 24:] = 99, 10, 20
        depth_m[:, 16:] += off_m[:, 16:]
        depth_m[:, 24:] += (2**1.75 - 1) * off_m[:, 24:]
        found["sigma_m"][:, 16:24], found["sigma_m"][:, 24:] = 0.25, 0.5
        return found


def test_a_scale_that_grows_with_the_distance_under_a_sky_is_found() -> None:
    card = CARD.at_focal(CAMERA.fx)
    pair = plane_pair(CAMERA, (card.D0_m, 0.0, 0.0), distance_m=10.0)
    truth_m = pair.depth_m.copy()
    truth_m[96:] *= 2
    found = fitted_sigma_scale(
        Network(card, FarUnderSky(1.0), aligned=False), [replace(pair, depth_m=truth_m)] * 6
    )
    assert found.sigma_far == pytest.approx(1.5, abs=0.11)  # half of it is sky, so by the root of that
    assert 10 / CARD.depth_max_m == USUAL_BETA
    assert found.sigma_scale * np.exp(found.sigma_growth / 2) == pytest.approx(2, rel=0.06)


def test_flights_believe_what_is_within_the_range_and_not_too_uncertain() -> None:
    lower, upper = (end * CARD.depth_max_m for end in ends(CARD))
    depth_m = np.array([0.99 * lower, 1.01 * lower, 0.99 * upper, 1.01 * upper, 25, 25])
    sigma_m = WORST_SIGMA * depth_m * np.array([0.5, 0.5, 0.5, 0.5, 0.99, 1.01])
    assert believed(CARD, depth_m, sigma_m).tolist() == [False, True, True, False, True, False]


def test_outdoors_it_is_fitted_on_other_flights_than_the_error_is_measured_on() -> None:
    fixed, ours = outdoor_set(CARD, scenes=4), outdoor_calibration_set(CARD, scenes=4)
    assert ours.seed != fixed.seed
    assert replace(ours, seed=fixed.seed) == fixed


def test_the_card_s_growth_is_no_part_of_what_is_fitted() -> None:
    card = CARD.at_focal(CAMERA.fx)
    pairs = [plane_pair(CAMERA, (card.D0_m, 0.0, 0.0), distance_m=25.0)]
    with_growth = card.model_copy(update={"sigma_growth": 0.8, "sigma_far": 0.5, "sigma_lens": 0.3})
    told = [
        fitted_sigma_scale(Network(each, Drawn(1.0), aligned=False), pairs) for each in (card, with_growth)
    ]
    assert told[0] == pytest.approx(told[1], rel=1e-5)


def test_the_report_tells_what_flights_believe_apart() -> None:
    """The first row of blocks is at the end of the range, with errors of 74 m."""
    card = CARD.at_focal(CAMERA.fx)
    pairs = [plane_pair(CAMERA, (card.D0_m, 0.0, 0.0), distance_m=25.0)]
    found = evaluate_network(Network(card, Drawn(2.0), aligned=False), pairs, set_name="planes")["spread"]
    assert found["believed"] == {"share": 1 - 1 / 32, "inside_one": pytest.approx(0.683, abs=0.04)}
    assert found["inside_one"] == pytest.approx(found["believed"]["inside_one"] * (1 - 1 / 32))


def test_it_is_fitted_on_other_scenes_than_the_error_is_measured_on(monkeypatch) -> None:
    seeds = []
    monkeypatch.setattr(sigma_scale, "test_textures", lambda seed: seeds.append(seed) or few_textures())
    fixed, ours = fixed_set(CARD, scenes=4), calibration_set(CARD, scenes=4)
    assert ours.seed != fixed.seed
    assert (ours.picture, ours.rule, len(ours)) == (fixed.picture, fixed.rule, 4)
    assert ours.config == fixed.config and ours.textures is not fixed.textures
    assert len(seeds) == 1 and seeds[0] != testset.TEXTURE_SEED
