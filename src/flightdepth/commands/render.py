"""`flightdepth render`: a Still Box set as files, for other people's code."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.full_disk import room_on_the_disk
from flightdepth.commands.ray_option import check_engine
from flightdepth.commands.terminal import progress_bar, say
from flightdepth.commands.textures import ProceduralOption, TexturesOption, gathered_textures
from flightdepth.errors import BadInput
from flightdepth.files import held

if TYPE_CHECKING:
    from flightdepth.scenes import Textures
    from flightdepth.stillbox.encoding import EncodedScene, Renderer, Source
    from flightdepth.stillbox.sets import SceneSet

SCENES = 100  # where nobody says how many


Engine: TypeAlias = Literal["threads", "ray"]


def render(
    name: Annotated[
        str, typer.Argument(metavar="SET", help="64, 128, 256, 512 (its width in pixels) or outdoor.")
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="DIR", help="A new folder, or one to go on with.")],
    scenes: Annotated[
        str | None,
        typer.Option(
            metavar="N|all",
            help=f"How many; all: as many as the original has. Default: {SCENES}, or what --config says.",
        ),
    ] = None,
    layout: Annotated[
        Literal["folder", "shards"],
        typer.Option("--format", help="folder: the original Still Box layout; shards: WebDataset tar files."),
    ] = "folder",
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="Another seed is another set.")] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Pictures of another size, in pixels.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML or JSON with knobs of the set: frames = 20 ...")
    ] = None,
    textures: TexturesOption = None,
    procedural: ProceduralOption = None,
    renderer: Annotated[
        Literal["raycast", "blender"],
        typer.Option(help="raycast: this package's own. blender: Cycles, where Blender is installed."),
    ] = "raycast",
    samples: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Rays a pixel, with --renderer blender: more, less noise. Default: 4."
        ),
    ] = None,
    engine: Annotated[
        Engine, typer.Option(help="threads: this machine's cores; ray: a Ray cluster.")
    ] = "threads",
    address: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT|auto", help="The Ray cluster; without it, one on this machine."),
    ] = None,
) -> None:
    """Write scenes with depth to the disk. Training does not need it: it renders as it goes.

    A hundred scenes in the layout of the original, or as many as the original
    has:

      flightdepth render 64 --out stillbox-64

      flightdepth render 256 --scenes all --out stillbox-256

    Stopped, killed, or out of disk? The same command goes on where it was, and
    ends with the same bytes. With a larger --scenes it makes the set larger.

    Shards for other loaders (WebDataset), rendered by a Ray cluster:

      flightdepth render 256 --scenes all --format shards --out shards \\
        --engine ray --address auto
    """
    with extra_packages("flightdepth render", "train"):
        from flightdepth.renderers.raycast import check_memory
        from flightdepth.stillbox.encoding import Source
        from flightdepth.stillbox.set_on_disk import Layout, open_set, refuse_other_things
        from flightdepth.stillbox.sets import named_set, read_overrides
    check_engine("flightdepth render", engine, address)
    refuse_other_things(out)
    knobs = read_overrides(config) if config else {}
    wanted, original = named_set(name, **knobs | given(seed, size))
    count = scene_count(scenes, knobs.get("scenes", SCENES), original)
    source = Source(wanted, chosen(renderer, samples))
    if engine == "threads":  # a cluster's machines have memory of their own
        check_memory(wanted.camera, wanted.config.frames)
    dressed = dressing(wanted, textures, procedural)
    with (
        room_on_the_disk(out),
        held(out, "set", "render", "give another --out"),
    ):
        target = open_set(out, Layout(layout), f"stillbox-{name}", source.arguments(dressed), count)
        rest = range(target.standing, count)
        introduce(out, rest, original)
        if not rest:
            return
        frames = wanted.config.frames
        with (
            target,
            closing(started(engine, source, dressed, rest, address)) as rendered,
            progress_bar(f"Still Box {name}", count * frames, "frames") as bar,
        ):
            bar.begin_at(rest.start * frames, count * frames)
            for scene in rendered:
                target.add(scene)
                bar.step(frames)
    say(
        f"{out}: {count:,} scenes of {frames} frames, {wanted.width}x{wanted.height} px, in the {layout} layout"
    )


def dressing(wanted: SceneSet, folder: Path | None, procedural: int | None) -> Textures:
    """A set's own textures, else those of the options."""
    from flightdepth.scenes.outdoor_config import OutdoorConfig

    if isinstance(wanted.config, OutdoorConfig):  # told before its own are made, which takes a while
        for option, value in (("--textures", folder), ("--procedural", procedural)):
            if value is not None:
                raise BadInput(option, expected="none: this set brings its own", got=str(value))
    own = wanted.own_textures()
    return gathered_textures(folder, procedural) if own is None else own


def introduce(out: Path, rest: range, original: int) -> None:
    """Say what is about to be rendered."""
    if not rest:
        say(f"{out}: finished before, nothing to do; a larger --scenes makes it larger")
    elif rest.start:
        say(f"{out}: {rest.start:,} of {rest.stop:,} scenes stand; going on")
    else:
        say(f"{out}: {rest.stop:,} scenes; --scenes all is {original:,}")


def chosen(renderer: str, samples: int | None) -> Renderer:
    """The renderer of that name, with as many rays a pixel."""
    from flightdepth.renderers import blender
    from flightdepth.renderers.blender_process import needed_blender
    from flightdepth.stillbox.encoding import RAYCAST, Renderer

    if renderer == "raycast":
        if samples is not None:
            raise BadInput("--samples", expected="--renderer blender beside it", got=str(samples))
        return RAYCAST
    program = needed_blender()  # an error comes before anything is written
    say(f"renderer: {program.path}, found by {program.found_by}")
    count = blender.SAMPLES if samples is None else samples
    return Renderer(f"cycles-{count}", partial(blender.render, samples=count))


def given(seed: int | None, size: str | None) -> dict[str, Any]:
    """What the options say of the set; they come before the config file's word."""
    found: dict[str, Any] = {} if seed is None else {"seed": seed}
    if size is not None:
        match = re.fullmatch(r"(\d+)x(\d+)", size)
        if match is None:
            raise BadInput("--size", expected="WIDTHxHEIGHT in pixels, such as 512x288", got=size)
        found |= {"width": int(match[1]), "height": int(match[2])}
    return found


def scene_count(text: str | None, default: int, original: int) -> int:
    """The number that --scenes says, or else `default`."""
    if text is None:
        return default
    if text == "all":
        return original
    if not text.isdecimal() or int(text) < 1:
        raise BadInput("--scenes", expected="a number from 1 on, or all", got=text)
    return int(text)


def started(
    engine: Engine, source: Source, textures: Textures, numbers: range, address: str | None
) -> Generator[EncodedScene]:
    """Scenes `numbers` in order, by the engine that was asked for."""
    from flightdepth.stillbox.engines import on_ray, on_threads

    if engine == "threads":
        return on_threads(source, textures, numbers)
    return on_ray(source, textures, numbers, address)
