"""`flightdepth render`: a Still Box set as files, for other people's code."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.terminal import progress_bar, say
from flightdepth.commands.textures import gathered_textures
from flightdepth.errors import BadInput

if TYPE_CHECKING:
    from flightdepth.renderers.raycast import Rendered
    from flightdepth.scenes import Scene, StillBoxConfig, Textures


def render(
    width: Annotated[
        Literal["64", "128", "256", "512"], typer.Argument(metavar="SET", help="64, 128, 256 or 512 px.")
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="DIR", help="A new folder.")],
    scenes: Annotated[int, typer.Option(metavar="N", min=1, help="Ten frames each.")] = 100,
    layout: Annotated[
        Literal["folder"], typer.Option("--format", help="folder: the original Still Box layout.")
    ] = "folder",
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Another seed is another set.")] = 1,
    textures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Photos to dress the scenes in, beside made ones.")
    ] = None,
    procedural: Annotated[int, typer.Option(metavar="N", help="How many textures to make.")] = 200,
) -> None:
    """Write scenes with depth to the disk. Training does not need it: it renders as it goes.

    flightdepth render 64 --scenes 100 --out stillbox-64
    """
    with extra_packages("flightdepth render", "train"):
        from flightdepth.scenes import StillBoxConfig
        from flightdepth.stillbox.original_layout import OriginalLayout
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadInput("--out", expected="a new or empty folder", got=str(out))
    dressed, config = gathered_textures(textures, procedural), StillBoxConfig()
    out.mkdir(parents=True, exist_ok=True)
    target = OriginalLayout(out, config, int(width), seed)
    with progress_bar(f"Still Box {width}", scenes, "scenes") as bar:
        for number, (scene, images) in enumerate(rendered(config, dressed, int(width), seed, scenes)):
            target.add(number, scene, images)
            bar.advance(bar.task_ids[0])
    say(f"{out}: {scenes} scenes of {config.frames} frames, {width} px, in the {layout} layout")


def rendered(
    config: StillBoxConfig, textures: Textures, width: int, seed: int, scenes: int
) -> Iterator[tuple[Scene, Rendered]]:
    """Scenes 0 ... in order, a core each; only a few wait for the disk."""
    from flightdepth.camera import Camera
    from flightdepth.renderers import raycast
    from flightdepth.scenes import draw_scene

    camera = Camera.from_fov(width, width, config.horizontal_fov_deg)

    def one(number: int) -> tuple[Scene, Rendered]:
        scene = draw_scene(config, len(textures), seed, number)
        return scene, raycast.render(scene, textures, camera)

    cores = os.cpu_count() or 1
    numbers = iter(range(scenes))
    with ThreadPoolExecutor(cores, thread_name_prefix="render") as executor:
        waiting = [executor.submit(one, number) for number in islice(numbers, 2 * cores)]
        while waiting:
            yield waiting.pop(0).result()
            waiting += [executor.submit(one, number) for number in islice(numbers, 1)]
