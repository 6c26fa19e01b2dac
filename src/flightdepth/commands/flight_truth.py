"""`flightdepth evaluate flight`: how exact a flight's depth is, where its truth is known."""

from __future__ import annotations

from itertools import chain, islice, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.convert import check_outside, opened
from flightdepth.commands.extras import extra_packages
from flightdepth.commands.figures import JsonOption, check_figures, write_figures
from flightdepth.commands.terminal import counted, say, show_table, warn
from flightdepth.errors import BadInput
from flightdepth.files import make_folder, write_atomic

if TYPE_CHECKING:
    from flightdepth.evaluation.flight_errors import DepthRange
    from flightdepth.evaluation.flight_truth import FlightTruth
    from flightdepth.evaluation.true_depth import Matched, TrueDepth
    from flightdepth.outputs import FlightFolder

SHEETS, WORST_SHEETS = 16, 3


def flight_truth(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="What `flightdepth run` wrote.")],
    *,
    truth: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="True depth: .png, .npy, .npz, .tif, .pfm or .exr, with the frame's number in the name.",
        ),
    ],
    unit: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Stored numbers that make a metre: KITTI 256, TUM 5000. Default: of whole numbers 100, of floats 1.",
        ),
    ] = None,
    ray: Annotated[
        bool,
        typer.Option("--ray", help="The truth is the length of the ray, not depth along the camera's axis."),
    ] = False,
    first: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Number in the names of the truth that frame 0 has. Default: 0, or that of its picture in a folder.",
        ),
    ] = None,
    bins: Annotated[
        str | None,
        typer.Option(
            metavar="M,M,...", help="Ends of the ranges of true depth, in metres. Default: 15,50,150."
        ),
    ] = None,
    far: Annotated[
        float | None,
        typer.Option(
            metavar="M", help="Truth from here on is sky. Default: what is infinite, or 65535 of 16 bits."
        ),
    ] = None,
    json: JsonOption = None,
    pictures: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help=f"Write up to {SHEETS} frames beside their truth there, the {WORST_SHEETS} worst among them.",
        ),
    ] = None,
) -> None:
    """Errors of a flight's depth where its truth is known: of a simulator, a laser scanner or a data set.

    Per range of depth, and whether a wrong scale (speed, lens) would explain
    them; whether error bar, bounds and confidence hold; which frames are worst.

      flightdepth evaluate flight out --truth depths

      flightdepth evaluate flight out --truth kitti/proj_depth --unit 256

      flightdepth evaluate flight out --truth lengths --ray --pictures errors
    """
    from flightdepth.evaluation.true_depth import TrueDepth, matched

    check_figures(json)
    for place in (json, pictures):
        if place is not None:
            check_outside(folder, place)
    if pictures is not None and pictures.resolve() == truth.resolve():
        raise BadInput("--pictures", expected="another folder than that of --truth", got=str(pictures))
    for option, value in (("--unit", unit), ("--far", far)):
        if value is not None and not 0 < value < float("inf"):
            raise BadInput(option, expected="a number above 0", got=f"{value:g}")
    ranges = ranges_of(bins)
    flight = opened(folder)
    beside = matched(truth, {row.index: row.picture for row in flight.rows}, first)
    true = TrueDepth(beside.files, unit, ray, far or float("inf"))
    if any(path.suffix.lower() == ".exr" for path in beside.files.values()):
        with extra_packages("Reading OpenEXR", "exr"):
            import OpenEXR  # noqa: F401
    if pictures is not None:
        make_folder("--pictures", pictures)
    found = measured(flight, true, ranges)
    show(flight, true, found, beside)
    write_figures(json, figures(flight, true, found, beside.first))
    if pictures is not None:
        say(f"pictures: {write_sheets(flight, true, found, pictures)} in {pictures}")


def ranges_of(bins: str | None) -> tuple[DepthRange, ...]:
    """The ranges of true depth that end at "15,50,150"."""
    from flightdepth.evaluation.flight_errors import RANGES, DepthRange

    if bins is None:
        return RANGES
    try:
        ends = [float(part) for part in bins.split(",")]
    except ValueError:
        ends = []
    starts = [0.0, *ends[:-1]]
    if not ends or not all(start < end < float("inf") for start, end in zip(starts, ends, strict=True)):
        raise BadInput("--bins", expected="rising metres above 0, as in 15,50,150", got=bins)
    return tuple(DepthRange("", start, end) for start, end in zip(starts, ends, strict=True))


def measured(flight: FlightFolder, true: TrueDepth, ranges: tuple[DepthRange, ...]) -> FlightTruth:
    """All errors, with a progress bar."""
    from flightdepth.evaluation.flight_truth import FlightTruth, FrameMaps

    found = FlightTruth(ranges)
    for index in counted(list(true.files), "comparing", "frames"):
        truth_m = true.at(index, flight.camera(index))
        found.add(index, FrameMaps.of(flight, index, truth_m.shape), truth_m)
    return found


def show(flight: FlightFolder, true: TrueDepth, found: FlightTruth, beside: Matched) -> None:
    """Print the table, the lines below it, and what may be wrong with the comparison itself."""
    from flightdepth.evaluation.flight_truth_text import (
        lines,
        numbers_warning,
        start_warning,
        truth_table,
        unit_warning,
    )
    from flightdepth.outputs.record import ReasonTally

    show_table(truth_table(found))
    without = [row.reason for row in flight.rows if row.index in true.files and row.reason]
    why = f"{len(without):,} of them without depth: {'; '.join(ReasonTally(without).with_frames())}"
    lacking = why if without else "all of them with depth"
    say(f"{len(true.files):,} of {len(flight.rows):,} frames have a truth, {lacking}")
    for line in lines(found):
        say(line)
    if beside.of_no_frame:
        be = "is" if beside.of_no_frame == 1 else "are"
        say(f"{beside.of_no_frame:,} of the truth's files {be} of no frame: {beside.spans}")
    of_video = beside.first == 0 and not any(row.picture for row in flight.rows)
    for hint in (
        unit_warning(found, true.used),
        numbers_warning(flight.record.counts.dropped),
        start_warning([row.stamp_ns for row in flight.rows]) if of_video else None,
    ):
        if hint is not None:
            warn(hint)


def figures(flight: FlightFolder, true: TrueDepth, found: FlightTruth, first: int | None) -> dict[str, Any]:
    """Everything that was measured, and on what."""
    record = flight.record
    return {
        "flight": record.source.flight,
        "flightdepth": record.flightdepth,
        "network": record.source.network.name,
        "weights_sha256": record.source.network.sha256,
        "truth": {
            "frames": len(true.files),
            "numbers_a_metre": sorted(true.used),
            "length_of_rays": true.is_ray,
            "first": first,
            "sky_from_m": None if true.far_m == float("inf") else true.far_m,
        },
        **found.figures(),
    }


def write_sheets(flight: FlightFolder, true: TrueDepth, found: FlightTruth, folder: Path) -> int:
    """Write the worst frames and others, evenly spread, as errors-000120.png; how many."""
    from flightdepth.evaluation.flight_truth_sheets import Sheets, chosen
    from flightdepth.outputs.encoding import rgb_png
    from flightdepth.outputs.pictures import pictures
    from flightdepth.outputs.writer import PREVIEW

    wanted, sheets = chosen(found, SHEETS, WORST_SHEETS), Sheets(flight)
    last = sum(row.index <= max(wanted) for row in flight.rows)
    shown = islice(pictures(flight) if (flight.folder / PREVIEW).exists() else (), last)
    left = dict(wanted)
    # The preview of an interrupted flight may end before its last frames.
    for index, image in chain(counted(shown, "pictures", "frames", total=last), zip(wanted, repeat(None))):
        if (errors := left.pop(index, None)) is not None:
            truth_m = true.at(index, flight.camera(index))
            write_atomic(folder / f"errors-{index:06d}.png", rgb_png(sheets.draw(image, truth_m, errors)))
    return len(wanted)
