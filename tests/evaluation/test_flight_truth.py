"""Errors of a flight beside its truth: against plain NumPy, and what is said of them."""

from __future__ import annotations

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
