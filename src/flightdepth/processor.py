"""This machine's processor, as OpenVINO knows it, and the one door to OpenVINO."""

from __future__ import annotations

from functools import cache

import openvino as ov


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


def cpu_name() -> str:
    """Name of this machine's CPU, to stand beside every time that was measured on it."""
    return str(openvino_core().get_property("CPU", "FULL_DEVICE_NAME"))
