"""What every exported network promises, and what every runtime does with it.

Input `pairs`: uint8 [n, H, W, 6], previous RGB then current RGB, H and W multiples of 64; the normalisation
(x / 255 - 0.5) / 0.2 is inside the graph. Output `depth_m`: float32 [n, H/4, W/4], metres at displacement D0,
clamped to the card's range.
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput

INPUT, OUTPUT = "pairs", "depth_m"
STRIDE = 64  # the deepest feature map is at 1/64
OUTPUT_STRIDE = 4

Precision = Literal["f32", "bf16"]
Pairs = NDArray[np.uint8]
Depths = NDArray[np.float32]


class Runtime(Protocol):
    """A network that is ready to run."""

    description: str

    def __call__(self, pairs: Pairs) -> Depths:
        """Depth at D0, float32 [n, H/4, W/4], of `pairs` uint8 [n, H, W, 6]; the caller owns the result."""
        ...


def check_graph(inputs: dict[str, str], outputs: dict[str, str]) -> None:
    """Refuse a graph whose inputs and outputs, as name -> 'type rank', are not the contract's."""
    expected = ({INPUT: "uint8 4"}, {OUTPUT: "float32 3"})
    if (inputs, outputs) != expected:
        raise BadInput(
            "ONNX graph",
            expected=f"input {expected[0]} and output {expected[1]} (name: type rank)",
            got=f"{inputs} and {outputs}",
            mend="Export the network with: flightdepth export.",
        )


def check_pairs(pairs: Pairs) -> None:
    """Refuse a batch that breaks the contract; a broken one would be our bug, not the user's."""
    n, height, width, channels = pairs.shape if pairs.ndim == 4 else (0, 0, 0, 0)
    fits = n > 0 and height > 0 and width > 0 and channels == 6 and height % STRIDE == width % STRIDE == 0
    if pairs.dtype != np.uint8 or not fits:
        raise ValueError(f"expected pairs uint8 [n, 64 i, 64 j, 6], got {pairs.dtype} {list(pairs.shape)}")
