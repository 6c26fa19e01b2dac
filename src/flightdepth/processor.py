"""This machine's processor, as OpenVINO knows it."""

from __future__ import annotations

import openvino as ov


def cpu_runs_bf16() -> bool:
    """Whether this CPU computes bf16 itself (AVX-512 BF16 or AMX); elsewhere it would be emulated, slowly."""
    return "BF16" in ov.Core().get_property("CPU", "OPTIMIZATION_CAPABILITIES")


def cpu_name() -> str:
    """Name of this machine's CPU, to stand beside every time that was measured on it."""
    return str(ov.Core().get_property("CPU", "FULL_DEVICE_NAME"))
