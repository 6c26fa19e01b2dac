"""What to do when an accelerator has no memory left: said by each runtime in words of its own, here as one error."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from flightdepth.errors import FlightDepthError

# ONNX Runtime has no type for it (github.com/microsoft/onnxruntime/issues/16307): the arena's two messages, those of
# CUDA, cuDNN, cuBLAS and TensorRT, and OpenVINO's of a GPU.
WORDS = re.compile(
    r"failed to allocate memory|available memory of \d+ is smaller|out of (gpu )?(memory|resources)|bad_?alloc"
    r"|bad allocation|_ALLOC_FAILED|OUT_OF_(HOST_|DEVICE_)?MEMORY|OUT_OF_RESOURCES|max size of memory object",
    re.IGNORECASE,
)


class OutOfMemory(FlightDepthError):
    """The device that runs a network has no memory left for this batch."""


@contextmanager
def memory_errors(device: str) -> Iterator[None]:
    """Turn a runtime's error into OutOfMemory where it says so; others pass."""
    try:
        yield
    except MemoryError as error:
        raise OutOfMemory(f"no memory left on {device}") from error
    except Exception as error:  # ONNX Runtime's errors have no common type of their own
        if WORDS.search(str(error)):
            raise OutOfMemory(f"no memory left on {device}") from error
        raise
