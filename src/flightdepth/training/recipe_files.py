"""Recipes as small TOML files: those that ship with the package, and a user's own."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from flightdepth.errors import BadInput
from flightdepth.scenes import StillBoxConfig
from flightdepth.training.recipe import FILE_NAME_RULE, Recipe, Stage

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
        raise _refusal(name_or_path, error) from error


def _refusal(name_or_path: str, error: ValidationError) -> BadInput:
    """The first thing that is wrong with a recipe, in one line: an unknown key before the one it may be meant for."""
    first = min(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
    where, said = first["loc"], first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    what = ", ".join([f"recipe {name_or_path}", *([".".join(map(str, where))] if where else [])])
    if first["type"] == "value_error":  # of a table as a whole, which would fill the line
        return BadInput(f"{what}, {said}") if "expected" in said else BadInput(what, expected=said)
    if first["type"] == "missing":
        return BadInput(what, expected="a value", got="none")
    if first["type"] == "extra_forbidden":
        tables = {"stages": Stage.model_fields, "scenes": StillBoxConfig.model_fields}
        keys = tables.get(str(where[0]), Recipe.model_fields)
        return BadInput(what, expected=f"keys from {', '.join(keys)}", got=str(where[-1]))
    if first["type"] == "string_pattern_mismatch":
        said = FILE_NAME_RULE
    return BadInput(what, expected=said, got=str(first["input"]))


def _recipe_bytes(name_or_path: str) -> bytes:
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise BadInput(f"recipe {path}", expected="a TOML file", got="no such file")
        return path.read_bytes()
    if name_or_path in recipe_names():
        return (SHIPPED / f"{name_or_path}.toml").read_bytes()
    raise BadInput("recipe", expected=f"a .toml file or one of {', '.join(recipe_names())}", got=name_or_path)
