"""Fixtures for all tests. pytest puts this folder on the path, so that `tests_networks` can be imported."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from pathlib import Path

import pytest
import typer
from hypothesis import settings

from flightdepth.cli import main
from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO
from flightdepth.weights.store import save_network
from tests_networks import difference_card, difference_onnx

# The same examples in every run: what fails here fails everywhere. No deadline: CI machines are shared.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(autouse=True, scope="session")
def one_command_line() -> Iterator[None]:
    """The commands are read once, not at each call of `main`: that takes longer than many of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", cache(typer.main.get_command))
        yield


@pytest.fixture(autouse=True, scope="session")
def textures_made_once() -> Iterator[None]:
    """The few textures that most runs take are made once: they took a tenth of the tests' time."""
    from flightdepth.scenes import Textures

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Textures, "procedural", staticmethod(lru_cache(maxsize=16)(Textures.procedural)))
        yield


@pytest.fixture(scope="session")
def sample_flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `flightdepth run` writes of the sample flight's first one and a half seconds: to be copied, not changed."""
    folder = tmp_path_factory.mktemp("sample") / "out"
    log = ["--telemetry", str(LOG), "--camera", str(CALIBRATION), "--end", "1.5", "--network", "motion-tiny"]
    assert main(["run", str(VIDEO), *log, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def save_difference_network(tmp_path: Path) -> Callable[..., Path]:
    """Write the hand-made network with changes to its card; returns the ONNX file's path."""

    def save(**changes: object) -> Path:
        card = difference_card(**changes)
        return save_network(tmp_path, card, difference_onnx(card.depth_min_m, card.depth_max_m))

    return save


@pytest.fixture(scope="module")
def few_fixed_textures() -> Iterator[None]:
    """Fixed test sets of a dozen textures: their own hundred take eight seconds to make."""
    from flightdepth.evaluation import sigma_scale
    from flightdepth.stillbox import testset
    from tests_textures import few_textures

    with pytest.MonkeyPatch.context() as patch:
        for module in (testset, sigma_scale):
            patch.setattr(module, "test_textures", lambda seed=testset.TEXTURE_SEED: few_textures(seed))
        yield


@pytest.fixture(scope="session")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for what is traced, of all of pytest's processes."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "traced"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="module")
def quick_exports(traced: Path) -> Iterator[None]:
    """Networks of one architecture are traced once for all tests, see `tests_exports`."""
    from flightdepth.training import export
    from tests_exports import traced_once

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "serialised", traced_once(export.serialised, traced))
        yield
