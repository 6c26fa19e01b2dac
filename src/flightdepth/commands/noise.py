"""`flightdepth evaluate noise`: what wrong telemetry costs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.figures import JsonOption, check_figures, write_figures
from flightdepth.commands.terminal import counted, show_table

if TYPE_CHECKING:
    from rich.table import Table


def noise(
    networks: Annotated[
        list[str], typer.Argument(metavar="NETWORK", help="Shipped names, or ONNX files, side by side.")
    ],
    *,
    scenes: Annotated[int, typer.Option(metavar="N", help="Scenes of the test set.")] = 100,
    derotate: Annotated[
        bool,
        typer.Option(
            "--derotate", help="Measure again with what the pictures show of rotation and direction mended."
        ),
    ] = False,
    json: JsonOption = None,
) -> None:
    """Error on the fixed test set when the reported motion is wrong: direction, speed, rotation.

    All networks see the same wrong pairs, so they must share a test set: the same
    focal length (a network for any lens has that of any other) and range.

      flightdepth evaluate noise motion depthnet-256

    What `flightdepth run` gets, which mends what it can see:

      flightdepth evaluate noise motion --derotate
    """
    with extra_packages("flightdepth evaluate", "train"):
        from flightdepth.evaluation.fixed_set import fixed_set, set_name
        from flightdepth.evaluation.noise import SEED, noise_rows
        from flightdepth.evaluation.provenance import network_facts, source_commit

    from flightdepth.runtimes.network import load_network

    check_figures(json)
    opened = [load_network(name, "openvino", precision="f32") for name in networks]
    pairs = fixed_set(next((n.card for n in opened if not n.card.any_lens), opened[0].card), scenes=scenes)
    rows = noise_rows(opened, counted(pairs, "noise", "scenes"), derotate=derotate)
    show_table(table(rows, set_name(pairs)))
    code = {"commit": source_commit(), "networks": [network_facts(network) for network in opened]}
    drawn = {"set": set_name(pairs), "scenes": scenes, "seed": pairs.seed, "noise_seed": SEED}
    write_figures(json, code | drawn | {"rows": rows})


def table(rows: list[dict[str, Any]], title: str) -> Table:
    """L1 in metres: a row for each kind and size of error, a column for each network."""
    from flightdepth.evaluation.network_tables import laid_out

    reported, networks = "reported motion", [key for key in rows[0] if key not in ("kind", "size")]
    cells = ([row["kind"], f"{row['size']:g}", *(f"{row[name]:.2f}" for name in networks)] for row in rows)
    return laid_out(f"L1 in metres on {title}", (reported, "", *networks), cells, names=reported)
