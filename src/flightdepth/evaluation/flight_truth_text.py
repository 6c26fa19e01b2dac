"""What `flightdepth evaluate flight` says: a row for each range of true depth, and a line for each further question."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from rich.table import Table

from flightdepth.evaluation.depth_ratios import Ratios
from flightdepth.evaluation.flight_truth import FlightTruth
from flightdepth.evaluation.metrics import DepthErrors
from flightdepth.evaluation.network_tables import number, percent

HEADINGS = (
    *("known", "rel.\nerror", "L1 m", "RMSE m", "within\n1.25"),
    *("depth /\ntruth", "its middle\nhalf", "inside\nsigma"),
)
WORST = 3
RIGHT_SCALE = 0.03  # medians of depth over truth that differ from 1 by less are of a right scale
LEAST_SHARE = 0.01  # of all pixels: ranges that hold less say nothing of the scale
EXPLAINS = 2 / 3  # a scale explains errors where so much of them, or less, is left without it
# Stored numbers a metre: of metres, centimetres, KITTI, millimetres, TUM.
UNITS = (1.0, 100.0, 256.0, 1000.0, 5000.0)
OTHER_UNIT = 2.0  # times that depth is the truth, or the truth depth, from where on the unit is in doubt
SAME_UNIT = 1.3
OF_PICTURES = ("frames ", "damaged frames", "damaged video packets")  # in the counts of flight.json


def truth_table(found: FlightTruth) -> Table:
    """Errors per range of true depth, and of all ranges together."""
    table = Table("\ntrue depth", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in HEADINGS:
        table.add_column(heading if "\n" in heading else f"\n{heading}", justify="right", no_wrap=True)
    for i, (depth_range, errors) in enumerate(zip(found.ranges, found.range_errors(), strict=True)):
        cells = row_cells(errors, found.ratios[i], found.inside_sigma[i].share)
        table.add_row(depth_range.label, *cells)
    return table


def row_cells(errors: DepthErrors, ratios: Ratios, inside_sigma: float) -> tuple[str, ...]:
    """The HEADINGS' figures as text."""
    half = "-".join(number(ratios.quantile(share), 2) for share in (0.25, 0.75)) if ratios.count else "-"
    return (
        percent(errors.known),
        fine_percent(errors.abs_rel),
        number(errors.l1_m, 2),
        number(errors.rmse_m, 2),
        percent(errors.delta),
        number(ratios.quantile(0.5), 2),
        half,
        percent(inside_sigma),
    )


def fine_percent(value: float) -> str:
    """A share as a percentage with one decimal; a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    return "< 0.1 %" if 0 < value < 0.0005 else f"{100 * value:.1f} %"


def lines(found: FlightTruth) -> Iterator[str]:
    """What the table leaves open, a line each."""
    if scale := scale_line(found):
        yield f"scale: {scale}"
    if found.sky_with_depth.asked:
        given, bound = percent(found.sky_with_depth.share), percent(found.sky_with_bound.share)
        share = percent(found.sky_with_depth.asked / found.beyond.asked)
        yield f"sky, {share} of the truth: {given} was given a depth, {bound} a farther_than"
    for name, tally, holds in (
        ("farther_than", found.told_farther, found.farther),
        ("nearer_than", found.told_nearer, found.nearer),
    ):
        if holds.asked:
            yield f"{name}, told of {fine_percent(tally.share)} of the truth: {fine_percent(holds.share)} holds"
    sure = [
        f"{percent(right.share)} from {least:g} on ({percent(found.sure[least].share)} of the depth)"
        for least, right in found.right.items()
        if right.asked
    ]
    if sure:
        yield f"confidence, right within a quarter: {', '.join(sure)}"
    if found.beyond.held:
        share, end_m = fine_percent(found.beyond.share), found.ranges[-1].to_m
        yield f"in no range: {share} of the truth, from {end_m:g} m on (--bins; --far M where that is sky)"
    if worst := found.worst(WORST):
        told = ", ".join(f"{frame.index} ({fine_percent(frame.abs_rel)})" for frame in worst)
        yield f"worst frames by relative error: {told}"


def scale_line(found: FlightTruth) -> str | None:
    """Whether a wrong scale explains the errors; None without any depth in the ranges."""
    whole = found.ratios[-1]
    if not whole.count:
        return None
    some = [ratios for ratios in found.ratios[:-1] if ratios.count]
    told = [ratios for ratios in some if ratios.count >= LEAST_SHARE * whole.count] or some
    medians = [ratios.quantile(0.5) for ratios in told]
    median, least, most = whole.quantile(0.5), min(medians), max(medians)
    span = f"{least:.2f} to {most:.2f} in the ranges"
    if abs(median - 1) <= RIGHT_SCALE and most - least <= 2 * RIGHT_SCALE:
        return f"right, depth / truth is {median:.2f} at the median ({span}); the errors are scatter"
    if most - least > abs(median - 1) or (least - 1) * (most - 1) < 0:
        return f"no one factor explains the errors, depth / truth is {median:.2f} at the median ({span})"
    now, then = whole.abs_rel(), whole.abs_rel(median)
    left = (
        f"divided by {median:.3g} the relative error would be {fine_percent(then)}, not {fine_percent(now)}"
    )
    off = f"depth is {abs(median - 1):.0%} too {'far' if median > 1 else 'near'}"
    if not 1 / OTHER_UNIT < median < OTHER_UNIT:
        off = f"depth is {median:.3g} times the truth"
    if then <= EXPLAINS * now:
        return f"{off} in every range, as of a wrong speed or lens, or unit of the truth: {left}"
    return f"{off} at the median ({span}), but most errors are scatter: {left}"


def unit_warning(found: FlightTruth, per_m: set[float]) -> str | None:
    """That the truth seems to be stored in another unit than `per_m`, the numbers a metre taken; None where it fits."""
    median = found.anywhere.quantile(0.5)
    if not median > 0 or 1 / OTHER_UNIT < median < OTHER_UNIT:
        return None
    said = f"depth is {median:.3g} times the truth at the median"
    if len(per_m) == 1:
        (taken,) = per_m
        fitting = [unit for unit in UNITS if 1 / SAME_UNIT < median * unit / taken < SAME_UNIT]
        if fitting:
            return f"{said}: is the truth stored {fitting[0]:g} to the metre, not {taken:g}? (--unit {fitting[0]:g})"
    return f"{said}: is it in another unit (--unit), or of other frames (--first)?"


def start_warning(stamps_ns: Sequence[int]) -> str | None:
    """That frame 0 is not its video's first picture, where the stamps of a flight's frames say so."""
    if len(stamps_ns) < 2 or not stamps_ns[0]:
        return None
    first = round(stamps_ns[0] / float(np.median(np.diff(stamps_ns))))
    return (
        f"the flight begins {stamps_ns[0] / 1e9:.2f} s into its video: where the truth counts the video's pictures, "
        f"frame 0 is number {first} of them (--first {first})"
    )


def numbers_warning(dropped: Mapping[str, int]) -> str | None:
    """That frames may count otherwise than the truth, where pictures of the video are among what was `dropped`."""
    lost = sum(count for what, count in dropped.items() if what.startswith(OF_PICTURES))
    if not lost:
        return None
    return f"{lost:,} pictures of the video were left out: frames after them may have other numbers than the truth"
