"""What stays in float32 beside bf16: differences of pictures, and what that is worth."""

import numpy as np
import openvino as ov
import pytest
from openvino import opset13 as ops

from flightdepth.evaluation.fixed_set import fixed_set
from flightdepth.evaluation.pairs import Task
from flightdepth.processor import cpu_runs_bf16
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.runtimes.precise import precise_differences
from flightdepth.weights.store import read_network

needs_bf16 = pytest.mark.skipif(not cpu_runs_bf16(), reason="this CPU does not compute bf16")


def differences():
    """Mean absolute difference of two pictures, as a network's sweep has it."""
    one, other = (ops.parameter([1, 1, 8, 8], np.float32, name=name) for name in ("one", "other"))
    apart = ops.abs(ops.subtract(one, ops.sin(other)))
    apart.set_friendly_name("apart")
    kernel = ops.constant(np.full((1, 1, 4, 4), 1 / 16, np.float32))
    mean = ops.convolution(apart, kernel, [4, 4], [0, 0], [0, 0], [1, 1])
    mean.output(0).set_names({"mean"})
    return ov.Model([mean], [one, other], "differences")


def test_absolute_values_carry_the_mark_and_nothing_else_does():
    model = precise_differences(differences())
    marked = {
        node.get_type_name()
        for node in model.get_ops()
        if "DisablePrecisionConversion_0" in list(node.get_rt_info().keys())
    }
    assert marked == {"Abs"}


def test_the_graph_is_the_same():
    rng = np.random.default_rng(0)
    pictures = {name: rng.uniform(0, 1, (1, 1, 8, 8)).astype(np.float32) for name in ("one", "other")}
    expected = np.abs(pictures["one"] - np.sin(pictures["other"])).reshape(2, 4, 2, 4).mean((1, 3))
    compiled = ov.Core().compile_model(
        precise_differences(differences()), "CPU", {"INFERENCE_PRECISION_HINT": "f32"}
    )
    assert compiled(pictures)["mean"][0, 0] == pytest.approx(expected, rel=1e-5)


def test_a_graph_without_differences_is_left_alone():
    entering = ops.parameter([1], np.float32)
    model = ov.Model([ops.sin(entering)], [entering], "none")
    assert precise_differences(model) is model


def test_without_temporary_files_it_goes_on_as_it_is(monkeypatch, caplog):
    def full():
        raise OSError("no space left on device")

    monkeypatch.setattr("flightdepth.runtimes.precise.TemporaryDirectory", full)
    model = differences()
    assert precise_differences(model) is model
    assert "no space left" in caplog.text


@needs_bf16
def test_a_network_that_looks_at_differences_loses_nothing_by_bf16():
    """`motion` on eight rooms: depth changes by a third of what all in bf16 changes it by."""
    stored = read_network("motion")
    pairs = list(fixed_set(stored.card, scenes=8))

    def log_depth(runtime):
        network = Network(stored.card, runtime, aligned=False)
        tasks = [Task.of(pair, stored.card) for pair in pairs]
        return np.log([task.ask(network, pair).depth_m[0] for task, pair in zip(tasks, pairs, strict=True)])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flightdepth.runtimes.onnx_openvino.precise_differences", lambda model: model)
        all_rounded = OpenVinoRuntime(stored.onnx, precision="bf16")
    exact = log_depth(OpenVinoRuntime(stored.onnx))
    kept = np.abs(log_depth(OpenVinoRuntime(stored.onnx, precision="bf16")) - exact).mean()
    assert 0 < kept < np.abs(log_depth(all_rounded) - exact).mean() / 3
