"""Block means by convolution: the same numbers, where they may be exchanged."""

from collections import Counter

import numpy as np
import openvino as ov
import pytest
from openvino import opset13 as ops

from flightdepth.runtimes.block_means import by_convolution

MAPS = np.random.default_rng(0).normal(size=(2, 5, 16, 24)).astype(np.float32)


def graph(*, channels=5, strides=(4, 4), padding=(0, 0), ends=None):
    maps = ops.parameter([-1, channels, -1, -1], np.float32)
    means = ops.avg_pool(maps, list(strides), list(padding), list(ends or padding), [4, 4], True)
    return ov.Model([ops.abs(means)], [maps])


def kinds(model):
    return {node.get_type_name() for node in model.get_ops()}


def answer(model):
    compiled = ov.Core().compile_model(model, "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    channels = model.inputs[0].partial_shape[1]
    return compiled([MAPS if channels.is_dynamic else MAPS[:, : channels.get_length()]])[0]


def test_they_are_the_means_of_blocks():
    model = graph()
    by_convolution(model)
    assert "AvgPool" not in kinds(model)
    blocks = MAPS.reshape(2, 5, 4, 4, 6, 4).mean(axis=(3, 5))
    assert answer(model) == pytest.approx(np.abs(blocks), abs=1e-6)


@pytest.mark.parametrize(
    "facts",
    [
        {"channels": -1},
        {"channels": 1},
        {"strides": (2, 2)},
        {"padding": (1, 1)},
        {"padding": (1, 1), "ends": (0, 0)},
        {"ends": (1, 1)},
    ],
)
def test_what_is_no_mean_of_blocks_or_of_unknown_channels_or_one_stays(facts):
    model = graph(**facts)
    before = answer(model)
    by_convolution(model)
    assert "AvgPool" in kinds(model)
    assert np.array_equal(answer(model), before)


def test_each_of_several_is_exchanged_and_what_stays_among_them_hides_none():
    maps, grey = ops.parameter([-1, 5, -1, -1], np.float32), ops.parameter([-1, 1, -1, -1], np.float32)
    pooled = [ops.avg_pool(each, [4, 4], [0, 0], [0, 0], [4, 4], True) for each in (maps, grey)]
    of_two = [ops.avg_pool(pooled[k], [2, 2], [0, 0], [0, 0], [2, 2], True) for k in (0, 1)]
    model = ov.Model([ops.abs(each) for each in (*of_two, *pooled)], [grey, maps])
    by_convolution(model)
    counts = Counter(node.get_type_name() for node in model.get_ops())
    assert (counts["AvgPool"], counts["GroupConvolution"]) == (2, 2)


def test_blocks_that_are_no_squares_have_their_means():
    maps = ops.parameter([-1, 5, -1, -1], np.float32)
    model = ov.Model([ops.avg_pool(maps, [2, 4], [0, 0], [0, 0], [2, 4], True)], [maps])
    by_convolution(model)
    assert "AvgPool" not in kinds(model)
    assert answer(model) == pytest.approx(MAPS.reshape(2, 5, 8, 2, 6, 4).mean(axis=(3, 5)), abs=1e-6)
