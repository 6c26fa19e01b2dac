from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from plane_pairs import PlanePair, plane_pair
from rich.console import Console

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.network import evaluate_network, relative_cost
from flightdepth.evaluation.network_tables import tables
from flightdepth.evaluation.pairs import Task
from flightdepth.evaluation.pictures import error_picture, sheet, write_sheets
from flightdepth.evaluation.provenance import source_commit
from flightdepth.files import write_json
from flightdepth.runtimes.network import Network
from tests_networks import difference_card

CAMERA = Camera.from_fov(128, 64, 90)  # focal length 64 px
CARD = difference_card(focal_px=64.0, depth_min_m=0.0, depth_max_m=100.0, samples=5)
D0 = 0.3


class Constant:
    """Answers `depth_m` everywhere."""

    description = "numpy"
    architecture = "DepthNet"

    def __init__(self, depth_m: float) -> None:
        self.depth_m = depth_m

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        n, height, width, _ = inputs["pairs"].shape
        return {"depth_m": np.full((n, height // 4, width // 4), self.depth_m, np.float32)}


class Sure(Constant):
    """The same, `sigma_m` its error bar everywhere."""

    def __init__(self, depth_m: float, sigma_m: float) -> None:
        super().__init__(depth_m)
        self.sigma_m = sigma_m

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        found = super().__call__(inputs)
        return found | {"sigma_m": np.full_like(found["depth_m"], self.sigma_m)}


def pairs() -> list[PlanePair]:
    ways = [(D0, 0.0, 0.0), (0.0, 0.0, D0), (0.0, -D0, 0.0)]
    return [
        plane_pair(CAMERA, way, distance_m=distance, seed=seed)
        for seed, (way, distance) in enumerate(zip(ways, (4.0, 5.0, 8.0), strict=True))
    ]


def test_numbers_by_hand() -> None:
    result = evaluate_network(Network(CARD, Constant(6.0)), pairs(), set_name="planes", seed=3)
    assert result["network"]["l1_m"] == pytest.approx((2 + 1 + 2) / 3, rel=1e-4)
    assert result["constant"]["depth_m"] == pytest.approx(5.0, rel=1e-4)
    assert result["constant"]["l1_m"] == pytest.approx((1 + 0 + 3) / 3, rel=1e-4)
    assert result["l1_ratios"]["constant"] == pytest.approx(5 / 4, rel=1e-3)
    assert (result["set"], result["seed"], result["pairs"], result["samples"]) == ("planes", 3, 3, 5)
    places = {row["place"]: row for row in result["places"]}
    assert places["flat, textured"]["share"] == 1  # planes that face the camera
    assert places["flat, textured"]["network"]["l1_m"] == pytest.approx((2 + 1 + 2) / 3, rel=1e-4)
    assert places["at an edge"]["network"]["l1_m"] is None


def test_the_classical_peer_beats_a_constant_on_textured_planes() -> None:
    result = evaluate_network(Network(CARD, Constant(6.0)), pairs(), set_name="planes")
    assert result["classical"]["l1_m"] < 0.5 * result["constant"]["l1_m"]


def test_angles_of_travel_tell_the_pictures_apart() -> None:
    result = evaluate_network(Network(CARD, Constant(6.0)), pairs(), set_name="planes")
    angles = {row["from_deg"]: row for row in result["network"]["travel_angles"] if row["pictures"]}
    assert angles[0]["l1_m"] == pytest.approx(1, rel=1e-4)
    assert (angles[90]["l1_m"], angles[90]["pictures"]) == (pytest.approx(2, rel=1e-4), 2)


def test_pixels_without_a_truth_say_nothing_of_the_error_bar() -> None:
    """They counted as outside of it, and made its errors NaN."""
    network, pair = Network(CARD, Sure(6.0, 2.2)), pairs()[0]  # its truth is 4 m
    whole, holed, unknown = (
        evaluate_network(network, [replace(pair, depth_m=depth_m)], set_name="holes")
        for depth_m in (
            pair.depth_m,
            np.where(np.arange(128) < 64, pair.depth_m, np.nan),
            np.full_like(pair.depth_m, np.nan),
        )
    )
    assert whole["spread"]["inside_one"] == whole["spread"]["believed"]["inside_one"] == 1
    assert holed["spread"] == whole["spread"]
    assert "spread" not in unknown


def test_the_result_is_json(tmp_path: Path) -> None:
    result = evaluate_network(Network(CARD, Constant(6.0)), pairs(), set_name="planes")
    write_json(tmp_path / "result.json", result)
    assert json.loads((tmp_path / "result.json").read_text()) == result


def test_percentiles_are_those_of_pixels_not_of_means_over_blocks() -> None:
    depth_m = np.random.default_rng(1).choice(np.float32([2, 10]), (64, 128))
    result = evaluate_network(
        Network(CARD, Constant(6.0)), [replace(pairs()[0], depth_m=depth_m)], set_name="sand"
    )
    assert result["truth_percentiles_m"]["25"] == pytest.approx(2)
    assert result["truth_percentiles_m"]["75"] == pytest.approx(10)


def test_an_empty_set_has_no_figures(tmp_path: Path) -> None:
    result = evaluate_network(Network(CARD, Constant(6.0)), [], set_name="none")
    write_json(tmp_path / "result.json", result)
    assert result["network"]["l1_m"] is None


def test_the_truth_is_clipped_then_pooled() -> None:
    pair = pairs()[0]
    depth_m = np.where(np.arange(128) % 4 < 2, np.float32(8), np.float32(300)) + np.zeros((64, 1), np.float32)
    far = PlanePair(pair.previous, pair.current, depth_m, pair.displacement, pair.focal_px)
    assert Task.of(far, CARD).truth_m == pytest.approx(np.full((16, 32), (8 + 100) / 2))


def test_a_longer_displacement_brings_the_truth_nearer() -> None:
    pair = plane_pair(CAMERA, (2 * D0, 0.0, 0.0), distance_m=8.0)
    task = Task.of(pair, CARD)
    assert task.truth_m == pytest.approx(np.full((16, 32), 4.0), rel=1e-5)
    assert task.nominal == pytest.approx([D0, 0, 0])


def test_the_peer_is_held_to_the_same_truth_for_a_longer_displacement() -> None:
    pair = plane_pair(CAMERA, (2 * D0, 0.0, 0.0), distance_m=8.0)
    result = evaluate_network(Network(CARD, Constant(4.0)), [pair], set_name="planes")
    assert result["network"]["l1_m"] == pytest.approx(0, abs=1e-4)
    assert result["classical"]["l1_m"] < 0.3


def test_a_set_of_another_focal_length_is_refused() -> None:
    network = Network(difference_card(focal_px=128.0), Constant(1.0))
    with pytest.raises(BadInput, match=r"focal length 128 px .* got 64 px, 128x64"):
        evaluate_network(network, pairs(), set_name="planes")


@pytest.mark.parametrize(
    ("focal_px", "shape"), [(64 * 1.02, (64, 128)), (64.0, (60, 128)), (64.0, (64, 120))]
)
def test_a_pair_a_little_out_of_what_the_network_knows_is_refused(
    focal_px: float, shape: tuple[int, int]
) -> None:
    pair = replace(pairs()[0], focal_px=focal_px, depth_m=np.ones(shape, np.float32))
    with pytest.raises(BadInput, match=r"focal length 64 px and sides of 64 px multiples"):
        Task.of(pair, CARD)


def test_a_focal_length_less_than_a_per_cent_off_is_the_pair_s_own() -> None:
    camera = Task.of(replace(pairs()[0], focal_px=64.5), CARD).camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (64.5, 64.5, 63.5, 31.5)


def test_a_block_tells_one_of_its_pixels_and_how_far_they_are_apart() -> None:
    rows, columns = np.indices((64, 128), np.float32)
    depth_m = 2 + rows % 4 + 4 * (columns % 4)  # 2 to 17 m
    task = Task.of(replace(pairs()[0], depth_m=depth_m), CARD)
    assert task.sampled_m == pytest.approx(np.full((16, 32), 2 + 2 + 4 * 2), rel=1e-5)
    assert task.apart == pytest.approx(np.full((16, 32), 17 / 2), rel=1e-5)
    assert task.truth_m == pytest.approx(np.full((16, 32), 9.5), rel=1e-5)


def test_a_network_is_asked_of_the_pair_or_of_what_is_given_instead() -> None:
    class Asked:
        def at_focal(self, focal_px: float) -> Asked:
            assert focal_px == 64
            return self

        def predict(
            self, previous: list[np.ndarray], current: np.ndarray, moved: np.ndarray, _: Camera
        ) -> tuple:
            return previous[0], current, moved

    pair = pairs()[0]
    task, other, way = Task.of(pair, CARD), pairs()[1].current, np.array([0.0, 0.1, 0.0])
    plain, wrong = task.ask(Asked(), pair), task.ask(Asked(), pair, previous=other, nominal=way)
    assert plain[0] is pair.previous and wrong[0] is other
    assert plain[1] is wrong[1] is pair.current
    assert (plain[2].tolist(), wrong[2].tolist()) == ([task.nominal.tolist()], [way.tolist()])


def test_a_pair_without_displacement_is_refused() -> None:
    pair = pairs()[0]
    still = PlanePair(pair.previous, pair.current, pair.depth_m, np.zeros(3), pair.focal_px)
    with pytest.raises(BadInput, match="expected a displacement"):
        Task.of(still, CARD)


def test_the_cost_of_bf16_is_relative() -> None:
    # Truth 8 m on average off by 2 and by 2.2.
    exact, rounded = Network(CARD, Constant(6.0)), Network(CARD, Constant(5.8))
    cost = relative_cost(exact, rounded, [pairs()[2]])
    assert cost["relative_cost"] == pytest.approx(0.1, rel=1e-3)
    assert cost["largest_change"] == pytest.approx(0.2 / 6, rel=1e-4)


def test_tables_hold_the_figures() -> None:
    result = evaluate_network(Network(CARD, Constant(6.0)), pairs(), set_name="planes")
    console = Console(width=120)
    with console.capture() as captured:
        for table in tables(result):
            console.print(table)
    text = captured.get()
    assert "difference on planes, 3 pairs" in text
    assert "1.667" in text
    assert "40 to 60" in text


def test_too_far_is_red_too_near_is_blue_and_right_is_green() -> None:
    truth = np.array([[50, 50, 50, np.nan]], np.float32)
    colours = error_picture(np.array([[90, 10, 50, 50]], np.float32), truth, 20)[0]
    assert colours.argmax(axis=1)[:3].tolist() == [0, 2, 1]
    assert len(set(colours[3])) == 1


def test_a_sheet_holds_the_input_above_the_truth() -> None:
    pair = pairs()[0]
    truth = np.full((16, 32), 10, np.float32)
    picture = sheet(pair.current, truth, truth * 2, 100)
    assert picture.shape == (128, 256, 3)
    assert np.array_equal(picture[:64, :128], pair.current)
    # Nearer is brighter: the truth (10 m, left) than the prediction (20 m, right).
    assert picture[64:, :128].mean() > picture[64:, 128:].mean()


def test_sheets_are_written_as_rgb(tmp_path: Path) -> None:
    paths = write_sheets(Network(CARD, Constant(30.0)), pairs()[:2], tmp_path)
    assert [path.name for path in paths] == ["000.png", "001.png"]
    red = cv2.imread(str(paths[0]))[10, 200]
    assert red[2] > max(red[0], red[1])


def test_outside_of_a_working_copy_there_is_no_commit(tmp_path: Path) -> None:
    assert source_commit(tmp_path) is None
