"""Which arithmetic a device trains fastest in."""

from __future__ import annotations

from typing import Literal

import torch

from flightdepth.processor import cpu_gains_by_bf16


def mixed_precision() -> Literal["bf16", "no"]:
    """What accelerate calls it: "bf16" on accelerators and on processors that are faster in it.

    Elsewhere a step takes up to twice as long as in float32.
    """
    return "bf16" if torch.accelerator.is_available() or cpu_gains_by_bf16() else "no"
