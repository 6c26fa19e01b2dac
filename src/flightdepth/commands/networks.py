"""`flightdepth networks`: what ships with this build."""

from __future__ import annotations

from flightdepth.commands.terminal import say, show_table


def networks() -> None:
    """List the networks that ship with this build.

    `flightdepth run` takes motion unless told otherwise; motion-tiny takes a
    third of its time and is less exact.

      flightdepth run flight.mp4 --network motion-tiny

    Those for any lens adapt to the camera (in brackets: the focal length that
    the nominal displacement goes with). The others want a camera whose focal
    length in pixels is near to theirs: the video is scaled to it first.
    """
    from rich.table import Table

    from flightdepth.weights.store import find_network, read_card, shipped_networks

    table = Table(
        "name", "focal length px", "depth m", "nominal displacement m", "trained on pairs", box=None
    )
    for name in shipped_networks():
        card = read_card(find_network(name))
        depth = f"{card.depth_min_m:g} to {card.depth_max_m:g}"
        focal = f"any ({card.focal_px:g})" if card.any_lens else f"{card.focal_px:g}"
        table.add_row(name, focal, depth, f"{card.D0_m:g}", f"{card.samples:,}")
    if table.row_count:
        show_table(table)
    else:
        say("no network ships with this build; give `flightdepth run` one with --network FILE.onnx")
