"""Which arithmetic a device trains fastest in."""

from __future__ import annotations

from typing import Literal

import torch
from accelerate.utils import gather_object

from flightdepth.processor import cpu_gains_by_bf16, cpu_runs_bf16
from flightdepth.training.processes import this_process

Arithmetic = Literal["bf16", "no"]


def mixed_precision(before: Arithmetic | None = None) -> Arithmetic:
    """What accelerate calls it: "bf16" on accelerators and on processors that are faster in it.

    Elsewhere a step takes up to twice as long as in float32. Which of them is faster is timed, and a busy processor may
    say otherwise each time: a run goes on in what it was computed in `before`, where this processor has bf16 at all.
    The processes of a run get one answer: other work beside the timing hides what bf16 gains more often than it
    feigns it, so one that sees a gain speaks for all.
    """
    if torch.accelerator.is_available():
        return "bf16"
    if before is not None and cpu_runs_bf16():
        return before
    this_process()  # `gather_object` would take it for one with a GPU
    return "bf16" if any(gather_object([cpu_gains_by_bf16()])) else "no"
