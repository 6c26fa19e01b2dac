"""Recipes of a few steps, as the files that `flightdepth train` reads."""

from __future__ import annotations


def recipe_text(
    *stages: str, name: str = "small", loss: str = "saturating-l1", clamped: bool = False, more: str = ""
) -> str:
    """A DepthNet of a few thousand parameters; a clamped one answers 10 to 60 m at five frames."""
    nominal_shift, depth_min_m, depth_max_m = (5, 10.0, 60.0) if clamped else (3, 0.0, 100.0)
    return f"""
name = "{name}"
base_width = 4
activation = "none"
nominal_shift = {nominal_shift}
depth_min_m = {depth_min_m}
depth_max_m = {depth_max_m}
loss = "{loss}"
weight_decay = 1e-4
ema_decay = 0.9
warmup_samples = 0
floor = 0.1
seed = 3
{more}
""" + "".join(stages)


def stage_text(name: str, samples: int, *, width: int = 64, more: str = "") -> str:
    """Batches of four, 64 px high."""
    return f"""
[[stages]]
name = "{name}"
full_width = {width}
width = {width}
height = 64
samples = {samples}
batch = 4
learning_rate = 1e-3
{more}
"""
