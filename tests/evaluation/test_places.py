"""Where errors sit: places and shares worked out by hand."""

import numpy as np
import pytest

from flightdepth.evaluation.places import (
    APART,
    BESIDE,
    BLANK,
    EDGE,
    PLACES,
    TEXTURED,
    errors_by_place,
    places_of,
)


def test_places_by_hand():
    """An edge in the middle block of a picture whose right third is blank."""
    apart = np.ones((7, 12), np.float32)
    apart[3, 2] = APART + 0.01
    apart[0, 0] = APART - 0.01
    picture = np.random.default_rng(0).integers(0, 256, (28, 48, 3), dtype=np.uint8)
    picture[:, 32:] = 90
    expected = np.full((7, 12), TEXTURED)
    expected[:, 9:] = BLANK  # the column before it has texture beside it
    expected[2:5, 1:4] = BESIDE
    expected[3, 2] = EDGE
    assert places_of(apart, picture).tolist() == expected.tolist()


def test_a_ramp_of_grey_is_no_texture_where_it_is_slow():
    grey = np.broadcast_to(np.linspace(0, 255, 480).astype(np.uint8), (48, 480))
    picture = np.repeat(grey[..., None], 3, axis=2)
    slow, fast = (
        places_of(np.ones((12, 120)), picture),
        places_of(np.ones((12, 120)), picture + 9 * grey[..., None]),
    )
    assert (slow == BLANK).all()  # 6 grey levels over 12 px deviate by less than 2
    assert (fast == TEXTURED).mean() > 0.9


def test_errors_by_hand():
    places = [np.array([[EDGE, TEXTURED], [BLANK, BLANK]]), np.array([[TEXTURED, TEXTURED]])]
    truths = [np.array([[10.0, 20.0], [40.0, np.nan]]), np.array([[50.0, 50.0]])]
    found = [np.array([[14.0, 20.0], [50.0, 1.0]]), np.array([[55.0, 49.0]])]
    silent = [np.full((2, 2), np.nan), np.array([[np.nan, 50.0]])]
    rows = {row["place"]: row for row in errors_by_place(places, truths, {"network": found, "peer": silent})}
    assert list(rows) == list(PLACES)
    edge, beside, textured, blank = rows.values()
    assert edge["network"] == {"l1_m": 4.0, "abs_rel": 0.4, "of_error": pytest.approx(4 / 20)}
    assert textured["network"]["l1_m"] == pytest.approx((0 + 5 + 1) / 3)
    assert blank["network"] == {"l1_m": 10.0, "abs_rel": 0.25, "of_error": pytest.approx(10 / 20)}
    assert np.isnan(beside["network"]["l1_m"]) and beside["share"] == 0
    assert textured["peer"]["l1_m"] == 0 and np.isnan(edge["peer"]["l1_m"])
    assert sum(row["network"]["of_error"] for row in rows.values()) == pytest.approx(1)
