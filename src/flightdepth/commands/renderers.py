"""`flightdepth evaluate renderer`: the ray caster against Blender's Cycles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.figures import JsonOption, check_figures, write_figures
from flightdepth.commands.terminal import counted, say
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, write_atomic

if TYPE_CHECKING:
    from flightdepth.evaluation.renderer import Frame

SEED, TEXTURES = 101, 40  # of the scenes and of their procedural textures
PICTURED = 4  # scenes in the picture
JPEG_QUALITY = 90


def renderer(
    *,
    scenes: Annotated[int, typer.Option(metavar="N", min=1, help="One frame each.")] = 20,
    size: Annotated[int, typer.Option(metavar="PX", min=8, help="Width and height.")] = 128,
    samples: Annotated[int, typer.Option(metavar="N", min=1, help="Rays a pixel in Cycles.")] = 16,
    outdoor: Annotated[bool, typer.Option("--outdoor", help="Outdoor scenes instead of rooms.")] = False,
    threads: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Of Cycles. Default: every core.")
    ] = None,
    json: JsonOption = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"Draw {PICTURED} scenes by both and their difference there."),
    ] = None,
) -> None:
    """Render the same scenes by the ray caster and by Blender, and compare depth and colour.

    Edges, where a ray may fall on either side, are counted apart. Needs Blender:
    `make blender-env`, or a `blender` on the PATH, or FLIGHTDEPTH_BLENDER.

      flightdepth evaluate renderer --scenes 20 --picture renderers.jpg
    """
    with extra_packages("flightdepth evaluate renderer", "train"):
        from flightdepth.evaluation.renderer import MEDIAN_LIMIT, OUTDOOR_MEDIAN_LIMIT, figures
        from flightdepth.renderers.blender import FINE, Blender
    check_figures(json)
    check_parent("--picture", picture)
    if picture is not None and picture.suffix not in (".jpg", ".png"):
        raise BadInput("--picture", expected="a .jpg or .png file", got=str(picture))
    with Blender(samples=samples, segments=FINE, threads=threads) as blender:
        say(blender.name)
        frames = compared(blender, scenes, size, outdoor)
        settings = {"blender": blender.name, "samples": samples, "size": size, "outdoor": outdoor}
    result = figures(frames, OUTDOOR_MEDIAN_LIMIT if outdoor else MEDIAN_LIMIT)
    show(result)
    keep(settings | result, frames, json, picture)


def compared(blender: Any, scenes: int, size: int, outdoor: bool) -> list[Frame]:
    """Every scene by both, with a progress bar."""
    from flightdepth.evaluation.renderer import both_ways
    from flightdepth.scenes import StillBoxConfig, Textures
    from flightdepth.scenes.outdoor_config import OutdoorConfig
    from flightdepth.stillbox.sets import SceneSet

    drawn = SceneSet(OutdoorConfig() if outdoor else StillBoxConfig(), size, size, SEED)
    textures = drawn.own_textures() or Textures.procedural(TEXTURES, SEED)
    numbered = ((number, drawn.scene(number, len(textures))) for number in range(scenes))
    return list(
        counted(both_ways(numbered, textures, drawn.camera, blender), "both ways", "scenes", total=scenes)
    )


def show(result: dict[str, Any]) -> None:
    """The figures as lines."""
    depth, colour, limits = result["depth"], result["colour"], result["limits"]
    median = "none" if depth["median"] is None else f"{depth['median']:.1e}"
    say(f"depth, off edges: median difference {median} (limit {limits['median']:.0e}), relative")
    say(f"  off by more than 1 %: {depth['off_share']:.4%} of pixels (limit {limits['off_share']:.2%})")
    say(
        f"  edges: {depth['edge_share']:.1%} of pixels, {depth['edge_off_share']:.2%} of them off by more than 1 %"
    )
    say(f"  sky in one picture only: {depth['sky_in_one_share']:.4%} of pixels")
    inside = colour["mean_difference_off_edges"]
    off_edges = "none" if inside is None else f"{inside:.2f}"
    say(
        f"colour: mean difference {colour['mean_difference']:.2f} of 255, off edges {off_edges};"
        f" means {colour['mean_ours']:.1f} and {colour['mean_theirs']:.1f}"
    )
    say(
        "the two agree" if result["within_limits"] else "the two do NOT agree: look at --json, scene by scene"
    )


def keep(result: dict[str, Any], frames: list[Frame], json: Path | None, picture: Path | None) -> None:
    """Write what was asked for."""
    from flightdepth.evaluation.provenance import source_commit
    from flightdepth.evaluation.renderer import picture as drawn
    from flightdepth.levels import jpeg
    from flightdepth.outputs.encoding import rgb_png
    from flightdepth.renderers.raycast import VERSION

    write_figures(json, {"commit": source_commit(), "renderer": VERSION, "seed": SEED} | result)
    if picture is not None:
        pixels = drawn(frames[:PICTURED])
        write_atomic(picture, jpeg(pixels, JPEG_QUALITY) if picture.suffix == ".jpg" else rgb_png(pixels))
        say(f"picture: {picture}")
