"""`flightdepth evaluate baselines`: what a flight without ground truth says of depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.terminal import progress_bar, say, show_table
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, write_atomic, write_json

if TYPE_CHECKING:
    from rich.table import Table

    from flightdepth.camera import Camera
    from flightdepth.evaluation.baseline_pairs import BaselinePairs
    from flightdepth.evaluation.baseline_sheets import SheetSights
    from flightdepth.evaluation.baselines import BaselineStudy
    from flightdepth.flight import Flight
    from flightdepth.runtimes.grid import NetworkGrid
    from flightdepth.runtimes.network import Network

SHEET_FRAMES = 3


def baselines(
    flight: Annotated[Path, typer.Argument(metavar="FLIGHT", help="Stabilised video.")],
    *,
    telemetry: Annotated[Path | None, typer.Option(metavar="LOG", help="Flight log.")] = None,
    camera: Annotated[Path | None, typer.Option(metavar="FILE|NAME", help="As of `run`.")] = None,
    hfov: Annotated[float | None, typer.Option(metavar="DEG", help="Instead of --camera.")] = None,
    network: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Several stand side by side. Default: as `run`."),
    ] = None,
    baselines: Annotated[
        str, typer.Option(metavar="M,M,...", help="Metres flown between the two pictures of a pair.")
    ] = "0.5,1,2",
    every: Annotated[int, typer.Option(metavar="N", min=1, help="Ask for the depth of each N-th frame.")] = 3,
    start: Annotated[float | None, typer.Option(metavar="S")] = None,
    end: Annotated[float | None, typer.Option(metavar="S")] = None,
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="Write every figure there.")] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a PNG of some frames there.")
    ] = None,
) -> None:
    """Depth over several baselines on a flight without ground truth, beside the classical peer.

    Photometric: the difference that is left after the earlier picture is warped
    by depth and displacement, as a share of the difference without a warp (the
    plane at infinity, 1 by definition); the lower the better, occlusion is not
    modelled. Agreement: how far apart the depths of one frame over two baselines
    are. Slope: of the depth of tracked points against metres flown; of those that
    moved between the pictures by a pixel or more, too: the others tell little.

      flightdepth evaluate baselines flight.mp4 --hfov 73 --network motion
    """
    from flightdepth.flight import open_flight
    from flightdepth.runtimes.network import load_network, nearest_network

    lengths_m = lengths(baselines)
    check_parent("--json", json)
    check_parent("--picture", picture)
    with open_flight(flight, telemetry, camera, hfov_deg=hfov, start_s=start, end_s=end) as opened:
        opened_networks = [load_network(n) for n in network or [nearest_network(opened.camera)]]
        result, sights, valid = studied(opened, opened_networks, lengths_m, every)
    result = {"flight": flight.name, **result}
    show(result)
    keep(result, json)
    if picture is not None:
        draw(sights, valid, picture)


def lengths(text: str) -> tuple[float, ...]:
    """Metres, rising, from "0.5,1,2"."""
    try:
        found = sorted({float(part) for part in text.split(",")})
    except ValueError:
        found = []
    if not found or not all(0 < length < float("inf") for length in found):
        raise BadInput("--baselines", expected="metres above 0, as in 0.5,1,2", got=text)
    return tuple(found)


def studied(
    flight: Flight, networks: Sequence[Network], lengths_m: tuple[float, ...], every: int
) -> tuple[dict[str, Any], SheetSights, Any]:
    """All figures with what they were measured on, the sights for a picture, and what of the grid is valid."""
    from flightdepth.evaluation.baseline_methods import Method, NetworkMethod, PeerMethod
    from flightdepth.evaluation.baseline_pairs import BaselinePairs
    from flightdepth.evaluation.baseline_sheets import SheetSights
    from flightdepth.evaluation.baselines import BaselineStudy
    from flightdepth.evaluation.provenance import source_commit

    networks, grid = side_by_side(networks, flight.camera)
    pairs = BaselinePairs(flight, grid, lengths_m, every=every)
    methods: list[Method] = [*map(NetworkMethod, networks), PeerMethod(tuple(n.card for n in networks))]
    study = BaselineStudy(methods, grid.camera, grid.valid, pairs.known, lengths_m)
    sights = SheetSights(SHEET_FRAMES)
    frames = follow(flight, pairs, study, sights)
    about = {
        "telemetry": flight.telemetry_name,
        "networks": [
            {"name": n.card.name, "weights_sha256": n.card.sha256, "runtime": n.runtime.description}
            for n in networks
        ],
        "commit": source_commit(),
        "grid": {"width": grid.camera.width, "height": grid.camera.height, "focal_px": grid.camera.fx},
        "frames": frames,
        "every": every,
        "left_out": dict(pairs.left_out),
    }
    return about | study.result(), sights, grid.valid


def side_by_side(networks: Sequence[Network], camera: Camera) -> tuple[list[Network], NetworkGrid]:
    """The networks, and the one grid on which all of them look through `camera`.

    It is that of the first network that knows one focal length only; those for any lens of about that
    length follow. What still could not stand side by side is refused.
    """
    from flightdepth.evaluation.pairs import refuse_namesakes

    refuse_namesakes("--network", networks)
    leader = next((network for network in networks if not network.card.any_lens), networks[0])
    grid = leader.grid(camera)
    bends = [n.card.any_lens and n.card.focal_px == leader.card.focal_px for n in networks]
    together = [n.at_focal(grid.camera.fx) if bent else n for n, bent in zip(networks, bends, strict=True)]
    if any(n.grid(grid.camera).camera != grid.camera for n in together):
        got = ", ".join(f"{n.card.name} at {n.grid(camera).camera.fx:.0f} px" for n in networks)
        mend = "Measure them one after the other."
        raise BadInput("--network", expected="networks of one focal length", got=got, mend=mend)
    return together, grid


def follow(flight: Flight, pairs: BaselinePairs, study: BaselineStudy, sights: SheetSights) -> int:
    """Give every frame to the study, with a progress bar; how many there were."""
    frames = 0
    with progress_bar("baselines", flight.frame_count_hint, "frames") as bar:
        for moment in pairs:
            seen = study.add(moment)
            if len(seen) == len(study.baselines_m):
                sights.add(seen)
            frames += 1
            bar.advance(bar.task_ids[0])
    return frames


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    from flightdepth.evaluation.baselines import MOVED_PX

    for title, cells in (
        (
            "difference after the warp, as a share of that without (1: plane at infinity), pixels measured",
            photometric(result),
        ),
        ("median |log depth ratio| between baselines, pixels that both measure", agreements(result)),
        ("the same, only where the classical peer measures twice", agreements_with_peer(result)),
        ("slope of depth per metre flown, number of tracked points", slopes(result["slope"])),
        (
            f"the same, of points that moved by {MOVED_PX:g} px or more between the pictures",
            slopes(result["slope_of_moved"]),
        ),
    ):
        say(title)
        show_table(table(cells))
    say("+- half of the 95 % bootstrap interval, over frames (the slope's over points)")
    counted = ", ".join(f"{count} over {length} m" for length, count in result["frames_per_baseline"].items())
    say(f"{result['frames']} frames, of each {result['every']}. the depth; pairs: {counted}")
    for witness, count in result["directions_told_by"].items():
        say(f"  direction of {count} pairs told by {witness}")
    for cause, count in result["left_out"].items():
        say(f"  {count} left out: {cause}")


def photometric(result: dict[str, Any]) -> dict[tuple[str, str], str]:
    """Cells by method and baseline."""
    cells = {}
    for row in result["photometric"]:
        measured = "" if math.isnan(row["pixels_measured"]) else f"{row['pixels_measured']:.0%}"
        figure = spread(row["error_share"], row["error_share"]["mean"])
        cells[row["method"], f"{row['baseline_m']:g} m"] = f"{figure}  {measured:>4}"
    return cells


def agreements(result: dict[str, Any]) -> dict[tuple[str, str], str]:
    """Cells by method and pair of baselines."""
    return {
        (row["method"], " / ".join(f"{length:g}" for length in row["baselines_m"]) + " m"): (
            f"{spread(row['median_log_ratio'], row['median_log_ratio']['mean'])}"
            f"  {row['measured_by_both']['mean']:4.0%}"
        )
        for row in result["agreement"]
    }


def agreements_with_peer(result: dict[str, Any]) -> dict[tuple[str, str], str]:
    """As `agreements`, on the peer's pixels."""
    key = "median_log_ratio_where_peer_measures"
    return {
        (row["method"], " / ".join(f"{length:g}" for length in row["baselines_m"]) + " m"): spread(
            row[key], row[key]["mean"]
        )
        for row in result["agreement"]
    }


def slopes(rows: list[dict[str, Any]]) -> dict[tuple[str, str], str]:
    """Cells by method and baseline, the ideal first."""
    cells = {("ideal", f"{row['baseline_m']:g} m"): f"{row['ideal']:.2f}" for row in rows}
    for row in rows:
        cells[row["method"], f"{row['baseline_m']:g} m"] = f"{spread(row, row['median'])}  {row['points']:4d}"
    return cells


def table(cells: dict[tuple[str, str], str]) -> Table:
    """Cells by row and column, in the order they were given."""
    from rich.table import Table

    grid = Table(box=None)
    columns = list(dict.fromkeys(column for _, column in cells))
    grid.add_column("")
    for column in columns:
        grid.add_column(column, justify="right")
    for name in dict.fromkeys(name for name, _ in cells):
        grid.add_row(name, *(cells.get((name, column), "-") for column in columns))
    return grid


def spread(ends: dict[str, Any], middle: float) -> str:
    """A figure and half of the interval from low to high; a dash where there is none."""
    return "-" if math.isnan(middle) else f"{middle:.2f} +-{(ends['high'] - ends['low']) / 2:.2f}"


def keep(result: dict[str, Any], target: Path | None) -> None:
    """Write the figures, if asked for."""
    from flightdepth.evaluation.network import without_nan

    if target is not None:
        write_json(target, without_nan(result))
        say(f"figures: {target}")


def draw(sights: SheetSights, valid: Any, target: Path) -> None:
    """Write the picture, if any pair was seen."""
    import cv2

    from flightdepth.evaluation.baseline_sheets import sheet

    if not sights.chosen:
        say("no picture: no frame has a pair of every baseline")
        return
    rgb = sheet(sights.chosen, valid)
    write_atomic(target, cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes())
    say(f"picture: {target}")
