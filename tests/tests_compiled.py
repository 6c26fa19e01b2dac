"""Networks that one process of pytest compiles once: for pictures of the sample flight that takes seconds."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from flightdepth.runtimes.contract import Runtime
from flightdepth.weights.card import NetworkCard


def opened_once(open_runtime: Callable[..., Runtime]) -> Callable[..., Runtime]:
    """`runtimes.devices.open_runtime`, but the last three are kept; a runtime remembers nothing of its pictures."""

    @lru_cache(maxsize=3)
    def opened(card_json: str, onnx: bytes, options: tuple[tuple[str, Any], ...]) -> Runtime:
        return open_runtime(NetworkCard.model_validate_json(card_json), onnx, **dict(options))

    def kept(card: NetworkCard, onnx: bytes, **options: Any) -> Runtime:
        return opened(card.model_dump_json(), onnx, tuple(options.items()))

    return kept
