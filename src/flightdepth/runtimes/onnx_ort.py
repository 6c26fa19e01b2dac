"""ONNX Runtime (optional): GPUs, and CPUs where OpenVINO is not wanted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput, FlightDepthError, MissingExtra
from flightdepth.runtimes.contract import OUTPUTS, Arrays, architecture_of, check_inputs
from flightdepth.runtimes.memory import OutOfMemory, memory_errors

PROVIDERS = {
    "onnxruntime": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
TYPE_NAMES = {"tensor(uint8)": "uint8", "tensor(float)": "float32"}


class OnnxRuntime:
    """An ONNX file on one execution provider, always in f32."""

    def __init__(self, onnx: bytes, device: str = "onnxruntime", *, threads: int | None = None) -> None:
        """`device` is one of PROVIDERS; `threads` None uses every core."""
        try:
            import onnxruntime
        except ImportError as error:
            raise MissingExtra(f"device {device}", "ort" if device == "onnxruntime" else "gpu") from error
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3
        if threads is not None:
            options.intra_op_num_threads = threads
        self._device = device
        self._session, self.architecture = open_session(onnxruntime, onnx, options, PROVIDERS[device])
        self.description = f"ONNX Runtime {onnxruntime.__version__}, {PROVIDERS[device]}, f32"

    def __call__(self, inputs: Arrays) -> dict[str, NDArray[np.float32]]:
        """Outputs by name, of inputs by name."""
        check_inputs(self.architecture, inputs)
        names = OUTPUTS[self.architecture]
        contiguous = {name: np.ascontiguousarray(array) for name, array in inputs.items()}
        with memory_errors(self._device):
            outputs = self._session.run(list(names), contiguous)
        return {name: np.asarray(each, np.float32) for name, each in zip(names, outputs, strict=True)}


def open_session(onnxruntime: Any, onnx: bytes, options: Any, provider: str) -> tuple[Any, str]:
    """A session on `provider` and no other, and whose contract its graph keeps."""
    available = onnxruntime.get_available_providers()
    if provider not in available:
        raise BadInput(
            "device", expected=f"an execution provider out of {', '.join(available)}", got=provider
        )
    try:
        with memory_errors(provider):
            session = onnxruntime.InferenceSession(onnx, options, providers=[provider])
    except OutOfMemory:
        raise
    except Exception as error:  # ONNX Runtime's errors have no common type of their own
        raise BadInput(
            "ONNX file", expected="a graph that ONNX Runtime reads", got=str(error).splitlines()[0]
        ) from error
    # Without a driver ONNX Runtime falls back to the CPU with no more than a warning.
    if provider not in session.get_providers():
        raise FlightDepthError(f"{provider} could not start on this machine: is its driver installed?")
    architecture = architecture_of(
        {port.name: describe(port) for port in session.get_inputs()},
        {port.name: describe(port) for port in session.get_outputs()},
    )
    return session, architecture


def describe(port: Any) -> str:
    """'type rank' of a graph's input or output."""
    return f"{TYPE_NAMES.get(port.type, port.type)} {len(port.shape)}"
