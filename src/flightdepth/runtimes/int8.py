"""Convolutions on bytes, for CPUs that multiply them faster (VNNI, AMX): half the time of a DepthNet.

A byte needs to know which range it stands for. Weights say it themselves, one range for each output channel; those of
the feature maps are measured at export (`RangeMeter`) and kept on the card. FakeQuantize nodes (rounding to 256
levels, in float) then mark both inputs of a convolution, which OpenVINO compiles to one on bytes (Jacob et al. 2018).
Weights are rounded so that an output channel's sum stays: rounded each for itself they shift what is smooth, which
deeper layers add up (the mean shift of Nagel et al. 2019).
CPUs without VNNI add products in pairs of 16 bits, which overflow: there weights take 7 of their 8 bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import openvino as ov
from numpy.typing import ArrayLike, NDArray
from openvino import opset13 as ops

from flightdepth.processor import openvino_core
from flightdepth.runtimes.contract import Arrays

Ranges = Mapping[str, tuple[float, float]]

# Output channels of the weights: [out, in, h, w]; of a transposed convolution [in, out, h, w].
OTHER_AXES = {"Convolution": (1, 2, 3), "ConvolutionBackpropData": (0, 2, 3)}
LARGEST_STEP, LARGEST_OF_7_BITS = 127, 63  # 2 * 63 * 255 fits into 16 bits
# In float: what gives metres, the features of the finest depths, on which the error hangs, and the second look.
EXACT = ("predict_", "upsampled_", "deconv2", "deconv3", "refinement", "last_look")


class RangeMeter:
    """A runtime that, while it answers, measures what enters each convolution.

    `model` is an OpenVINO graph, which is changed: it is of no use afterwards.
    """

    description = "OpenVINO, measuring"

    def __init__(self, model: Any, architecture: str) -> None:
        self.architecture = architecture
        self._answers = [port.any_name for port in model.outputs]
        self._places = {_weights(layer).get_friendly_name(): _place(layer) for layer in _layers(model)}
        entering = {_place(layer): layer.input_value(0) for layer in _layers(model)}
        model.add_outputs(list(entering.values()))
        settings = {"INFERENCE_PRECISION_HINT": "f32"}
        self._request = openvino_core().compile_model(model, "CPU", settings).create_infer_request()
        self._ends = dict.fromkeys(entering, (np.inf, -np.inf))

    def __call__(self, inputs: Arrays) -> dict[str, NDArray[np.float32]]:
        """The network's answer."""
        maps = self._request.infer(dict(inputs)).to_tuple()
        known = len(self._answers)
        for (place, (least, largest)), entered in zip(self._ends.items(), maps[known:], strict=True):
            self._ends[place] = min(least, float(entered.min())), max(largest, float(entered.max()))
        return {name: np.array(each) for name, each in zip(self._answers, maps[:known], strict=True)}

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Least and largest value so far, by the name of the convolution's weights."""
        return {name: self._ends[place] for name, place in self._places.items()}


def to_int8(model: Any, ranges: Ranges, *, weight_step: int | None = None) -> None:
    """Mark each convolution that has a range, in place.

    `weight_step`: the step, of 127, that an output channel's largest weight becomes; None means what this CPU
    multiplies without overflow.
    """
    part = LARGEST_STEP / (weight_step or largest_weight_step())
    for layer in _layers(model):
        constant = _weights(layer)
        if (name := constant.get_friendly_name()) not in ranges:
            continue
        least, largest = ranges[name]
        if least < 0:  # signed: -128 to 127 steps, 0 stays 0
            step = max(-least / 128, largest / 127)
            least, largest = -128 * step, 127 * step
        _replace(layer, 0, layer.input_value(0), least, largest, levels=256)
        weights = np.asarray(constant.get_data(), dtype=np.float32)
        axes = OTHER_AXES[layer.get_type_name()]
        ends = np.maximum(np.abs(weights).max(axis=axes, keepdims=True) * part, 1e-8)
        step = ends / LARGEST_STEP
        weights = rounded_with_sum(weights / step, axes) * step
        _replace(layer, 1, ops.constant(weights), -ends, ends, levels=255)


def rounded_with_sum(values: NDArray[np.float32], axes: tuple[int, ...]) -> NDArray[np.float32]:
    """Up or down to whole numbers, so many up that sums over `axes` stay within a half (largest remainders)."""
    down = np.floor(values)
    rest = np.moveaxis(values - down, axes, range(-len(axes), 0))
    flat = rest.reshape(*rest.shape[: -len(axes)], -1)
    by_size = (-flat).argsort(axis=-1, kind="stable").argsort(axis=-1)
    up = by_size < np.round(flat.sum(axis=-1, keepdims=True))
    rounded: NDArray[np.float32] = down + np.moveaxis(up.reshape(rest.shape), range(-len(axes), 0), axes)
    return rounded


@lru_cache(1)
def largest_weight_step() -> int:
    """127, or 63 on a CPU whose products of bytes overflow: asked of OpenVINO with the largest bytes there are."""
    entering = ops.parameter([1, 16, 3, 3], np.float32)
    constant = ops.constant(np.ones((16, 16, 3, 3), np.float32))
    constant.set_friendly_name("probe")
    layer = ops.convolution(entering, constant, [1, 1], [0, 0], [0, 0], [1, 1])
    model = ov.Model([layer], [entering], "probe")
    to_int8(model, {"probe": (0.0, 255.0)}, weight_step=LARGEST_STEP)
    compiled = openvino_core().compile_model(model, "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    sums = compiled([np.full((1, 16, 3, 3), 255, np.float32)])[0]
    return LARGEST_STEP if np.allclose(sums, 255 * 16 * 9, rtol=1e-3) else LARGEST_OF_7_BITS


def _layers(model: Any) -> Iterable[Any]:
    """Convolutions of feature maps with weights that may be rounded."""
    for node in model.get_ops():
        if node.get_type_name() in OTHER_AXES and not _weights(node).get_friendly_name().startswith(EXACT):
            yield node


def _weights(layer: Any) -> Any:
    """The constant, which may be stored in half precision."""
    node = layer.input_value(1).get_node()
    while node.get_type_name() != "Constant":
        node = node.input_value(0).get_node()
    return node


def _place(layer: Any) -> tuple[str, int]:
    """Which output of which node enters; two layers may share it."""
    source = layer.input_value(0)
    return source.get_node().get_friendly_name(), source.get_index()


def _replace(
    layer: Any, place: int, source: Any, least: ArrayLike, largest: ArrayLike, *, levels: int
) -> None:
    ends = [ops.constant(np.asarray(end, np.float32)) for end in (least, largest, least, largest)]
    rounded = ops.fake_quantize(source, *ends, levels)
    layer.input(place).replace_source_output(rounded.output(0))
