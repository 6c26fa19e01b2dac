"""Recipes as small TOML files: those that ship with the package, and a user's own."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from flightdepth.errors import BadInput
from flightdepth.scenes import StillBoxConfig
from flightdepth.scenes.refusal import refusal
from flightdepth.training.recipe import Recipe, Stage

SHIPPED = resources.files("flightdepth.training") / "recipes"


def recipe_names() -> list[str]:
    """Recipes that ship with the package."""
    return sorted(p.name.removesuffix(".toml") for p in SHIPPED.iterdir() if p.name.endswith(".toml"))


def load_recipe(name_or_path: str) -> Recipe:
    """Read a shipped recipe by its name, or a file.

    Raises:
        BadInput: unknown name, no such file, or a key or value that does not fit.
    """
    data = _recipe_bytes(name_or_path)
    try:
        return Recipe.model_validate(tomllib.loads(data.decode()))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"recipe {name_or_path}", expected="TOML", got=str(error)) from error
    except ValidationError as error:
        keys = {"": Recipe.model_fields, "stages": Stage.model_fields, "scenes": StillBoxConfig.model_fields}
        raise refusal(f"recipe {name_or_path}", error, keys) from error


def _recipe_bytes(name_or_path: str) -> bytes:
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise BadInput(f"recipe {path}", expected="a TOML file", got="no such file")
        return path.read_bytes()
    if name_or_path in recipe_names():
        return (SHIPPED / f"{name_or_path}.toml").read_bytes()
    raise BadInput("recipe", expected=f"a .toml file or one of {', '.join(recipe_names())}", got=name_or_path)
