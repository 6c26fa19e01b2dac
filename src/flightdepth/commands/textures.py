"""What scenes are dressed in, as the options of a command say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flightdepth.commands.terminal import say
from flightdepth.errors import BadInput

if TYPE_CHECKING:
    from flightdepth.scenes import Textures

PROCEDURAL = 200  # textures made where nobody says how many
SEED = 1  # of the procedural textures; the fixed test sets have others

TexturesOption = Annotated[
    Path | None,
    typer.Option("--textures", metavar="DIR", help="Photos to dress the scenes in, beside made ones."),
]
ProceduralOption = Annotated[
    int | None,
    typer.Option("--procedural", metavar="N", help=f"How many textures to make. Default: {PROCEDURAL}."),
]


def gathered_textures(folder: Path | None, procedural: int | None) -> Textures:
    """The photos of a folder, then `procedural` made ones (None: PROCEDURAL); says how many of each."""
    from flightdepth.scenes import Textures, textures_from_folder

    procedural = PROCEDURAL if procedural is None else procedural
    if procedural < 0 or (procedural == 0 and folder is None):
        raise BadInput("--procedural", expected="at least 1 without --textures", got=str(procedural))
    if folder is None:
        say(f"textures: {procedural} procedural; --textures DIR adds photos")
        return Textures.procedural(procedural, SEED)
    if not folder.is_dir():
        raise BadInput("--textures", expected="a folder of images", got=str(folder))
    textures = textures_from_folder(folder, made=procedural, seed=SEED)
    say(f"textures: {len(textures) - procedural} photos from {folder}, {procedural} procedural")
    return textures
