"""What is wrong with a user's knobs or recipe, in one line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches

from pydantic import ValidationError

from flightdepth.errors import BadInput

PYDANTIC = re.compile(r"^(Value error, |Input should be |Tuple should have )")  # how its sentences begin


def refusal(what: str, error: ValidationError, keys: Mapping[str, Iterable[str]]) -> BadInput:
    """The first thing that is wrong: an unknown key before the one it may be meant for.

    `keys` of each table by its name, and by "" those of the whole.
    """
    first = min(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
    kind, where, got = first["type"], first["loc"], first["input"]
    said = PYDANTIC.sub("", first["msg"])
    what = ", ".join([what, *([".".join(map(str, where))] if where else [])])
    if kind == "value_error" and "expected" in said:  # of a table as a whole it begins with the key
        return BadInput(f"{what}{', ' if isinstance(got, dict) else ': '}{said}")
    if kind == "value_error" and isinstance(got, dict):  # which would fill the line
        return BadInput(what, expected=said)
    if kind == "missing":
        return BadInput(what, expected="a value", got="none")
    if kind == "extra_forbidden":
        unknown, known = str(where[-1]), list(keys.get(str(where[0]), keys[""]))
        perhaps = "".join(f"; perhaps {near}" for near in get_close_matches(unknown, known, n=1))
        return BadInput(what, expected=f"keys from {', '.join(known)}{perhaps}", got=unknown)
    if kind == "tuple_type":
        said = f"tables, each under [[{where[-1]}]]" if isinstance(got, dict) else "a list"
    return BadInput(what, expected=said, got=str(got))
