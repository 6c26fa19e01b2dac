"""OpenVINO: the runtime for CPUs, and the only one in the base install."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from threading import Lock
from typing import Any

import numpy as np
import openvino as ov
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.processor import openvino_core
from flightdepth.runtimes.block_means import by_convolution
from flightdepth.runtimes.contract import Arrays, Precision, architecture_of, check_inputs
from flightdepth.runtimes.int8 import Ranges, to_int8
from flightdepth.runtimes.precise import precise_differences

# Picture sizes, and those of coarser looks; an older one is compiled again when it returns.
SHAPES_KEPT = 8
Shapes = tuple[tuple[str, tuple[int, ...]], ...]
TYPE_NAMES = {"u8": "uint8", "f32": "float32"}


class OpenVinoRuntime:
    """An ONNX file on the CPU.

    Compiled once per size of pictures, a third of a second and 55 MB each: a graph with dynamic sizes takes half as
    long again. The pairs of a batch go one by one, which takes 0 to 6 % longer than together (docs/log.md) and compiles
    nothing anew for another n. The request and its buffers are reused, under a lock.
    """

    def __init__(
        self,
        onnx: bytes,
        *,
        precision: Precision = "f32",
        threads: int | None = None,
        ranges: Ranges | None = None,
    ) -> None:
        """`threads` None uses every core; int8 needs the card's `int8_ranges`."""
        self._model, self.architecture = open_graph(onnx)
        if precision == "int8":
            to_int8(self._model, ranges or {})
        if precision == "bf16":
            self._model = precise_differences(self._model)
        else:
            by_convolution(self._model)
        self._outputs = [port.any_name for port in self._model.outputs]
        # The precision is always said: OpenVINO takes bf16 by itself where the CPU has it.
        self._settings: dict[str, Any] = {
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_PRECISION_HINT": "bf16" if precision == "bf16" else "f32",
        }
        if threads is not None:
            self._settings["INFERENCE_NUM_THREADS"] = threads
        self._requests: OrderedDict[Shapes, Any] = OrderedDict()
        self._lock = Lock()
        self.description = f"OpenVINO {ov.__version__.split('-')[0]}, CPU, {precision}"

    def __call__(self, inputs: Arrays) -> dict[str, NDArray[np.float32]]:
        """Outputs by name, of inputs by name."""
        check_inputs(self.architecture, inputs)
        contiguous = {name: np.ascontiguousarray(array) for name, array in inputs.items()}
        with self._lock:
            request = self._request(
                tuple((name, (1, *array.shape[1:])) for name, array in contiguous.items())
            )
            pairs = []
            for i in range(len(next(iter(contiguous.values())))):
                pair = {name: array[i : i + 1] for name, array in contiguous.items()}
                # The inputs are read in place; the outputs are the request's own buffers, hence the copies.
                outputs = request.infer(pair, share_inputs=True, share_outputs=True)
                # By place: a compiled port may answer to another of its names.
                pairs.append([np.array(each, np.float32) for each in outputs.to_tuple()])
            arrays = map(np.concatenate, zip(*pairs, strict=True))
            return dict(zip(self._outputs, arrays, strict=True))

    def _request(self, shapes: Shapes) -> Any:
        request = self._requests.pop(shapes, None)
        if request is None:
            self._model.reshape({name: list(shape) for name, shape in shapes})
            request = openvino_core().compile_model(self._model, "CPU", self._settings).create_infer_request()
        self._requests[shapes] = request
        if len(self._requests) > SHAPES_KEPT:
            self._requests.popitem(last=False)
        return request


def unfit_weights(onnx: bytes) -> Iterator[tuple[str, float]]:
    """Weights with NaN or infinity in them: name, and how large a share of its numbers."""
    model, _ = open_graph(onnx)
    for node in model.get_ops():
        if node.get_type_name() != "Constant" or not node.get_element_type().is_real():
            continue
        data = np.asarray(node.get_data(), dtype=np.float32)
        # A lone infinity may be the open end of a Clip.
        unfit = ~np.isfinite(data) if data.size > 1 else np.isnan(data)
        if unfit.any():
            yield node.get_friendly_name(), float(unfit.mean())


def open_graph(onnx: bytes) -> tuple[Any, str]:
    """Parse an ONNX file that is in memory; the graph and whose contract it keeps."""
    try:
        model = openvino_core().read_model(onnx)
    except RuntimeError as error:
        raise BadInput(
            "ONNX file", expected="a graph that OpenVINO reads", got=str(error).strip().splitlines()[-1]
        ) from error
    architecture = architecture_of(
        {port.any_name: describe(port) for port in model.inputs},
        {port.any_name: describe(port) for port in model.outputs},
    )
    return model, architecture


def describe(port: Any) -> str:
    """'type rank' of a graph's input or output."""
    type_name = port.element_type.get_type_name()
    return f"{TYPE_NAMES.get(type_name, type_name)} {port.partial_shape.rank}"
