"""A network made by hand, so that no test of the way from pixels to metres waits for training."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from flightdepth.sweep import LEVELS
from flightdepth.weights.card import NetworkCard


def difference_onnx(depth_min_m: float = 0.0, depth_max_m: float = 100.0, slope_m: float = 10.0) -> bytes:
    """An ONNX file that keeps the contract: depth = max - slope * mean over 4x4 px of |current - previous|.

    The difference is taken after normalisation, (x / 255 - 0.5) / 0.2, so 51 grey levels are worth 1.
    """
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    constants = {
        "levels": np.float32(255),
        "middle": np.float32(0.5),
        "spread": np.float32(0.2),
        "slope": np.float32(-slope_m),
        "low": np.float32(depth_min_m),
        "high": np.float32(depth_max_m),
        "colour": np.array([3], dtype=np.int64),
        "halves": np.array([3, 3], dtype=np.int64),
        "one": np.array([1], dtype=np.int64),
    }
    node = helper.make_node
    graph = helper.make_graph(
        [
            node("Cast", ["pairs"], ["raw"], to=TensorProto.FLOAT),
            node("Div", ["raw", "levels"], ["unit"]),
            node("Sub", ["unit", "middle"], ["centred"]),
            node("Div", ["centred", "spread"], ["normal"]),
            node("Split", ["normal", "halves"], ["previous", "current"], axis=3),
            node("Sub", ["current", "previous"], ["change"]),
            node("Abs", ["change"], ["size"]),
            node("ReduceMean", ["size", "colour"], ["grey"], keepdims=1),
            node("Transpose", ["grey"], ["planes"], perm=[0, 3, 1, 2]),
            node("AveragePool", ["planes"], ["cells"], kernel_shape=[4, 4], strides=[4, 4]),
            node("Mul", ["cells", "slope"], ["nearer"]),
            node("Add", ["nearer", "high"], ["metres"]),
            node("Clip", ["metres", "low", "high"], ["clipped"]),
            node("Squeeze", ["clipped", "one"], ["depth_m"]),
        ],
        "difference",
        [helper.make_tensor_value_info("pairs", TensorProto.UINT8, ["n", "H", "W", 6])],
        [helper.make_tensor_value_info("depth_m", TensorProto.FLOAT, ["n", "h", "w"])],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def difference_card(**changes: object) -> NetworkCard:
    """The card of `difference_onnx`, as of a network trained at focal length 32 px on 64x64 px pictures."""
    facts: dict[str, object] = {
        "name": "difference",
        "architecture": "DepthNet",
        "base_width": 32,
        "activation": "elu+1",
        "nominal_shift": 3,
        "D0_m": 0.3,
        "depth_min_m": 0.0,
        "depth_max_m": 100.0,
        "focal_px": 32.0,
        "width": 64,
        "height": 64,
        "samples": 0,
    }
    return NetworkCard.model_validate(facts | changes)


SWEPT_CAP_M = 100.0


def swept_card(focal_px: float = 64.0, *, looks: int = 1) -> NetworkCard:
    """Of `BestHypothesis`: 100 m at 0.3 m through 64 px of focal length."""
    facts: dict[str, object] = {"name": "best-hypothesis", "architecture": "MotionNet", "any_lens": True}
    facts |= {"D0_m": 0.3, "depth_min_m": 0.0, "depth_max_m": SWEPT_CAP_M, "focal_px": 64.0, "looks": looks}
    return difference_card(**facts).at_focal(focal_px)


class BestHypothesis:
    """A MotionNet without weights: each pixel takes the hypothesis of level 1 that looks most alike."""

    description = "numpy"
    architecture = "MotionNet"

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        grey = inputs["current"].astype(np.float32) @ np.float32([0.299, 0.587, 0.114])
        costs = np.abs(inputs["sweep_1"].astype(np.float32) - grey[:, None])
        n, k, height, width = costs.shape
        best = costs.reshape(n, k, height // 4, 4, width // 4, 4).mean(axis=(3, 5)).argmin(axis=1)
        shift_px = np.array(LEVELS[0].shifts_px)[best]
        depth_m = 0.3 * 64.0 / np.maximum(shift_px, 1e-3)
        depth_m = np.minimum(depth_m, SWEPT_CAP_M).astype(np.float32)
        return {"depth_m": depth_m, "sigma_m": 0.1 * depth_m}
