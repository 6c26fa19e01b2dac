"""Fixtures for all tests. pytest puts this folder on the path, so that `tests_networks` can be imported."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from flightdepth.weights.store import save_network
from tests_networks import difference_card, difference_onnx

# The same examples in every run: what fails here fails everywhere. No deadline: CI machines are shared.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture
def save_difference_network(tmp_path: Path) -> Callable[..., Path]:
    """Write the hand-made network with changes to its card; returns the ONNX file's path."""

    def save(**changes: object) -> Path:
        card = difference_card(**changes)
        return save_network(tmp_path, card, difference_onnx(card.depth_min_m, card.depth_max_m))

    return save
