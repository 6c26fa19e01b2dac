from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from output_samples import HEIGHT, WIDTH, csv_text, frame, known, unknown

from flightdepth.camera import Camera
from flightdepth.outputs.frame_table import COLUMNS, FrameRow, cells_of, rows_from_csv


def table(row):
    return csv_text(COLUMNS, cells_of(row))


def test_a_row_by_hand():
    row = FrameRow(3, 100_100_000, (2, 9), (0.25, 1.5), (12.0, 40.5), 0.75, 6.5, "", "by-hand")
    assert table(row).splitlines() == [
        "index,stamp_ns,shifts,displacements_m,centroids_m,valid_fraction,latency_ms,reason,network,focal_px,"
        "sigma_share,utc_ns,picture",
        "3,100100000,2 9,0.2500 1.5000,12.000 40.500,0.7500,6.50,,by-hand,,,,",
    ]


def test_what_only_some_frames_tell_by_hand():
    told = {
        "focal_px": 55.42562,
        "sigma_share": 0.04371,
        "utc_ns": 1_777_000_000_000_000_001,
        "picture": "a 1.jpg",
    }
    row = FrameRow(3, 100, (2,), (0.25,), (12.0,), 0.75, 6.5, "", **told)
    assert (
        table(row).splitlines()[1]
        == "3,100,2,0.2500,12.000,0.7500,6.50,,,55.426,0.0437,1777000000000000001,a 1.jpg"
    )
    assert rows_from_csv(table(row)) == [replace(row, focal_px=55.426, sigma_share=0.0437)]


@given(st.text(st.characters(exclude_categories=("Cs", "Cc"))), st.integers(0, 2**62))
def test_reasons_and_stamps_come_back(reason, stamp_ns):
    row = FrameRow(0, stamp_ns, (), (), (), 0.0, 1.0, reason)
    assert rows_from_csv(table(row)) == [row]


def test_a_depth_not_known_yet_comes_back_as_nan():
    row = FrameRow(0, 0, (3,), (0.5,), (float("nan"),), 0.5, 1.0, "")
    assert np.isnan(rows_from_csv(table(row))[0].centroids_m[0])


def test_the_row_of_a_frame_with_depth():
    depth_m = np.where(np.arange(WIDTH) < WIDTH / 4, np.nan, 10) * np.ones((HEIGHT, 1))
    row = FrameRow.of(frame(2), known(depth_m))
    assert (row.index, row.stamp_ns, row.shifts, row.displacements_m) == (2, 66_733_334, (3, 7), (0.25, 1.5))
    assert row.valid_fraction == 0.75
    assert row.reason == ""


def test_the_row_tells_what_its_frame_and_result_tell():
    zoomed = Camera(WIDTH, HEIGHT, 50.0, 60.0, WIDTH / 2, HEIGHT / 2)
    row = FrameRow.of(replace(frame(), picture="a.jpg", camera=zoomed), replace(known(10), network="by-hand"))
    assert (row.picture, row.focal_px, row.network, row.latency_ms) == ("a.jpg", 50, "by-hand", 5)
    assert row.centroids_m == pytest.approx((np.nan, 30), nan_ok=True)


def test_a_frame_of_nothing_but_bounds_says_so():
    row = FrameRow.of(frame(), known(np.full((HEIGHT, WIDTH), np.nan)))
    assert "no pixel has depth" in row.reason
    assert row.shifts == (3, 7)


def test_the_row_of_a_frame_without_depth_says_why():
    row = FrameRow.of(frame(), unknown("hovering"))
    assert (row.shifts, row.valid_fraction, row.reason) == ((), 0.0, "hovering")


@pytest.mark.parametrize("missing", [1, 2, 3, 4, 5])
def test_a_table_of_an_older_version_names_neither_error_bar_nor_network_and_focal_length(missing):
    row = FrameRow(3, 100, (2,), (0.25,), (12.0,), 0.75, 6.5, "")
    older = [line.rsplit(",", missing)[0] for line in table(row).splitlines()]
    assert rows_from_csv("\n".join(older)) == [row]


def test_the_focal_length_of_a_picture_that_was_zoomed_comes_back():
    zoomed = replace(frame(), camera=Camera.from_fov(WIDTH, HEIGHT, 60))
    row = FrameRow.of(zoomed, unknown("hovering"))
    assert rows_from_csv(table(row))[0].focal_px == pytest.approx(48 * 3**0.5, abs=0.001)


def test_the_error_bar_of_a_frame_is_the_median_of_what_is_known():
    depth_m = np.where(np.arange(WIDTH) < WIDTH / 4, np.nan, np.linspace(1, 90, WIDTH)) * np.ones((HEIGHT, 1))
    shares = np.where(np.arange(HEIGHT) < HEIGHT / 4, 0.3, 0.04)[:, None]
    result = replace(known(depth_m), sigma_m=(shares * depth_m).astype(np.float32))
    row = FrameRow.of(frame(), result)
    assert row.sigma_share == pytest.approx(0.04)
    assert rows_from_csv(table(row))[0].sigma_share == pytest.approx(0.04)


def test_depth_without_an_error_bar_does_not_spoil_that_of_the_rest():
    sigma_m = np.where(np.arange(WIDTH) < WIDTH / 4, np.nan, np.float32(0.5)) * np.ones((HEIGHT, 1))
    row = FrameRow.of(frame(), replace(known(10), sigma_m=sigma_m.astype(np.float32)))
    assert row.sigma_share == pytest.approx(0.05)


def test_what_has_no_error_bar_tells_none():
    nothing = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    for result in (known(10), unknown(), replace(known(nothing), sigma_m=nothing)):
        assert FrameRow.of(frame(), result).sigma_share is None


def test_one_column_for_each_field():
    assert tuple(FrameRow.__dataclass_fields__) == COLUMNS
