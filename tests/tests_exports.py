"""Exports that trace an architecture once: tracing takes long, and the graph is the same whatever the weights are."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import onnx
from torch import Tensor, nn

from flightdepth.files import write_atomic


def traced_once(serialised: Callable[..., bytes], folder: Path) -> Callable[..., bytes]:
    """`training.export.serialised`, but a module like one in `folder` has that one's graph, with its own weights."""

    def quick(model: nn.Module, examples: Sequence[Tensor], *names_and_sizes: Any, **options: Any) -> bytes:
        parts = [(name, type(part), facts_of(part)) for name, part in model.named_modules()]
        shapes = [(each.shape, each.dtype) for each in (*examples, *model.state_dict().values())]
        key = hashlib.sha256(repr((parts, shapes, names_and_sizes, options)).encode()).hexdigest()
        if not (folder / key).exists():
            write_atomic(folder / key, serialised(model, examples, *names_and_sizes, **options))
        return with_weights((folder / key).read_bytes(), model)

    return quick


def facts_of(module: nn.Module) -> dict[str, object]:
    """What a module knows besides its weights and parts: sizes, strides, an activation, a range of depths."""
    return {name: value for name, value in vars(module).items() if not name.startswith("_")}


def with_weights(onnx_bytes: bytes, model: nn.Module) -> bytes:
    """An exported file with the weights of another module of its architecture."""
    weights = {name.removeprefix("network."): value for name, value in model.state_dict().items()}
    found = onnx.load_model_from_string(onnx_bytes)
    for initialiser in found.graph.initializer:
        if initialiser.name in weights:
            initialiser.raw_data = weights[initialiser.name].numpy().tobytes()
    return bytes(found.SerializeToString())
