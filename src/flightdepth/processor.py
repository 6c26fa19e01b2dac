"""This machine's processor, as OpenVINO knows it, and the one door to OpenVINO."""

from __future__ import annotations

import time
from functools import cache

import numpy as np
import openvino as ov
import openvino.opset13 as ops

TRIED_CHANNELS, TRIED_SIZE = 64, 48  # of the convolution that is timed: 0.17 GFLOP
ROUNDS = 12
CLEARLY_FASTER = 0.9


@cache
def openvino_core() -> ov.Core:
    """The only one of this process, which stays until its end.

    The CPU plugin of each `ov.Core` gives the thread that first compiles a stack for signals, and hands back the one
    before when it goes. Of two that lived at once, that may be gone already: the next Ctrl-C ended the process.
    """
    return ov.Core()


def cpu_runs_bf16() -> bool:
    """Whether this CPU computes bf16 itself (AVX-512 BF16 or AMX); elsewhere it would be emulated, slowly."""
    return "BF16" in openvino_core().get_property("CPU", "OPTIMIZATION_CAPABILITIES")


@cache
def cpu_gains_by_bf16() -> bool:
    """Whether bf16 is faster here than float32. Intel's processors have it without AMX too, and slower by half then.

    Measured, once a process, in a tenth of a second: no flag tells it on all systems.
    """
    return cpu_runs_bf16() and bf16_over_f32() < CLEARLY_FASTER


def bf16_over_f32() -> float:
    """Time of a 3x3 convolution on one core in bf16 over that in float32; the best of some rounds, in turns."""
    tried = {each: _convolution(each) for each in ("bf16", "f32")}
    best_s = dict.fromkeys(tried, float("inf"))
    for _ in range(ROUNDS):
        for precision, request in tried.items():
            started = time.perf_counter()
            request.infer()
            best_s[precision] = min(best_s[precision], time.perf_counter() - started)
    return best_s["bf16"] / best_s["f32"]


def _convolution(precision: str) -> ov.InferRequest:
    shape = [1, TRIED_CHANNELS, TRIED_SIZE, TRIED_SIZE]
    picture = ops.parameter(shape, np.float32)
    kernel = np.full((TRIED_CHANNELS, TRIED_CHANNELS, 3, 3), 1e-3, np.float32)
    convolved = ops.convolution(picture, kernel, [1, 1], [1, 1], [1, 1], [1, 1])
    options = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": 1}
    model = openvino_core().compile_model(ov.Model([convolved], [picture]), "CPU", options)
    request = model.create_infer_request()
    request.set_input_tensor(
        ov.Tensor(np.ones(shape, np.float32))
    )  # unset memory may hold denormals, which are slow
    return request


def cpu_name() -> str:
    """Name of this machine's CPU, to stand beside every time that was measured on it."""
    return str(openvino_core().get_property("CPU", "FULL_DEVICE_NAME"))
