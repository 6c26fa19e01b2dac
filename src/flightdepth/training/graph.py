"""A training step as one CUDA graph: its thousand and more small kernels, which would each wait for the processor to
launch them, are recorded once and then launched together.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from flightdepth.training.inputs import TensorBatch

WARM_UP = 5  # steps of a stage before one is recorded: optimizers make their state in them, cuDNN chooses its kernels

Work = Callable[[Sequence[TensorBatch]], Tensor]


class StepGraph:
    """Does `work` on the GPU, from the parts of a batch to a loss: as it is at first, then as recorded.

    What `work` reads besides must stay where it is in memory, and all parts must be of one size.
    """

    def __init__(self, work: Work, device: torch.device) -> None:
        self._work, self._device = work, device
        # On the usual stream gradients can't be recorded.
        self._stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self._steps = 0

    def __call__(self, parts: Sequence[TensorBatch]) -> Tensor:
        """The loss, a scalar on the GPU that the next call overwrites."""
        self._steps += 1
        if self._steps <= WARM_UP:
            return self._as_it_is(parts)
        if self._steps == WARM_UP + 1:
            self._record(parts)
        for mine, new in zip(self._parts, parts, strict=True):
            mine.copy_(new)
        self._graph.replay()
        return self._loss

    def _as_it_is(self, parts: Sequence[TensorBatch]) -> Tensor:
        current = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(current)
        with torch.cuda.stream(self._stream), warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*capturable=True", UserWarning)  # it will be
            loss = self._work(parts)
        current.wait_stream(self._stream)
        return loss

    def _record(self, parts: Sequence[TensorBatch]) -> None:
        self._parts = [part.to(self._device) for part in parts]
        self._graph = torch.cuda.CUDAGraph()
        # Threads that hand over batches may use the GPU in the meantime.
        with torch.cuda.graph(self._graph, stream=self._stream, capture_error_mode="thread_local"):
            self._loss = self._work(self._parts)
