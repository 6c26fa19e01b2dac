"""A trained network as one ONNX file, and back.

The file keeps batch norm apart and the state dict's keys as names of its initialisers, so that the training
side can read it back; weights may be stored in half precision, with a cast in front of their use.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import onnx
import torch
from google.protobuf.message import DecodeError  # type: ignore[import-untyped]
from onnx import helper, numpy_helper
from torch import Tensor, nn

from flightdepth.architectures import DepthNet, FlowNetS, MotionNet
from flightdepth.errors import BadInput
from flightdepth.sweep import LEVELS
from flightdepth.training.inputs import motion_inputs, normalised
from flightdepth.training.network import network_of
from flightdepth.training.recipe import STRIDE, Recipe

OPSET = 18
ROWS = 128  # of the example that the graph is traced with
COUNTER = "num_batches_tracked"  # of batch norm: not needed for inference, not exported
HALF = ".half"  # suffix of an initialiser stored in half precision


class Deployed(nn.Module):
    """What a runtime sees: `pairs` uint8 [n, H, W, 6] to `depth_m` float32 [n, H/4, W/4], metres at D0, clipped."""

    def __init__(self, network: DepthNet | FlowNetS, depth_min_m: float, depth_max_m: float) -> None:
        super().__init__()
        self.network = network
        self.range_m = (float(depth_min_m), float(depth_max_m))

    def forward(self, pairs: Tensor) -> Tensor:
        """Normalise, predict, keep the finest scale, clip."""
        finest: Tensor = self.network(normalised(pairs))[0]
        return finest.clamp(*self.range_m)


class DeployedMotion(nn.Module):
    """What a runtime sees of a MotionNet: the arrays of `runtimes.contract` to depth_m and sigma_m at D0."""

    def __init__(self, network: MotionNet, depth_min_m: float, depth_max_m: float) -> None:
        super().__init__()
        self.network = network
        self.range_m = (float(depth_min_m), float(depth_max_m))

    def forward(
        self, current: Tensor, sweep_1: Tensor, sweep_2: Tensor, sweep_4: Tensor, field: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Bytes to shares, predict, keep the finest scale, clip."""
        depths, sigma_m = self.network(*motion_inputs(current, sweep_1, sweep_2, sweep_4, field))
        return depths[0].clamp(*self.range_m), sigma_m


def deployed(recipe: Recipe, weights: dict[str, Tensor]) -> Deployed | DeployedMotion:
    """The network of a recipe with these weights, in evaluation mode."""
    network = network_of(recipe)
    network.load_state_dict(weights)
    range_m = (recipe.depth_min_m, recipe.depth_max_m)
    if isinstance(network, MotionNet):
        return DeployedMotion(network, *range_m).eval()
    return Deployed(network, *range_m).eval()


def to_onnx(model: Deployed | DeployedMotion) -> bytes:
    """Serialise; batch, height and width stay free (height and width multiples of 64)."""
    examples, inputs, outputs = _interface(model)
    return serialised(model, examples, inputs, outputs, [_sizes(example.shape) for example in examples])


def serialised(
    model: nn.Module,
    examples: Sequence[Tensor],
    inputs: Sequence[str],
    outputs: Sequence[str],
    free_sizes: Sequence[dict[int, Any]],
    *,
    optimize: bool = False,
) -> bytes:
    """An ONNX file of a module, traced with `examples`, whose `free_sizes` (by axis) stay free.

    `optimize` folds constants, which OpenCV wants and the half precision of stored weights does not.
    """
    with _quiet_exporter():
        program = torch.onnx.export(
            model,
            tuple(examples),
            input_names=inputs,
            output_names=outputs,
            dynamic_shapes=tuple(free_sizes),
            opset_version=OPSET,
            dynamo=True,
            optimize=optimize,
            verbose=False,
        )
    assert program is not None
    graph = program.model_proto
    _strip_names(graph)
    _strip_origins(graph)
    exact = bytes(graph.SerializeToString())
    onnx.checker.check_model(exact)
    return exact


def in_half_precision(exact: bytes) -> bytes:
    """The same ONNX file with its kernels stored in float16, each cast to float32 once, when it is loaded."""
    graph = onnx.load_model_from_string(exact)
    _store_half(graph)
    onnx.checker.check_model(graph)
    return bytes(graph.SerializeToString())


def weights_of(onnx_bytes: bytes) -> dict[str, Tensor]:
    """State dict in an exported file, float32.

    Raises:
        BadInput: the file cannot be read, or holds not all weights under the names of a state dict.
    """
    expected = "an ONNX file that flightdepth export wrote"
    try:
        graph = onnx.load_model_from_string(onnx_bytes).graph
        arrays = {i.name.removesuffix(HALF): numpy_helper.to_array(i) for i in graph.initializer}
    except (DecodeError, ValueError, KeyError, TypeError) as error:  # the last three of a damaged tensor
        raise BadInput("weights", expected=expected, got=str(error)) from error
    keys = _architecture_with(arrays.keys()).state_dict().keys()
    found = {k: torch.from_numpy(arrays[k].copy()) for k in keys if k in arrays}
    if not found:
        raise BadInput("weights", expected=expected, got="other names")
    for key in (key for key in keys if key not in found):
        if not key.endswith(COUNTER):
            raise BadInput("weights", expected=expected, got=f"one without {key}")
        found[key] = torch.zeros((), dtype=torch.int64)
    return {k: v.float() if v.is_floating_point() else v for k, v in found.items()}


def _architecture_with(names: Collection[str]) -> DepthNet | FlowNetS | MotionNet:
    """What only one of them has: a spread, or convolutions with a bias instead of batch norm; a map wide."""
    if "predict_spread2.weight" in names:
        looks = 1 + ("refinement.head.bias" in names)  # of those that differ
        return MotionNet(
            1,
            looks=looks,
            thorough_last_look="last_look.head.bias" in names,
            residual_blocks="conv6_1.3.added.0.weight" in names,
        )
    return FlowNetS(1) if "conv1.0.bias" in names else DepthNet(1)


def _interface(model: Deployed | DeployedMotion) -> tuple[list[Tensor], list[str], list[str]]:
    """Example inputs, and the names of inputs and outputs."""
    rows, columns = ROWS, ROWS * 3 // 2
    if isinstance(model, Deployed):
        return [torch.zeros((2, rows, columns, 6), dtype=torch.uint8)], ["pairs"], ["depth_m"]
    sweeps = [
        torch.zeros((2, len(level.shifts_px), rows // level.scale, columns // level.scale), dtype=torch.uint8)
        for level in LEVELS
    ]
    examples = [torch.zeros((2, rows, columns, 3), dtype=torch.uint8), *sweeps]
    examples.append(torch.zeros((2, 2, rows // 4, columns // 4)))
    names = ["current", *(f"sweep_{level.scale}" for level in LEVELS), "field"]
    return examples, names, ["depth_m", "sigma_m"]


def _sizes(shape: Sequence[int]) -> dict[int, Any]:
    """Free sizes of an input, [n, rows, columns, channels] or [n, channels, rows, columns] by its shape."""
    rows = 1 if shape[1] >= ROWS // max(level.scale for level in LEVELS) else 2
    share, dim = shape[rows] * STRIDE // ROWS, torch.export.Dim
    return {0: dim("n"), rows: share * dim("high"), rows + 1: share * dim("wide")}


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Without notices of PyTorch's exporter about itself: operators of torchvision, its old names, shared axes."""
    registration = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = registration.level
    registration.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", r"# The axis name", UserWarning)
            warnings.filterwarnings("ignore", r"`isinstance\(treespec, LeafSpec\)`", FutureWarning)
            yield
    finally:
        registration.setLevel(level)


def _strip_names(model: onnx.ModelProto) -> None:
    """Drop the wrapper's prefix from the initialisers' names, wherever they are used."""
    prefix = "network."
    renamed = {i.name: i.name.removeprefix(prefix) for i in model.graph.initializer}
    for initialiser in model.graph.initializer:
        initialiser.name = renamed[initialiser.name]
    for node in model.graph.node:
        node.input[:] = [renamed.get(name, name) for name in node.input]
    for value in model.graph.value_info:
        value.name = renamed.get(value.name, value.name)


def _strip_origins(model: onnx.ModelProto) -> None:
    """Drop what the exporter notes beside each node: stack traces with the paths of this machine."""
    del model.metadata_props[:], model.graph.metadata_props[:]
    for part in (*model.graph.node, *model.graph.value_info, *model.graph.input, *model.graph.output):
        del part.metadata_props[:]
        part.doc_string = ""


def _store_half(model: onnx.ModelProto) -> None:
    casts = []
    for initialiser in model.graph.initializer:
        array = numpy_helper.to_array(initialiser)
        if array.dtype != np.float32 or array.ndim < 2:
            continue
        name = initialiser.name
        initialiser.CopyFrom(numpy_helper.from_array(array.astype(np.float16), name + HALF))
        casts.append(helper.make_node("Cast", [name + HALF], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
