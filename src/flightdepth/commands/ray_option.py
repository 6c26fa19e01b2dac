"""`--engine ray` and `--address`, for every command that can work on a Ray cluster."""

from __future__ import annotations

from flightdepth.commands.extras import extra_packages
from flightdepth.errors import BadInput


def check_engine(command: str, engine: str, address: str | None) -> None:
    """Refuse what cannot work before anything is written."""
    if engine == "ray":
        with extra_packages(f"{command} --engine ray", "cluster"):
            import ray  # noqa: F401
    elif address is not None:
        raise BadInput("--address", expected="--engine ray beside it", got=f"--engine {engine}")
