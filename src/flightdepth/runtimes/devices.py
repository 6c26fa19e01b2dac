"""Which runtime a device's name stands for, and in which precision it runs."""

from __future__ import annotations

import logging
from typing import get_args

from flightdepth.errors import BadInput
from flightdepth.processor import cpu_gains_by_bf16
from flightdepth.runtimes.contract import Precision, Runtime
from flightdepth.runtimes.memory import OutOfMemory
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.runtimes.onnx_ort import PROVIDERS, OnnxRuntime
from flightdepth.weights.card import NetworkCard

logger = logging.getLogger(__name__)

OPENVINO_DEVICES = ("auto", "cpu", "openvino")
DEVICES = (*OPENVINO_DEVICES, *PROVIDERS)

BF16_COST = "bf16_relative_cost"  # card metric: L1 in bf16 over L1 in f32, less 1, on the fixed test set
# The same of the weights that training went on from, where the CPU that exported could not tell what it costs these.
BF16_COST_BEFORE = "bf16_relative_cost_before"
BF16_COST_LIMIT = 0.01


def open_runtime(
    card: NetworkCard, onnx: bytes, *, device: str, precision: Precision | None, threads: int | None
) -> Runtime:
    """The runtime for one of DEVICES; "auto" is OpenVINO on the CPU. Precision None lets the card choose."""
    if device not in DEVICES:
        raise BadInput("device", expected=f"one of {', '.join(DEVICES)}", got=repr(device))
    if precision not in (None, *get_args(Precision)):
        raise BadInput("precision", expected=" or ".join(get_args(Precision)), got=repr(precision))
    if device in OPENVINO_DEVICES:
        precision = precision or best_precision(card)
        if precision == "int8" and not card.int8_ranges:
            raise BadInput(
                f"precision of {card.name}",
                expected="f32 or bf16",
                got="int8, for which its card holds no ranges",
                mend="Export the network again: flightdepth export.",
            )
        return OpenVinoRuntime(onnx, precision=precision, threads=threads, ranges=card.int8_ranges)
    if precision in ("bf16", "int8"):
        raise BadInput(f"precision on {device}", expected="f32", got=precision, mend="Use device openvino.")
    try:
        return OnnxRuntime(onnx, device, threads=threads)
    except OutOfMemory as error:
        logger.warning("%s while the network was loaded: it runs on the CPU", error)
        return on_cpu(card, onnx, threads=threads)


def on_cpu(card: NetworkCard, onnx: bytes, *, threads: int | None = None) -> Runtime:
    """Where every network finds room: OpenVINO on the CPU."""
    return OpenVinoRuntime(onnx, precision=best_precision(card), threads=threads)


def best_precision(card: NetworkCard) -> Precision:
    """bf16 where this CPU is faster in it and its measured cost is at most 1 % of the test error; else f32."""
    cost = bf16_cost(card)
    return "bf16" if cost is not None and cost <= BF16_COST_LIMIT and cpu_gains_by_bf16() else "f32"


def bf16_cost(card: NetworkCard) -> float | None:
    """What the card says that bf16 costs, or cost the weights before; None where it says neither."""
    return card.metrics.get(BF16_COST, card.metrics.get(BF16_COST_BEFORE))
