"""`--network`, `--precision` and `--no-align`, of the commands that fly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from flightdepth.errors import BadInput

if TYPE_CHECKING:
    from flightdepth.runtimes.contract import Precision
    from flightdepth.weights.card import NetworkCard

METHOD = "Method"  # a panel of --help


NetworkOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="See `flightdepth networks`; or an ONNX file. Default: motion; motion-tiny is faster.",
    ),
]
NetworkPrecision: TypeAlias = Literal["auto", "f32", "bf16", "int8"]
PrecisionOption = Annotated[
    NetworkPrecision,
    typer.Option(
        metavar="TYPE",
        help="Numbers that the network computes in: f32, bf16, or int8, which is fastest on CPUs with VNNI (what it "
        "costs stands on the network's card). auto: bf16 where the CPU is faster in it and it costs 1 % at most, "
        "else f32.",
    ),
]
AlignOption = Annotated[
    bool,
    typer.Option(
        help="Align depth with the pictures by optical flow; without it: rougher, sooner. "
        "Only networks that know the direction do.",
        rich_help_panel=METHOD,
    ),
]


def precision_of(option: NetworkPrecision) -> Precision | None:
    """As `load_network` takes it."""
    return None if option == "auto" else option


def check_align(card: NetworkCard, *, align: bool) -> None:
    """Refuse --no-align with a network whose depth is not aligned anyway."""
    if not (align or card.knows_direction):
        expected = "a network whose depth is aligned: it knows the direction of motion"
        raise BadInput("--no-align", expected=expected, got=card.name)
