"""The commands' tests open a network once: to compile it for pictures of the sample flight takes seconds."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import pytest

from flightdepth.runtimes import network
from flightdepth.runtimes.contract import Runtime
from flightdepth.weights.card import NetworkCard

open_runtime = network.open_runtime


@lru_cache(maxsize=3)
def opened(card_json: str, onnx: bytes, options: tuple[tuple[str, Any], ...]) -> Runtime:
    return open_runtime(NetworkCard.model_validate_json(card_json), onnx, **dict(options))


def opened_once(card: NetworkCard, onnx: bytes, **options: Any) -> Runtime:
    """`open_runtime`, but the last three are kept; a runtime remembers nothing of its pictures."""
    return opened(card.model_dump_json(), onnx, tuple(options.items()))


@pytest.fixture(autouse=True, scope="module")
def networks_compiled_once() -> Iterator[None]:
    """Of all modules here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(network, "open_runtime", opened_once)
        yield
