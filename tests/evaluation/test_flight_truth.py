"""Errors of a flight beside its truth: against plain NumPy, and what is said of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from flightdepth.evaluation.depth_ratios import Ratios
from flightdepth.evaluation.flight_errors import RANGES, DepthRange
from flightdepth.evaluation.flight_truth import FlightTruth, FrameMaps
from flightdepth.evaluation.flight_truth_text import lines, scale_line, truth_table, unit_warning

INF, NAN = np.inf, np.nan
SHAPE = (30, 40)
ALL = DepthRange("all", 0, 150)


def maps(depth_m, confidence=0.8, sigma_m=None, farther_m=None, nearer_m=None) -> FrameMaps:
    def full(values) -> np.ndarray:
        return np.broadcast_to(np.asarray(values, np.float32), np.shape(depth_m))

    others = (None if each is None else full(each) for each in (sigma_m, farther_m, nearer_m))
    return FrameMaps(np.asarray(depth_m, np.float32), full(confidence), *others)


def flown(
    rng: np.random.Generator, factor: float = 1.0, scatter: float = 0.1
) -> tuple[FrameMaps, np.ndarray]:
    """A frame with everything in it, and its truth."""
    truth_m = rng.uniform(2, 200, SHAPE).astype(np.float32)
    truth_m[:3], truth_m[3, :5] = INF, NAN
    with np.errstate(invalid="ignore"):
        depth_m = (factor * truth_m * np.exp(scatter * rng.normal(size=SHAPE))).astype(np.float32)
    depth_m[:3, :10] = 300
    depth_m[:3, 10:] = depth_m[20:22, :30] = NAN
    confidence = rng.uniform(0, 1, SHAPE)
    sigma_m = np.where(np.isfinite(depth_m), 0.1 * depth_m, NAN)
    farther_m = np.where(np.isnan(depth_m), 100, NAN)
    nearer_m = np.full(SHAPE, NAN)
    nearer_m[20, :30], farther_m[20] = 60, NAN
    return maps(depth_m, confidence, sigma_m, farther_m, nearer_m), truth_m


@pytest.fixture(scope="module")
def frames() -> list[tuple[FrameMaps, np.ndarray]]:
    rng = np.random.default_rng(0)
    return [flown(rng) for _ in range(4)]


@pytest.fixture(scope="module")
def found(frames) -> FlightTruth:
    found = FlightTruth(RANGES)
    for index, (said, truth_m) in enumerate(frames):
        found.add(10 * index, said, truth_m)
    return found


@pytest.fixture(scope="module")
def pixels(frames) -> dict[str, np.ndarray]:
    """All pixels of all frames, each kind in one array."""
    names = ("depth_m", "confidence", "sigma_m", "farther_than_m", "nearer_than_m")
    every = {name: np.concatenate([getattr(said, name).ravel() for said, _ in frames]) for name in names}
    truth_m = np.concatenate([truth_m.ravel() for _, truth_m in frames])
    return {name: values.astype(np.float64) for name, values in (every | {"truth": truth_m}).items()}


@pytest.mark.parametrize("place", range(4))
def test_a_range_is_that_of_plain_numpy(found, pixels, place) -> None:
    part = (*RANGES, ALL)[place]
    inside = (pixels["truth"] >= part.from_m) & (pixels["truth"] < part.to_m)
    known = inside & np.isfinite(pixels["depth_m"])
    depth, truth, sigma = (pixels[name][known] for name in ("depth_m", "truth", "sigma_m"))
    got = found.figures()["ranges"][place]
    assert got["pixels"] == inside.sum()
    assert got["known"] == pytest.approx(known.sum() / inside.sum())
    assert got["l1_m"] == pytest.approx(np.abs(depth - truth).mean())
    assert got["rmse_m"] == pytest.approx(np.sqrt(((depth - truth) ** 2).mean()))
    assert got["abs_rel"] == pytest.approx((np.abs(depth - truth) / truth).mean())
    assert got["delta"] == pytest.approx((np.maximum(depth / truth, truth / depth) < 1.25).mean())
    assert got["inside_sigma"] == pytest.approx((np.abs(depth - truth) <= sigma).mean(), abs=1e-3)
    quartiles = [got["depth_over_truth"][name] for name in ("low", "median", "high")]
    np.testing.assert_allclose(quartiles, np.quantile(depth / truth, (0.25, 0.5, 0.75)), rtol=2e-3)


def test_sky_bounds_and_confidence_are_those_of_plain_numpy(found, pixels) -> None:
    got, truth, depth = found.figures(), pixels["truth"], pixels["depth_m"]
    told, sky, known = truth > 0, truth == INF, np.isfinite(depth)
    assert got["sky"]["pixels"] == sky.sum()
    assert got["sky"]["with_depth"] == pytest.approx(known[sky].mean())
    assert got["sky"]["with_farther_than"] == pytest.approx(np.isfinite(pixels["farther_than_m"][sky]).mean())
    farther = told & np.isfinite(pixels["farther_than_m"])
    nearer = told & np.isfinite(pixels["nearer_than_m"])
    assert got["farther_than_holds"]["share"] == pytest.approx((truth[farther] >= 100).mean(), abs=1e-3)
    assert got["nearer_than_holds"]["share"] == pytest.approx((truth[nearer] <= 60).mean(), abs=1e-2)
    assert 0.1 < got["farther_than_holds"]["share"] < 0.99
    for row in got["confidence"]:
        sure = known & told & (pixels["confidence"] >= row["at_least"])
        right = np.abs(depth[sure] / truth[sure] - 1) <= 0.25
        assert row["right_within_a_quarter"] == pytest.approx(right.mean(), abs=1e-3)
        assert row["of_depth"] == pytest.approx(sure.sum() / (known & told).sum(), abs=1e-3)
    assert got["beyond_the_ranges"]["share"] == pytest.approx(((truth >= 150) & ~sky)[told].mean())


def test_a_frame_is_that_of_plain_numpy(found, frames) -> None:
    said, truth_m = frames[1]
    inside = (truth_m < 150) & np.isfinite(said.depth_m)
    ratio = said.depth_m[inside].astype(np.float64) / truth_m[inside]
    got = found.frames[1]
    assert got.index == 10
    assert got.abs_rel == pytest.approx(np.abs(ratio - 1).mean(), rel=1e-5)
    assert got.ratio == pytest.approx(np.median(ratio), rel=1e-5)


def test_the_worst_frames_come_first_and_one_without_depth_is_none_of_them() -> None:
    found = FlightTruth(RANGES)
    for index, depth in ((1, 11.0), (2, NAN), (3, 14.0), (4, 10.5)):
        found.add(index, maps(np.full(SHAPE, depth)), np.full(SHAPE, 10, np.float32))
    assert [frame.index for frame in found.worst(2)] == [3, 1]
    assert [frame.index for frame in found.worst(9)] == [3, 1, 4]
    assert found.range_errors()[0].known == pytest.approx(0.75)


def counted(truth_m, depth_m, **said) -> FlightTruth:
    """One frame, of a row of pixels."""
    found = FlightTruth(RANGES)
    found.add(0, maps(np.array([depth_m]), **said), np.array([truth_m], np.float32))
    return found


def test_a_depth_of_0_is_none() -> None:
    assert counted([10, 10], [0, 10]).range_errors()[0].known == 0.5


def test_a_true_depth_of_0_is_none() -> None:
    found = counted([0, 10], [10, 10], confidence=0.75, farther_m=[[5, NAN]]).figures()
    assert found["beyond_the_ranges"]["pixels"] == 1
    assert found["farther_than_holds"]["pixels"] == 0
    assert found["ranges"][-1]["pixels"] == 1


def test_a_frame_without_depth_has_its_pixels_and_no_errors() -> None:
    found = counted([10, 20, NAN, INF], [NAN] * 4).figures()["frames"]
    assert found == [{"index": 0, "pixels": 2, "known": 0.0, "abs_rel": None, "ratio": None}]


def test_a_quarter_too_far_or_too_near_is_right() -> None:
    rows = counted([16, 16, 16, 16], [20, 12, 20.5, 11.5]).figures()["confidence"]
    assert [row["right_within_a_quarter"] for row in rows] == [None, 0.5, 0.5]


def test_confidence_is_not_judged_where_the_truth_is_unknown() -> None:
    rows = counted([10, NAN], [10, 10]).figures()["confidence"]
    assert [(row["of_depth"], row["right_within_a_quarter"]) for row in rows] == [(0, None), (1, 1), (1, 1)]


def test_confidence_counts_from_its_limit_on() -> None:
    rows = counted([10, 10], [10, 10], confidence=0.75).figures()["confidence"]
    assert [(row["at_least"], row["of_depth"]) for row in rows] == [(0.9, 0), (0.75, 1), (0.5, 1)]


def test_a_depth_without_a_deviation_says_nothing_of_it() -> None:
    assert counted([10, 10], [11, 11], sigma_m=[[2, NAN]]).figures()["ranges"][0]["inside_sigma"] == 1


def test_a_deviation_without_a_depth_is_not_asked_about() -> None:
    assert counted([10, 10], [11, NAN], sigma_m=2).figures()["ranges"][0]["inside_sigma"] == 1


def test_an_error_as_large_as_sigma_is_inside() -> None:
    assert counted([10, 10], [11, 12], sigma_m=[[1, 1]]).figures()["ranges"][0]["inside_sigma"] == 0.5


def test_a_bound_holds_to_the_centimetre_that_files_tell() -> None:
    farther = counted([99.995, 99.98], [NAN, NAN], farther_m=100).figures()["farther_than_holds"]
    nearer = counted([60.005, 60.02], [NAN, NAN], nearer_m=60).figures()["nearer_than_holds"]
    assert farther == nearer == {"pixels": 2, "share": 0.5}


def test_bounds_are_told_of_a_share_of_all_pixels_with_a_truth() -> None:
    found = counted(
        [90, 30, 40, NAN], [90, 30, NAN, NAN], farther_m=[[NAN, NAN, 20, 20]], nearer_m=[[99, 80, NAN, 9]]
    )
    assert found.told_farther.share == pytest.approx(1 / 3)
    assert found.told_nearer.share == pytest.approx(2 / 3)
    assert (found.farther.asked, found.nearer.asked) == (1, 2)


def test_what_is_in_no_range_since_it_is_too_far_is_beyond_them() -> None:
    assert counted([150, 149], [NAN, NAN]).figures()["beyond_the_ranges"] == {"pixels": 2, "share": 0.5}


def test_a_frame_that_is_too_near_may_be_the_worst() -> None:
    found = FlightTruth(RANGES)
    for index, depth in ((1, 11.0), (2, 5.0)):
        found.add(index, maps(np.full(SHAPE, depth)), np.full(SHAPE, 10, np.float32))
    assert [frame.index for frame in found.worst(2)] == [2, 1]


def test_all_ranges_together_begin_where_the_first_does() -> None:
    found = FlightTruth([DepthRange("", 10, 20), DepthRange("", 20, 40)])
    found.add(0, maps([[5, 15, 25]]), np.array([[5, 15, 25]], np.float32))
    assert [row["pixels"] for row in found.figures()["ranges"]] == [1, 1, 2]
    whole = found.figures()["ranges"][-1]
    assert (whole["name"], whole["from_m"], whole["to_m"]) == ("all", 10, 40)


def test_each_map_of_a_folder_is_taken_for_what_it_is() -> None:
    names = ("depth_m", "confidence", "sigma_m", "farther_than_m", "nearer_than_m")
    told = {name: np.full((4, 6), k, np.float32) for k, name in enumerate(names, 1)}
    folder = SimpleNamespace(**{name: lambda index, name=name: told[name] * index for name in names})
    found = FrameMaps.of(folder, 10, (2, 3))
    assert [getattr(found, name).tolist() for name in names] == [[[10.0 * k] * 3] * 2 for k in range(1, 6)]


def test_maps_that_a_folder_does_not_have_are_none() -> None:
    told = np.ones((4, 6), np.float32)
    folder = SimpleNamespace(depth_m=lambda index: told, confidence=lambda index: told)
    folder.sigma_m = folder.farther_than_m = folder.nearer_than_m = lambda index: None
    found = FrameMaps.of(folder, 0, (2, 3))
    assert (found.sigma_m, found.farther_than_m, found.nearer_than_m) == (None, None, None)


def test_ratios_of_any_size_have_their_quantiles() -> None:
    values = np.random.default_rng(1).lognormal(sigma=2, size=9999)
    ratios = Ratios()
    for part in np.array_split(values, 7):
        ratios.add(part)
    shares = (0.01, 0.3, 0.5, 0.99)
    expected = np.quantile(values, shares, method="inverted_cdf")
    np.testing.assert_allclose([ratios.quantile(share) for share in shares], expected, rtol=1e-3)
    assert ratios.abs_rel(2.0) == pytest.approx(np.abs(values / 2 - 1).mean(), rel=1e-3)
    ratios.add(np.array([1e-300, 1e300]))
    assert ratios.count == 10001


@pytest.mark.parametrize(("share", "ratio"), [(0, 2), (1, 3)])
def test_the_least_and_the_largest_ratio_are_the_ends(share: float, ratio: float) -> None:
    ratios = Ratios()
    ratios.add(np.array([2.0, 2.5, 3.0]))
    assert ratios.quantile(share) == pytest.approx(ratio, rel=6e-4)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 1.7])
def test_ratios_are_told_to_a_twentieth_of_a_per_cent(ratio: float) -> None:
    ratios = Ratios()
    ratios.add(np.full(9, ratio))
    assert ratios.quantile(0.5) == pytest.approx(ratio, rel=5e-4)


def test_the_mean_error_of_ratios_is_more_exact_than_a_single_one() -> None:
    values = np.random.default_rng(2).uniform(1.4, 1.6, 9999)
    ratios = Ratios()
    ratios.add(values)
    assert ratios.abs_rel() == pytest.approx(np.abs(values - 1).mean(), rel=1e-4)


def test_no_ratios_have_no_quantiles() -> None:
    assert np.isnan(Ratios().quantile(0.5))
    assert np.isnan(Ratios().abs_rel())


# What is said


def judged(*frames: tuple[FrameMaps, np.ndarray]) -> FlightTruth:
    found = FlightTruth(RANGES)
    for index, (said, truth_m) in enumerate(frames):
        found.add(index, said, truth_m)
    return found


@pytest.mark.parametrize(
    ("factor", "scatter", "said"),
    [
        (1.0, 0.1, "right, depth / truth is 1.00 at the median"),
        (1.12, 0.02, "depth is 12% too far in every range, as of a wrong speed or lens"),
        (0.8, 0.05, "depth is 20% too near in every range"),
        (1.1, 0.4, "but most errors are scatter"),
        (50, 0.05, "depth is 50 times the truth in every range"),
    ],
)
def test_a_scale_is_named_only_where_it_explains_the_errors(factor, scatter, said) -> None:
    line = scale_line(judged(*(flown(np.random.default_rng(i), factor, scatter) for i in range(20))))
    assert line is not None
    assert said in line


def test_ranges_so_narrow_that_none_holds_much_have_a_scale_too(frames) -> None:
    """It ended in a traceback where none held a hundredth of the pixels."""
    narrow = FlightTruth([DepthRange("", end - 0.5, end) for end in np.arange(2.5, 150, 0.5).tolist()])
    narrow.add(0, *frames[0])
    assert scale_line(narrow).startswith("no one factor explains the errors")
    assert len([*lines(narrow)]) > 3


def test_ranges_that_disagree_have_no_scale() -> None:
    truth_m = np.random.default_rng(0).uniform(2, 150, SHAPE).astype(np.float32)
    line = scale_line(judged((maps(np.where(truth_m < 50, truth_m, 0.8 * truth_m)), truth_m)))
    assert line is not None
    assert line.startswith("no one factor explains the errors")


@pytest.mark.parametrize(
    ("stored", "taken", "said"),
    [
        (256, 100, "--unit 256"),
        (5000, 100, "--unit 5000"),
        (1000, 1, "--unit 1000"),
        (100, 256, "--unit 100"),
    ],
)
def test_a_truth_in_another_unit_is_told_with_the_one_that_fits(stored, taken, said) -> None:
    depth_m = np.random.default_rng(0).uniform(2, 20, SHAPE)
    found = judged((maps(1.05 * depth_m), (depth_m * stored / taken).astype(np.float32)))
    warning = unit_warning(found, {float(taken)})
    assert warning is not None
    assert said in warning


def test_a_truth_in_the_right_unit_has_no_warning() -> None:
    assert unit_warning(judged(flown(np.random.default_rng(0), 1.5)), {100.0}) is None
    assert unit_warning(judged((maps(np.full(SHAPE, NAN)), np.ones(SHAPE, np.float32))), {100.0}) is None


def test_a_truth_that_fits_no_unit_asks_for_one() -> None:
    found = judged((maps(np.full(SHAPE, 37.0)), np.ones(SHAPE, np.float32)))
    assert "depth is 37 times the truth at the median: is it in another unit" in str(
        unit_warning(found, {1.0})
    )


def test_a_flight_without_depth_is_dashes(capsys) -> None:
    found = judged((maps(np.full(SHAPE, NAN), confidence=0), np.full(SHAPE, 20, np.float32)))
    Console(width=80).print(truth_table(found))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows[3] == ["middle,", "15-50", "m", "0", "%", *"-------"]
    assert rows[2] == ["near,", "0-15", "m", *"--------"]
    assert list(lines(found)) == []


def test_the_table_fits_a_terminal_of_80_columns(found, capsys) -> None:
    Console(width=80).print(truth_table(found))
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == 6
    assert "…" not in "".join(shown)
