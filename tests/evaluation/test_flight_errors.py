from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console

from flightdepth.evaluation.flight_errors import DepthRange, FlightErrors, cells_of
from flightdepth.evaluation.metrics import DepthErrors

RANGES = (DepthRange("near", 0, 10), DepthRange("far", 10, 100))
TRUTH = np.array([[5, 20], [40, np.nan]], np.float32)


def test_numbers_by_hand() -> None:
    errors = FlightErrors(RANGES)
    errors.add("ours", np.array([[6, 25], [np.nan, 3]], np.float32), TRUTH)
    near, far = errors.result()["ours"]
    assert (near.pixels, near.known) == (1, 1)
    assert (near.l1_m, near.delta) == (1, 1)
    assert near.abs_rel == pytest.approx(0.2)
    assert (far.pixels, far.known) == (2, 0.5)
    assert (far.l1_m, far.abs_rel, far.delta) == (5, 0.25, 0)


def test_frames_add_up_like_one_large_frame() -> None:
    rng = np.random.default_rng(0)
    truth, depth = rng.uniform(1, 100, (2, 6, 8)).astype(np.float32)
    parts, whole = FlightErrors(RANGES), FlightErrors(RANGES)
    whole.add("ours", depth, truth)
    for rows in (slice(0, 2), slice(2, 6)):
        parts.add("ours", depth[rows], truth[rows])
    for part, one in zip(parts.result()["ours"], whole.result()["ours"], strict=True):
        assert part.abs_rel == pytest.approx(one.abs_rel)
        assert part.pixels == one.pixels


def test_the_truth_has_no_error() -> None:
    errors = FlightErrors(RANGES)
    errors.add("truth", TRUTH, TRUTH)
    assert all((row.l1_m, row.delta) == (0, 1) for row in errors.result()["truth"])


def test_a_range_that_never_occurs_is_nan() -> None:
    errors = FlightErrors(RANGES)
    errors.add("ours", TRUTH[:1, :1], TRUTH[:1, :1])
    far = errors.result()["ours"][1]
    assert far.pixels == 0
    assert np.isnan([far.known, far.l1_m, far.abs_rel]).all()


def test_an_edge_belongs_to_the_range_above() -> None:
    truth = np.full((2, 2), 10, np.float32)
    near, far = FlightErrors(RANGES).add("ours", truth, truth)
    assert (near.pixels, far.pixels) == (0, 4)


@pytest.mark.parametrize("nothing", [0.0, -1.0, np.nan])
def test_a_truth_that_is_none_is_in_no_range(nothing: float) -> None:
    truth = np.full((2, 2), nothing, np.float32)
    assert [row.pixels for row in FlightErrors(RANGES).add("ours", TRUTH, truth)] == [0, 0]


def test_a_row_tells_the_relative_error_the_mean_error_and_what_is_known() -> None:
    errors = DepthErrors(pixels=9, known=0.5, l1_m=3.0, rmse_m=4.0, abs_rel=0.1, delta=0.9)
    assert cells_of(errors) == ("10 %", "3.0", "50 %")


def test_estimators_stand_side_by_side() -> None:
    errors = FlightErrors(RANGES)
    errors.add("ours", TRUTH, TRUTH)
    errors.add("classical", TRUTH * 2, TRUTH)
    console = Console(width=120)
    with console.capture() as captured:
        console.print(errors.table())
    lines = captured.get().splitlines()
    assert "ours" in lines[0]
    assert "classical" in lines[0]
    assert lines[-2].split() == [
        "near,",
        "0-10",
        "m",
        "0",
        "%",
        "0.0",
        "100",
        "%",
        "100",
        "%",
        "5.0",
        "100",
        "%",
    ]


def test_maps_of_two_sizes_are_our_bug() -> None:
    with pytest.raises(ValueError, match="expected depth"):
        FlightErrors(RANGES).add("ours", TRUTH, TRUTH[:1])
