"""`flightdepth evaluate baselines`: what a flight without ground truth says of depth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.figures import JsonOption, check_figures, write_figures
from flightdepth.commands.flight_options import (
    CameraOption,
    EndOption,
    HfovOption,
    MountPitchOption,
    OffsetOption,
    RateOption,
    StartOption,
    TelemetryOption,
    offset_of,
)
from flightdepth.commands.terminal import counted, say, show_table
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, refuse_to_replace, without_nan, write_atomic

if TYPE_CHECKING:
    from flightdepth.camera import Camera
    from flightdepth.evaluation.baseline_pairs import BaselinePairs
    from flightdepth.evaluation.baseline_sheets import SheetSights
    from flightdepth.evaluation.baselines import BaselineStudy
    from flightdepth.flight import Flight
    from flightdepth.runtimes.grid import NetworkGrid
    from flightdepth.runtimes.network import Network

SHEET_FRAMES = 3


def baselines(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="Stabilised video, or a folder of pictures.")
    ],
    *,
    telemetry: TelemetryOption = None,
    telemetry_offset: OffsetOption = "0",
    camera: CameraOption = None,
    hfov: HfovOption = None,
    mount_pitch: MountPitchOption = None,
    start: StartOption = None,
    end: EndOption = None,
    rate: RateOption = None,
    network: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="As of `flightdepth run`; given several times, they stand side by side. Default: motion.",
        ),
    ] = None,
    baselines: Annotated[
        str, typer.Option(metavar="M,M,...", help="Metres flown between the two pictures of a pair.")
    ] = "0.5,1,2",
    every: Annotated[int, typer.Option(metavar="N", min=1, help="Ask for the depth of each N-th frame.")] = 3,
    json: JsonOption = None,
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
    check_figures(json)
    check_parent("--picture", picture)
    if picture is not None and picture.suffix != ".png":
        raise BadInput("--picture", expected="a .png file", got=str(picture))
    if picture is not None:
        refuse_to_replace("--picture", picture)
    with open_flight(
        flight,
        telemetry,
        camera,
        telemetry_offset_s=offset_of(telemetry_offset),
        hfov_deg=hfov,
        mount_pitch_deg=mount_pitch,
        start_s=start,
        end_s=end,
        rate_hz=rate,
    ) as opened:
        opened_networks = [load_network(n) for n in network or [nearest_network(opened.camera)]]
        result, sights, valid = studied(opened, opened_networks, lengths_m, every)
    result = {"flight": flight.name, "start_s": start, "end_s": end, **result}
    show(result)
    write_figures(json, without_nan(result))
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
    from flightdepth.evaluation.provenance import network_facts, source_commit

    networks, grid = side_by_side(networks, flight.camera)
    pairs = BaselinePairs(flight, grid, lengths_m, every=every)
    methods: list[Method] = [*map(NetworkMethod, networks), PeerMethod(tuple(n.card for n in networks))]
    study = BaselineStudy(methods, grid.camera, grid.valid, pairs.known, lengths_m)
    sights = SheetSights(SHEET_FRAMES)
    frames = follow(flight, pairs, study, sights)
    about = {
        "telemetry": flight.telemetry_name,
        "camera": flight.camera_source,
        "networks": [network_facts(network) for network in networks],
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
    for moment in counted(pairs, "baselines", "frames", total=flight.frame_count_hint):
        seen = study.add(moment)
        if len(seen) == len(study.baselines_m):
            sights.add(seen)
        frames += 1
    return frames


def show(result: dict[str, Any]) -> None:
    """Print the tables, and what they were measured on."""
    from flightdepth.evaluation.baseline_tables import tables

    for title, table in tables(result):
        say(title)
        show_table(table)
    say("+- half of the 95 % bootstrap interval, over frames (the slope's over points)")
    counted = ", ".join(f"{count} over {length} m" for length, count in result["frames_per_baseline"].items())
    say(f"{result['frames']} frames, one in {result['every']} measured; pairs: {counted}")
    for witness, count in result["directions_told_by"].items():
        say(f"  direction of {count} pairs told by {witness}")
    for cause, count in result["left_out"].items():
        say(f"  {count} left out: {cause}")


def draw(sights: SheetSights, valid: Any, target: Path) -> None:
    """Write the picture, if any pair was seen."""
    from flightdepth.evaluation.baseline_sheets import sheet
    from flightdepth.outputs.encoding import rgb_png

    if not sights.chosen:
        say("no picture: no frame has a pair of every baseline")
        return
    write_atomic(target, rgb_png(sheet(sights.chosen, valid)))
    say(f"picture: {target}")
