import math
import pickle

import pytest
from output_samples import SOURCE

from flightdepth.outputs.frame_table import FrameRow
from flightdepth.outputs.record import Counts, DepthScaleNote, FlightRecord, ReasonTally, Summary


def row(index, reason="", latency_ms=5.0, valid_fraction=0.5, sigma_share=None):
    return FrameRow(index, index, (), (), (), valid_fraction, latency_ms, reason, sigma_share=sigma_share)


ROWS = [
    row(0, "first frame"),
    row(1, "turns 3.1 degrees in 0.10 s"),
    row(2, "turns 12 degrees in 0.10 s"),
    row(3, valid_fraction=0.2, latency_ms=4),
    row(4, valid_fraction=0.4, latency_ms=6, sigma_share=0.04),
    row(5, valid_fraction=0.9, latency_ms=50, sigma_share=0.08),
]


def test_reasons_that_differ_in_numbers_only_are_counted_together():
    counts = Counts.of(ROWS, {}, 0)
    assert counts.frames_without_depth == {"turns 3.1 to 12 degrees in 0.10 s": 2, "first frame": 1}


def test_other_words_are_another_reason():
    reasons = ["hovering: flown 0.01 m", "hovering: flown 0.29 m", "gap of 2 s", "gap of 2 s", "hovering"]
    counts = ReasonTally(reasons).counts()
    assert counts == {"hovering: flown 0.01 to 0.29 m": 2, "gap of 2 s": 2, "hovering": 1}


def test_a_tally_does_not_grow_with_the_frames():
    """A note of each frame of an hour of flight was kept until its end."""
    notes = [f"off by {i % 7} degrees" for i in range(250)]
    assert len(pickle.dumps(ReasonTally(notes[:200]))) == len(pickle.dumps(ReasonTally(notes)))


def test_each_frame_is_counted_once():
    counts = Counts.of(ROWS, {}, 0)
    assert counts.frames == counts.frames_with_depth + sum(counts.frames_without_depth.values()) == 6


def test_medians_are_over_frames_with_depth():
    summary = Summary.of(ROWS, Counts.of(ROWS, {}, 0), ())
    assert (summary.valid_fraction_median, summary.latency_median_ms) == (0.4, 6)
    assert summary.latency_p95_ms == pytest.approx(45.6)
    assert summary.sigma_share_median == pytest.approx(0.06)  # of those that tell it


def test_without_any_depth_the_medians_are_nan():
    summary = Summary.of(ROWS[:2], Counts.of(ROWS[:2], {}, 0), ())
    assert math.isnan(summary.latency_median_ms) and math.isnan(summary.sigma_share_median)


def test_the_record_comes_back_from_its_json():
    record = FlightRecord(
        flightdepth="1.2.3",
        source=SOURCE,
        depth=DepthScaleNote(format="png"),
        counts=Counts.of(ROWS, {"damaged frames": 2}, 17),
        notes=("a note",),
    )
    assert FlightRecord.model_validate_json(record.model_dump_json()) == record
