"""What every exported network promises, and what every runtime does with it.

Pictures are channels last; H and W are multiples of 64; the normalisation is inside the graph.

DepthNet takes    pairs    uint8 [n, H, W, 6], previous RGB then current RGB
MotionNet takes   current  uint8 [n, H, W, 3]
                  sweep_1, sweep_2, sweep_4  uint8 [n, hypotheses, H / scale, W / scale]  (`flightdepth.sweep`)
                  field    float32 [n, 2, H / 4, W / 4]
both give         depth_m  float32 [n, H / 4, W / 4], metres at displacement D0, clamped to the card's range
MotionNet also    sigma_m  float32 [n, H / 4, W / 4], metres at D0: two in three errors are smaller
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.sweep import FIELD_SCALE, LEVELS

STRIDE = 64  # the deepest feature map is at 1/64
OUTPUT_STRIDE = 4

Precision = Literal["f32", "bf16", "int8"]
Arrays = Mapping[str, NDArray[Any]]

DEPTH, SIGMA = "depth_m", "sigma_m"
PAIRS, CURRENT, FIELD = "pairs", "current", "field"
SWEEPS = tuple(f"sweep_{level.scale}" for level in LEVELS)

PICTURES = (PAIRS, CURRENT)  # channels last, the other inputs first

# Architecture -> name -> (type, scale, channels).
INPUTS: dict[str, dict[str, tuple[str, int, int]]] = {
    "DepthNet": {PAIRS: ("uint8", 1, 6)},
    "MotionNet": {
        CURRENT: ("uint8", 1, 3),
        **{
            name: ("uint8", level.scale, len(level.shifts_px))
            for name, level in zip(SWEEPS, LEVELS, strict=True)
        },
        FIELD: ("float32", FIELD_SCALE, 2),
    },
}
OUTPUTS = {"DepthNet": (DEPTH,), "MotionNet": (DEPTH, SIGMA)}


class Runtime(Protocol):
    """A network that is ready to run."""

    description: str
    architecture: str

    def __call__(self, inputs: Arrays) -> dict[str, NDArray[np.float32]]:
        """Outputs by name, of inputs by name; the caller owns the result."""


def architecture_of(inputs: dict[str, str], outputs: dict[str, str]) -> str:
    """Whose contract a graph keeps, by its inputs and outputs as name -> 'type rank'.

    Raises:
        BadInput: nobody's.
    """
    for architecture, taken in INPUTS.items():
        expected = {name: f"{kind} 4" for name, (kind, _, _) in taken.items()}
        given = dict.fromkeys(OUTPUTS[architecture], "float32 3")
        if (inputs, outputs) == (expected, given):
            return architecture
    known = " or ".join(f"{list(taken)} to {list(OUTPUTS[name])}" for name, taken in INPUTS.items())
    raise BadInput(
        "ONNX graph",
        expected=known,
        got=f"{inputs} to {outputs} (name: type rank)",
        mend="Export the network with: flightdepth export.",
    )


def check_inputs(architecture: str, inputs: Arrays) -> None:
    """Refuse a batch that breaks the contract; a broken one would be our bug, not the user's."""
    taken = INPUTS[architecture]
    first = inputs[next(iter(taken))] if inputs.keys() == taken.keys() else None
    n, height, width = first.shape[:3] if first is not None and first.ndim == 4 else (0, 0, 0)
    fits = n > 0 and height > 0 and width > 0 and height % STRIDE == width % STRIDE == 0
    expected = {
        name: (kind, _shape(name, (n, height // scale, width // scale), channels))
        for name, (kind, scale, channels) in taken.items()
    }
    got = {name: (str(array.dtype), array.shape) for name, array in inputs.items()}
    if not fits or got != expected:
        raise ValueError(f"expected {architecture} inputs {taken}, H and W multiples of 64, got {got}")


def _shape(name: str, size: tuple[int, int, int], channels: int) -> tuple[int, int, int, int]:
    n, height, width = size
    return (n, height, width, channels) if name in PICTURES else (n, channels, height, width)
