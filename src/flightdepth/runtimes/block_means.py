"""Means over blocks of pixels as convolutions, which OpenVINO computes in a fraction of the time of its pooling.

Not for bf16: a convolution rounds what enters it, and all that leads there, the places where pictures are sampled too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from openvino import opset13 as ops


def by_convolution(model: Any) -> None:
    """Exchange each unpadded average over blocks of known channels, in place.

    Of a single channel it stays: such a convolution runs on one core.
    """
    for node in model.get_ops():
        if node.get_type_name() != "AvgPool":
            continue
        facts, channels = node.get_attributes(), node.get_input_partial_shape(0)[1]
        kernel, padding = facts["kernel"], (*facts["pads_begin"], *facts["pads_end"])
        if channels.is_dynamic or channels.get_length() == 1:
            continue
        if kernel != facts["strides"] or any(padding):
            continue
        weights = np.full((channels.get_length(), 1, 1, *kernel), 1 / np.prod(kernel), np.float32)
        ends = [0] * len(kernel)
        means = ops.group_convolution(
            node.input_value(0), ops.constant(weights), kernel, ends, ends, [1] * len(kernel)
        )
        node.output(0).replace(means.output(0))
