from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flightdepth.runtimes.network as network_module
from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.runtimes.network import Network, lightest_network, load_network, nearest_network, networks
from flightdepth.weights.store import SHIPPED, read_card
from tests_networks import BestHypothesis, difference_card, swept_card

SQUARE = Camera.from_fov(64, 64, 90)
WIDE = Camera.from_fov(200, 120, 70)


class Difference:
    """The hand-made network in numpy: depth = 100 - 10 |current - previous| / 51, averaged over 4x4 px."""

    description = "numpy"
    architecture = "DepthNet"
    calls = 0

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        self.calls += 1
        (pairs,) = inputs.values()
        n, height, width, _ = pairs.shape
        change = np.abs(pairs[..., 3:].astype(np.float32) - pairs[..., :3]).mean(axis=3) / 51
        cells = change.reshape(n, height // 4, 4, width // 4, 4).mean(axis=(2, 4))
        return {"depth_m": np.asarray((100 - 10 * cells).clip(0, 100), dtype=np.float32)}


def grey(camera: Camera, level: int) -> np.ndarray:
    return np.full((camera.height, camera.width, 3), level, np.uint8)


@pytest.fixture
def network() -> Network:
    return Network(difference_card(), Difference())


def test_a_file_gives_the_numbers_made_by_hand(save_difference_network: Callable[..., Path]) -> None:
    network = load_network(save_difference_network())
    # 51 levels: 90 m at D0 = 0.3 m; the displacement is 0.6 m, so 180 m.
    depth = network.depth(grey(WIDE, 100), grey(WIDE, 151), [0.0, 0.6, 0.0], WIDE)
    assert depth.shape == (120, 200)
    assert depth == pytest.approx(np.full((120, 200), 180.0), rel=1e-5)


def test_numpy_and_the_file_agree(save_difference_network: Callable[..., Path], network: Network) -> None:
    rng = np.random.default_rng(0)
    previous, current = rng.integers(0, 256, (2, 120, 200, 3)).astype(np.uint8)
    loaded = load_network(save_difference_network(), threads=1)
    expected = network.depth(previous, current, 0.3, WIDE)
    assert loaded.depth(previous, current, 0.3, WIDE) == pytest.approx(expected, rel=1e-4)


@given(scale=st.floats(1e-3, 1e3))
@settings(max_examples=8, deadline=None)
def test_depth_scales_with_the_displacement(scale: float) -> None:
    network = Network(difference_card(), Difference())
    once = network.depth(grey(WIDE, 9), grey(WIDE, 70), 0.3, WIDE)
    scaled = network.depth(grey(WIDE, 9), grey(WIDE, 70), 0.3 * scale, WIDE)
    assert scaled == pytest.approx(once * scale, rel=1e-5)


def test_a_vector_counts_by_its_length(network: Network) -> None:
    images = (grey(WIDE, 9), grey(WIDE, 70))
    assert np.array_equal(network.depth(*images, [2.0, 3.0, 6.0], WIDE), network.depth(*images, 7.0, WIDE))


def test_no_displacement_is_unknown(network: Network) -> None:
    assert np.isnan(network.depth(grey(WIDE, 9), grey(WIDE, 70), 0.0, WIDE)).all()


def test_beta_is_the_share_of_the_largest_depth(network: Network) -> None:
    prediction = network.predict([grey(SQUARE, 100)], grey(SQUARE, 151), [0.6], SQUARE)
    assert prediction.beta == pytest.approx(np.full((1, 16, 16), 0.9))
    assert prediction.depth_m == pytest.approx(network.card.alpha * 0.6 * prediction.beta)
    assert prediction.sigma_m is None


def test_pairs_keep_their_order_and_their_displacements(network: Network) -> None:
    previous = [grey(SQUARE, level) for level in (100, 49, 151)]
    prediction = network.predict(previous, grey(SQUARE, 151), [0.3, 0.0, 0.6], SQUARE)
    means = prediction.depth_m.mean(axis=(1, 2))
    assert means[[0, 2]] == pytest.approx([90.0, 200.0])
    assert np.isnan(prediction.depth_m[1]).all()
    assert prediction.beta[1] == pytest.approx(np.full((16, 16), 0.8))


def test_previous_comes_first_and_channels_keep_their_order() -> None:
    seen: list[np.ndarray] = []

    class Recorder(Difference):
        def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            seen.append(inputs["pairs"])
            return super().__call__(inputs)

    previous = np.arange(64 * 64 * 3, dtype=np.uint8).reshape(64, 64, 3)
    current = previous[::-1]
    Network(difference_card(), Recorder()).predict([previous], current, [1.0], SQUARE)
    assert np.array_equal(seen[0][0, ..., :3], previous)
    assert np.array_equal(seen[0][0, ..., 3:], current)


def test_n_pairs_are_one_call(network: Network) -> None:
    network.predict([grey(WIDE, 1)] * 4, grey(WIDE, 2), [1.0] * 4, WIDE)
    assert isinstance(network.runtime, Difference)
    assert network.runtime.calls == 1


def test_a_camera_has_one_grid(network: Network) -> None:
    assert network.grid(WIDE) is network.grid(Camera.from_fov(200, 120, 70))


def test_many_cameras_keep_few_grids(network: Network) -> None:
    for width in range(100, 130):
        network.grid(Camera.from_fov(width, 100, 70))
    assert len(network._grids) == network_module.GRIDS_KEPT


def test_the_grid_in_use_is_kept(network: Network) -> None:
    grid = network.grid(WIDE)
    for width in range(100, 130):
        network.grid(Camera.from_fov(width, 100, 70))
        assert network.grid(WIDE) is grid


def test_a_network_for_any_lens_sees_what_the_padding_would_take() -> None:
    """640x360 at 417 px and 256 px would be 393x221 of 448x256: 1.14 times as fine costs nothing more."""
    camera = Camera(640, 360, 417.0, 417.0, 319.5, 179.5)
    grid = Network(swept_card(), BestHypothesis()).at_focal(256.0).grid(camera)
    assert (grid.camera.width, grid.camera.height) == (448, 256)
    assert grid.camera.fx == pytest.approx(417 * 448 / 640, rel=0.002)


@given(
    st.integers(64, 900),
    st.integers(64, 700),
    st.floats(60, 450),
    st.floats(0.9, 1.1),
    st.sampled_from([64, 256]),
)
@settings(max_examples=60, deadline=None)
def test_the_grid_of_a_grid_is_itself(
    width: int, height: int, fx: float, ratio: float, focal_px: int
) -> None:
    for card in (swept_card(), difference_card()):
        network = Network(card, BestHypothesis()).at_focal(float(focal_px))
        grid = network.grid(Camera(width, height, fx, fx * ratio, width / 2, height / 2))
        again = network.grid(grid.camera)
        assert again.camera == grid.camera
        assert again.valid.all()


def test_frames_that_are_on_the_grid_already_give_the_same_maps(network: Network) -> None:
    grid = network.grid(WIDE)
    rng = np.random.default_rng(3)
    previous, current = rng.integers(0, 256, (2, 120, 200, 3)).astype(np.uint8)
    direct = network.predict([previous], current, [1.0], WIDE)
    staged = network.predict([grid.image(previous)], grid.image(current), [1.0], grid.camera)
    assert np.array_equal(direct.depth_m, staged.depth_m)


def test_warming_up_runs_every_batch_size(network: Network) -> None:
    network.warm_up(WIDE, pairs=3)
    assert isinstance(network.runtime, Difference)
    assert network.runtime.calls == 3


@pytest.mark.parametrize(
    "displacement", [float("nan"), float("inf"), -0.1, [1.0, float("nan"), 0.0], [1.0, 2.0], [[1.0]], []]
)
def test_a_displacement_that_is_none_is_refused(network: Network, displacement: object) -> None:
    with pytest.raises(BadInput, match="displacement"):
        network.depth(grey(WIDE, 1), grey(WIDE, 2), displacement, WIDE)  # type: ignore[arg-type]


def test_as_many_displacements_as_pictures(network: Network) -> None:
    with pytest.raises(BadInput, match="2 lengths or 2 vectors of 3"):
        network.predict([grey(WIDE, 1)] * 2, grey(WIDE, 2), [1.0, 2.0, 3.0], WIDE)


def test_no_pair_at_all_is_refused(network: Network) -> None:
    with pytest.raises(BadInput, match="at least one"):
        network.predict([], grey(WIDE, 2), [], WIDE)


def test_a_picture_of_another_camera_is_refused(network: Network) -> None:
    with pytest.raises(BadInput, match="previous image: expected uint8 RGB"):
        network.depth(grey(SQUARE, 1), grey(WIDE, 2), 1.0, WIDE)


def test_what_is_no_camera_is_refused(network: Network) -> None:
    with pytest.raises(BadInput, match=r"camera: expected a flightdepth\.Camera, got None"):
        network.grid(None)  # type: ignore[arg-type]


def test_a_network_shows_its_name(network: Network) -> None:
    assert repr(network).startswith(f"Network('{network.card.name}', ")


def test_an_unknown_name_is_answered_with_the_names() -> None:
    with pytest.raises(BadInput, match="network: expected a path to an ONNX file or one of"):
        load_network("depthnet-255")


def test_a_flownets_is_opened_as_what_keeps_depthnets_contract(
    save_difference_network: Callable[..., Path],
) -> None:
    assert load_network(save_difference_network(architecture="FlowNetS")).card.architecture == "FlowNetS"


def test_every_shipped_network_has_a_valid_card() -> None:
    for name in networks():
        assert load_network(name).card.name == name


def test_the_nearest_focal_length_wins_by_ratio(
    save_difference_network: Callable[..., Path], tmp_path: Path
) -> None:
    save_difference_network(name="short", focal_px=128.0)
    save_difference_network(name="long", focal_px=512.0)
    # 300 px is nearer to 128 by difference, but nearer to 512 by ratio.
    assert nearest_network(Camera(640, 480, 300.0, 300.0, 320.0, 240.0), tmp_path) == "long"
    assert nearest_network(Camera(640, 480, 250.0, 250.0, 320.0, 240.0), tmp_path) == "short"


def test_of_equal_focal_lengths_the_smaller_network_wins(
    save_difference_network: Callable[..., Path], tmp_path: Path
) -> None:
    save_difference_network(name="a-wide", base_width=32)
    save_difference_network(name="b-tiny", base_width=16)
    assert nearest_network(WIDE, tmp_path) == "b-tiny"


def test_of_equal_sizes_the_one_that_sees_finest_wins(
    tmp_path: Path, save_difference_network: Callable[..., Path]
) -> None:
    for name, focal_px in (("a-coarse", 64.0), ("b-fine", 128.0)):
        card = swept_card().at_focal(focal_px).model_copy(update={"name": name})
        (tmp_path / f"{name}.json").write_text(card.model_dump_json())
        (tmp_path / f"{name}.onnx").touch()
    assert nearest_network(WIDE, tmp_path) == "b-fine"


@pytest.mark.parametrize("camera", [Camera.from_fov(1920, 1080, 15), Camera.from_fov(1080, 1920, 9)])
def test_a_long_lens_is_seen_as_wide_as_its_focal_length_would_be_of_others(camera: Camera) -> None:
    """Else a lens of 15 degrees would be 67 px across: 256 px of the longer side are shown, or what fills the grid."""
    grid = Network(swept_card(), BestHypothesis()).at_focal(256.0).grid(camera)
    assert max(grid.camera.width, grid.camera.height) == 256
    longer = max(np.flatnonzero(grid.valid.any(axis=0)).size, np.flatnonzero(grid.valid.any(axis=1)).size)
    assert longer * 4 == 256


def test_finer_pictures_are_those_of_a_longer_focal_length() -> None:
    network = Network(swept_card(), BestHypothesis()).at_focal(64.0)
    assert network.finer(1) is network
    assert network.finer(2).card == network.card.at_focal(128.0)


def test_a_detail_may_be_a_fifth_and_five() -> None:
    network = Network(swept_card(), BestHypothesis(), aligned=False).at_focal(64.0)
    for times in (0.2, 5):
        finer = network.finer(times)
        assert finer.card == network.card.at_focal(64.0 * times)
        assert finer.runtime is network.runtime and not finer.aligned


@pytest.mark.parametrize("times", [0.0, -1.0, 6.0, float("nan"), float("inf")])
def test_a_detail_that_is_none_is_refused(times: float) -> None:
    with pytest.raises(BadInput, match=r"detail: expected 0.2 to 5"):
        Network(swept_card(), BestHypothesis()).finer(times)


def test_a_network_of_one_focal_length_has_one_detail(network: Network) -> None:
    with pytest.raises(BadInput, match="knows one focal length"):
        network.finer(2)


def test_no_network_at_all_is_said(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="Give --network FILE"):
        nearest_network(WIDE, tmp_path)


def checkers(camera: Camera, left: int = 0) -> np.ndarray:
    """Smooth noise, seen `left` pixels farther to the left."""
    noise = np.random.default_rng(4).integers(0, 256, (camera.height, camera.width + 40), dtype=np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0) * 3.0 - 256
    seen = smooth[:, 20 + left : 20 + left + camera.width].clip(0, 255).astype(np.uint8)
    return np.repeat(seen[..., None], 3, axis=2)


# Aligning takes what it sees of a rotation out, here some 1e-6 of a radian, and its judge differs by itself by 6e-4.
@pytest.mark.parametrize(("aligned", "off"), [(False, 1e-5), (True, 2e-3)])
@pytest.mark.parametrize("focal_px", [48.0, 64.0, 128.0])
@pytest.mark.parametrize(("pixels", "way"), [(2, 1), (-3, -1)])
def test_a_motion_network_finds_metres_through_any_lens(
    focal_px: float, pixels: int, way: int, aligned: bool, off: float
) -> None:
    """All moved by whole pixels sideways: depth = focal * displacement / pixels."""
    camera = Camera(192, 128, focal_px, focal_px, 90.0, 60.0)
    network = Network(swept_card(), BestHypothesis(), aligned=aligned).at_focal(focal_px)
    # What was `pixels` farther right before came from there: the displacement points right.
    depth = network.depth(checkers(camera, -pixels), checkers(camera), [0.5 * way, 0.0, 0.0], camera)
    expected = focal_px * 0.5 / abs(pixels)
    assert np.median(depth) == pytest.approx(expected, rel=off)


def test_a_motion_network_tells_its_error_in_metres() -> None:
    network = Network(swept_card(), BestHypothesis(), aligned=False)
    prediction = network.predict([checkers(SQUARE, -2)], checkers(SQUARE), [[2.0, 0.0, 0.0]], SQUARE)
    assert prediction.sigma_m == pytest.approx(0.1 * prediction.depth_m, rel=1e-5)


def test_the_cards_scale_multiplies_the_error_bar_and_nothing_else() -> None:
    pair = [checkers(SQUARE, -2)], checkers(SQUARE), [[2.0, 0.0, 0.0]], SQUARE
    plain, scaled = (
        Network(swept_card().model_copy(update={"sigma_scale": scale}), BestHypothesis()).predict(*pair)
        for scale in (1.0, 0.7)
    )
    assert scaled.sigma_m == pytest.approx(0.7 * plain.sigma_m, rel=1e-5)
    np.testing.assert_array_equal(scaled.depth_m, plain.depth_m)


def test_a_motion_network_needs_the_direction() -> None:
    network = Network(swept_card(), BestHypothesis())
    with pytest.raises(BadInput, match=r"expected a vector of 3 .*: it needs the direction"):
        network.depth(grey(SQUARE, 1), grey(SQUARE, 2), 0.3, SQUARE)


def test_a_length_of_0_is_unknown_to_a_motion_network_too() -> None:
    """Found in review: it was refused for want of a direction, which no motion has."""
    network = Network(swept_card(), BestHypothesis())
    assert np.isnan(network.depth(grey(SQUARE, 1), grey(SQUARE, 2), 0, SQUARE)).all()


@pytest.mark.parametrize("displacement", [[[0.3, 0.0, 0.0]], [0.3], [0.3, 0.0]])
def test_a_displacement_of_another_shape_is_told_what_depth_takes(displacement: object) -> None:
    """Found in review: the message spoke of "1 vectors of 3" to who had given [1, 3]."""
    network = Network(swept_card(), BestHypothesis())
    with pytest.raises(BadInput, match=r"^displacement: expected a vector of 3, or a length"):
        network.depth(grey(SQUARE, 1), grey(SQUARE, 2), displacement, SQUARE)


@pytest.mark.parametrize("name", networks())
def test_every_shipped_network_runs(name: str) -> None:
    camera = Camera.from_fov(256, 128, 80)
    depth = load_network(name).depth(checkers(camera, -2), checkers(camera), [0.3, 0.0, 0.0], camera)
    assert depth.shape == (128, 256)
    assert np.isfinite(depth).mean() > 0.9
    assert depth.min() >= 0


def test_the_lightest_network_is_one_of_the_same_kind_that_takes_less_time() -> None:
    """Half the feature maps, and sides half as long; of one that takes as little itself there is none."""
    cards = {name: read_card(SHIPPED / f"{name}.onnx") for name in networks()}
    assert lightest_network(cards["motion"]) == "motion-tiny"
    assert lightest_network(cards["depthnet-256"]) == "tiny-clamped-256"
    assert lightest_network(cards["motion-tiny"]) is None
    assert lightest_network(cards["motion"].at_focal(128.0)) is None


def test_a_card_of_other_weights_is_refused(save_difference_network: Callable[..., Path]) -> None:
    path = save_difference_network(architecture="MotionNet", any_lens=True)
    with pytest.raises(BadInput, match=r"weights of difference: expected a MotionNet, .* got a DepthNet"):
        load_network(path)
