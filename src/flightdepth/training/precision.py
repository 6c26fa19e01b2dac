"""Which arithmetic a device trains fastest in."""

from __future__ import annotations

from typing import Literal

import openvino
import torch


def mixed_precision() -> Literal["bf16", "no"]:
    """What accelerate calls it: "bf16" on accelerators and on processors that multiply it.

    Elsewhere it is emulated, and a step takes twice as long as in float32.
    """
    if torch.accelerator.is_available():
        return "bf16"
    return "bf16" if "BF16" in openvino.Core().get_property("CPU", "OPTIMIZATION_CAPABILITIES") else "no"
