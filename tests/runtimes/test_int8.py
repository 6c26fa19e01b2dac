"""Convolutions on bytes: exact where bytes can be exact, close where they can't, and really on bytes."""

import numpy as np
import openvino as ov
import pytest
from openvino import opset13 as ops

from flightdepth.errors import BadInput
from flightdepth.runtimes import load_network
from flightdepth.runtimes.int8 import RangeMeter, largest_weight_step, rounded_with_sum, to_int8
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.weights.store import read_network

EXACT_F32 = {"INFERENCE_PRECISION_HINT": "f32"}


def graph(weights, *, name="conv2.0.weight", transposed=False):
    """One convolution of a picture [1, in, 8, 8]."""
    constant = ops.constant(weights.astype(np.float32))
    constant.set_friendly_name(name)
    channels = weights.shape[0 if transposed else 1]
    entering = ops.parameter([1, channels, 8, 8], np.float32, name="picture")
    layer = ops.convolution_backprop_data if transposed else ops.convolution
    kernel = {"strides": [1, 1], "pads_begin": [1, 1], "pads_end": [1, 1], "dilations": [1, 1]}
    found = layer(entering, constant, **kernel)
    found.output(0).set_names({"found"})
    return ov.Model([found], [entering], "one")


def answer(model, picture):
    return ov.Core().compile_model(model, "CPU", EXACT_F32)([picture])[0]


@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize(("least", "largest"), [(0.0, 255.0), (-128.0, 127.0)])
def test_what_bytes_can_say_is_exact(transposed, least, largest):
    """Weights in steps of 1/127 of each output channel's largest one, pictures in whole steps of their range.

    1/63 where sums of bytes would overflow.
    """
    rng, step = np.random.default_rng(0), largest_weight_step()
    weights = rng.integers(-step, step + 1, (3, 3, 3, 3)).astype(np.float32)
    outputs = weights.transpose(1, 0, 2, 3) if transposed else weights
    outputs[:, 0, 0, 0] = step
    outputs *= np.array([1.0, 0.25, 8.0]).reshape(3, 1, 1, 1)
    picture = rng.integers(least, largest + 1, (1, 3, 8, 8)).astype(np.float32)
    model = graph(weights, transposed=transposed)
    expected = answer(model, picture)
    to_int8(model, {"conv2.0.weight": (least, largest)})
    assert answer(model, picture) == pytest.approx(expected, rel=1e-5, abs=0.5)
    assert np.abs(expected).max() > 1e5 * step / 127


@pytest.mark.parametrize("axes", [(1, 2, 3), (0, 2, 3)])
def test_rounded_weights_keep_their_sum(axes):
    """Each goes up or down by less than one, and whole numbers stay."""
    values = np.random.default_rng(0).normal(0, 40, (5, 6, 3, 3)).astype(np.float32)
    values[:, :, 0] = np.round(values[:, :, 0])
    rounded = rounded_with_sum(values, axes)
    assert np.array_equal(rounded, np.round(rounded))
    assert np.abs(rounded - values).max() < 1
    assert np.array_equal(rounded[:, :, 0], values[:, :, 0])
    assert np.abs((rounded - values).sum(axis=axes)).max() <= 0.5 + 1e-3
    assert np.abs((np.round(values) - values).sum(axis=axes)).max() > 0.7


def test_what_is_smooth_is_not_shifted_by_rounded_weights():
    """A flat picture through kernels of 600 weights: within half a step, where each rounded alone is off by many."""
    rng, step = np.random.default_rng(0), largest_weight_step()
    weights = rng.normal(0, 1, (16, 66, 3, 3)).astype(np.float32)
    model = graph(weights)
    picture = np.full((1, 66, 8, 8), 255.0, np.float32)
    expected = answer(model, picture)[0, :, 4, 4]
    to_int8(model, {"conv2.0.weight": (0.0, 255.0)})
    steps = 255 * np.abs(weights).max(axis=(1, 2, 3)) / step
    assert np.abs((answer(model, picture)[0, :, 4, 4] - expected) / steps).max() < 0.55


def test_the_largest_bytes_do_not_overflow():
    """Two products of 127 and 255 are more than 16 bits hold."""
    model = graph(np.ones((16, 16, 3, 3)))
    to_int8(model, {"conv2.0.weight": (0.0, 255.0)})
    picture = np.full((1, 16, 8, 8), 255.0, np.float32)
    assert answer(model, picture)[0, :, 1:-1, 1:-1] == pytest.approx(255.0 * 16 * 9, rel=1e-3)


def test_beyond_its_range_a_value_is_its_end():
    model = graph(np.ones((1, 1, 1, 1)).repeat(3, 2).repeat(3, 3) / 9)
    to_int8(model, {"conv2.0.weight": (0.0, 10.0)})
    picture = np.full((1, 1, 8, 8), 25.0, np.float32)
    assert answer(model, picture)[0, 0, 4, 4] == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize("name", ["predict_depth2.weight", "deconv2.0.weight", "refinement.head.weight"])
def test_what_depth_hangs_on_stays_exact(name):
    model = graph(np.full((1, 1, 3, 3), 0.1), name=name)
    to_int8(model, {name: (0.0, 1.0)})
    assert [node.get_type_name() for node in model.get_ops()].count("FakeQuantize") == 0


def test_ranges_are_those_of_all_batches():
    pictures = [np.full((1, 2, 8, 8), value, np.float32) for value in (-3.0, 5.0, 1.0)]
    meter = RangeMeter(graph(np.ones((1, 2, 3, 3))), "DepthNet")
    answers = [meter({"picture": each}) for each in pictures]
    assert meter.ranges == {"conv2.0.weight": (-3.0, 5.0)}
    assert [float(each["found"][0, 0, 4, 4]) for each in answers] == [-54.0, 90.0, 18.0]


@pytest.fixture(scope="module")
def tiny():
    return read_network("tiny-clamped-256")


def test_the_shipped_networks_convolutions_are_on_bytes(tiny):
    runtime = OpenVinoRuntime(tiny.onnx, precision="int8", ranges=tiny.card.int8_ranges)
    pairs = np.zeros((1, 64, 64, 6), np.uint8)
    runtime({"pairs": pairs})
    (request,) = runtime._requests.values()
    compiled = request.get_compiled_model().get_runtime_model()
    kinds = [
        node.get_rt_info()["runtimePrecision"].astype(str)
        for node in compiled.get_ops()
        if node.get_rt_info()["layerType"].astype(str) == "Convolution"
    ]
    assert sum(kind in {"i8", "u8"} for kind in kinds) >= 9


@pytest.mark.parametrize(
    "name", ["tiny-clamped-256", "tiny-clamped-512", "motion", "motion-tiny", "depthnet-256"]
)
def test_what_it_costs_stands_on_the_card(name):
    card = read_network(name).card
    assert len(card.int8_ranges) >= 12
    assert abs(card.metrics["int8_relative_cost"]) < 0.02


def test_depth_is_nearly_that_of_float32(tiny):
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (32, 32, 3), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
    pairs = np.concatenate([np.roll(picture, 3, axis=1), picture], axis=2)[None]
    exact = OpenVinoRuntime(tiny.onnx)({"pairs": pairs})["depth_m"]
    rounded = OpenVinoRuntime(tiny.onnx, precision="int8", ranges=tiny.card.int8_ranges)({"pairs": pairs})
    change = np.abs(rounded["depth_m"] - exact) / exact
    assert 0 < np.median(change) < 0.1


def test_a_card_without_ranges_is_refused(tmp_path, tiny):
    from flightdepth.weights.store import save_network

    path = save_network(tmp_path, tiny.card.model_copy(update={"int8_ranges": {}}), tiny.onnx)
    with pytest.raises(BadInput, match="holds no ranges"):
        load_network(path, precision="int8")


def test_other_devices_refuse_it():
    with pytest.raises(BadInput, match="expected f32, got int8"):
        load_network("tiny-clamped-256", "onnxruntime", precision="int8")
