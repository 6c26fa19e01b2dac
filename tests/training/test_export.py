"""An exported network: the same depth in PyTorch, OpenVINO and ONNX Runtime, and weights that come back."""

from functools import partial
from typing import NamedTuple

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from flightdepth.architectures import DepthNet, FlowNetS, MotionNet
from flightdepth.architectures.depthnet import activated
from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.runtimes.inputs import swept_inputs
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.runtimes.onnx_ort import OnnxRuntime
from flightdepth.training import export
from flightdepth.training.export import (
    Deployed,
    DeployedMotion,
    deployed,
    in_half_precision,
    to_onnx,
    weights_of,
)
from flightdepth.training.recipe_files import load_recipe
from flightdepth.weights.store import find_network, read_network
from tests_exports import traced_once

BASE_WIDTH = 4
RANGE_M = (10.0, 60.0)
BATCH_NORMS = 10 + 4  # convolutions and transposed convolutions of the paper's figure


class Exported(NamedTuple):
    weights: dict
    exact: bytes
    half: bytes


@pytest.fixture(scope="module")
def exported(quick_exports):
    """A random network whose batch norms do something and whose depths fill its range and leave it a little."""
    generator = torch.manual_seed(4)
    network = DepthNet(BASE_WIDTH, "none")
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            for values, low, high in (
                (module.weight.data, 0.7, 1.3),
                (module.bias.data, -0.3, 0.3),
                (module.running_mean, -0.3, 0.3),
                (module.running_var, 0.7, 1.3),
            ):
                values.uniform_(low, high, generator=generator)
    network.predict_depth2.weight.data *= 3
    network.predict_depth2.bias.data.fill_(35)
    exact = to_onnx(Deployed(network, *RANGE_M).eval())
    return Exported(network.state_dict(), exact, in_half_precision(exact))


def pairs(n=2, height=64, width=64):
    return np.random.default_rng(n * height + width).integers(0, 256, (n, height, width, 6), dtype=np.uint8)


def in_pytorch(weights, batch):
    network = DepthNet(BASE_WIDTH, "none")
    network.load_state_dict(weights)
    with torch.no_grad():
        return Deployed(network, *RANGE_M).eval()(torch.from_numpy(batch)).numpy()


def test_the_random_network_has_depths_to_compare(exported):
    depth_m = in_pytorch(exported.weights, pairs())
    inside = (depth_m > RANGE_M[0]) & (depth_m < RANGE_M[1])
    assert inside.mean() > 0.5
    assert depth_m[inside].std() > 5


@pytest.mark.parametrize("runtime", [OpenVinoRuntime, OnnxRuntime])
@pytest.mark.parametrize("shape", [(1, 64, 64), (2, 192, 320), (4, 128, 128), (3, 256, 256)])
@pytest.mark.parametrize("storage", ["exact", "half"])
def test_a_runtime_agrees_with_pytorch(exported, runtime, shape, storage):
    file, batch, (n, height, width) = getattr(exported, storage), pairs(*shape), shape
    expected = in_pytorch(weights_of(file), batch)
    found = runtime(file)({"pairs": batch})["depth_m"]
    assert found.shape == expected.shape == (n, height // 4, width // 4)
    assert (np.abs(found - expected) / expected).max() < 1e-3


def test_weights_come_back(exported):
    found = weights_of(exported.exact)
    assert found.keys() == exported.weights.keys()
    trained = {key: value for key, value in exported.weights.items() if value.is_floating_point()}
    assert all(torch.equal(found[key], value) for key, value in trained.items())


def test_half_storage_rounds_kernels_and_nothing_else(exported):
    found = weights_of(exported.half)
    for key, value in exported.weights.items():
        if value.is_floating_point():
            assert torch.equal(found[key], value.half().float() if value.ndim > 1 else value)


def test_half_storage_is_half_the_size(exported):
    assert len(exported.half) / len(exported.exact) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("storage", ["exact", "half"])
def test_batch_norm_is_kept_apart(exported, storage):
    graph = onnx.load_model_from_string(getattr(exported, storage)).graph
    assert sum(node.op_type == "BatchNormalization" for node in graph.node) == BATCH_NORMS


def test_initialisers_carry_the_state_dict_keys(exported):
    graph = onnx.load_model_from_string(exported.exact).graph
    names = {initialiser.name for initialiser in graph.initializer}
    assert names >= {key for key, value in exported.weights.items() if value.is_floating_point()}


def test_depth_is_clipped_to_the_range(exported):
    depth_m = OpenVinoRuntime(exported.exact)({"pairs": pairs(4, 128, 128)})["depth_m"]
    assert (depth_m.min(), depth_m.max()) == RANGE_M


def test_an_onnx_file_of_somebody_else_has_no_weights():
    graph = onnx.helper.make_graph([], "empty", [], [])
    with pytest.raises(BadInput, match="flightdepth export"):
        weights_of(onnx.helper.make_model(graph).SerializeToString())


def test_an_export_that_lacks_a_weight_names_it(exported):
    """It came back as the number 0."""
    model = onnx.load_model_from_string(exported.exact)
    kept = [each for each in model.graph.initializer if each.name != "conv3.0.weight"]
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)
    with pytest.raises(BadInput, match=r"flightdepth export wrote, got one without conv3\.0\.weight"):
        weights_of(model.SerializeToString())


@pytest.mark.parametrize("size", [1, 100, 5000, -1])
def test_a_cut_export_is_refused(exported, size):
    """Protobuf's own error came through."""
    with pytest.raises(BadInput, match="flightdepth export"):
        weights_of(exported.exact[:size])


@pytest.mark.parametrize("damage", ["too short", "of no type"])
def test_an_export_with_a_damaged_weight_is_refused(exported, damage):
    """NumPy's and onnx's own errors came through."""
    model = onnx.load_model_from_string(exported.exact)
    weight = model.graph.initializer[0]
    if damage == "too short":
        weight.raw_data = weight.raw_data[:-4]
    else:
        weight.data_type = 77
    with pytest.raises(BadInput, match="flightdepth export"):
        weights_of(model.SerializeToString())


@pytest.mark.parametrize("seed", range(20))
def test_trash_is_no_export(seed):
    with pytest.raises(BadInput, match="flightdepth export"):
        weights_of(np.random.default_rng(seed).bytes(500))


@pytest.fixture(scope="module")
def flownets():
    torch.manual_seed(7)
    network = FlowNetS(4, "none")
    network.predict_depth2.bias.data.fill_(35)
    return Deployed(network, *RANGE_M).eval()


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["exact", "half"])
def test_flownets_goes_the_same_way(flownets, storage):
    exact = to_onnx(flownets)
    file = exact if storage == "exact" else in_half_precision(exact)
    found, kept = weights_of(file), flownets.network.state_dict()
    assert found.keys() == kept.keys()
    assert all(torch.allclose(found[key], value, rtol=1e-3, atol=1e-6) for key, value in kept.items())
    batch = pairs(2, 64, 128)
    with torch.no_grad():
        expected = flownets(torch.from_numpy(batch)).numpy()
    depth_m = OpenVinoRuntime(file)({"pairs": batch})["depth_m"]
    assert depth_m.shape == (2, 16, 32)
    assert np.abs(depth_m - expected).max() < 2e-3 * expected.max()


def agree_on_sweeps(file, model, runtime, shape):
    n, height, width = shape
    camera = Camera.from_fov(width, height, 80)
    pictures = pairs(n, height, width)
    moves = np.random.default_rng(0).normal(size=(n, 3))
    inputs = swept_inputs([pair[..., :3] for pair in pictures], pictures[0, ..., 3:], moves, camera)
    with torch.no_grad():
        depth, sigma = (each.numpy() for each in model(*(torch.from_numpy(a) for a in inputs.values())))
    found = runtime(file)(inputs)
    assert found["depth_m"].shape == (n, height // 4, width // 4)
    assert np.abs(found["depth_m"] - depth).max() < 1e-3 * depth.max()
    assert np.abs(found["sigma_m"] - sigma).max() < 1e-3 * sigma.max()


@pytest.fixture(scope="module", params=["motion", "motion-tiny"])
def shipped(request):
    """The file, and the network of its recipe with the weights that it holds."""
    onnx = read_network(find_network(request.param)).onnx
    return onnx, deployed(load_recipe(request.param), weights_of(onnx))


@pytest.mark.parametrize("runtime", [OpenVinoRuntime, OnnxRuntime])
@pytest.mark.parametrize("shape", [(1, 64, 64), (2, 128, 192)])
def test_a_runtime_agrees_with_pytorch_on_what_ships(shipped, runtime, shape):
    agree_on_sweeps(*shipped, runtime, shape)


# Of `motion`, of `motion-tiny`, and of neither. Slow: tracing one takes up to a minute.
@pytest.fixture(scope="module", params=[(2, True, True), (1, True, False), (2, False, False)], ids=str)
def motion(request):
    torch.manual_seed(6)
    looks, thorough, residual = request.param
    network = MotionNet(8, looks=looks, thorough_last_look=thorough, residual_blocks=residual)
    for name, module in network.named_modules():
        if name.endswith("added.4"):
            module.weight.data.fill_(0.3)
    network.predict_depth2.bias.data.fill_(35)
    model = DeployedMotion(network, 0.0, 100.0).eval()
    exact = to_onnx(model)
    return model, exact, in_half_precision(exact)


@pytest.mark.slow
@pytest.mark.parametrize("runtime", [OpenVinoRuntime, OnnxRuntime])
@pytest.mark.parametrize("shape", [(1, 64, 64), (2, 192, 320), (3, 128, 256)])
def test_a_runtime_agrees_with_pytorch_on_sweeps(motion, runtime, shape):
    model, exact, _ = motion
    agree_on_sweeps(exact, model, runtime, shape)


@pytest.mark.slow
def test_weights_of_a_motion_network_come_back(motion):
    model, exact, half = motion
    kept = {key: value for key, value in model.network.state_dict().items() if value.is_floating_point()}
    found, rounded = weights_of(exact), weights_of(half)
    assert found.keys() == rounded.keys() == model.network.state_dict().keys()
    assert all(torch.equal(found[key], value) for key, value in kept.items())
    assert all(torch.allclose(rounded[key], value, rtol=1e-3, atol=1e-6) for key, value in kept.items())


class OneLayer(nn.Module):
    """What `Deployed` asks of a network, and quickly traced."""

    def __init__(self, activation="none"):
        super().__init__()
        self.layer = nn.Sequential(nn.Conv2d(6, 1, 3, 4, 1), nn.BatchNorm2d(1))
        self.activation = activation

    def forward(self, images):
        return [activated(self.layer(images), self.activation)]


def of_seed(seed, made, range_m=RANGE_M):
    """Weights, means and variances that all differ from seed to seed."""
    for values in made.state_dict().values():
        if values.is_floating_point():
            values.uniform_(0.5, 1.5, generator=torch.manual_seed(seed))
    return (DeployedMotion if isinstance(made, MotionNet) else Deployed)(made, *range_m).eval()


SLOWLY_TRACED = [
    pytest.param(each, marks=pytest.mark.slow) for each in (partial(DepthNet, 4), partial(MotionNet, 4))
]


@pytest.mark.parametrize("network", [OneLayer, *SLOWLY_TRACED])
def test_what_other_tests_export_without_tracing_is_what_tracing_gives(network, tmp_path, monkeypatch):
    first, second = (of_seed(seed, network()) for seed in (1, 2))
    traced = to_onnx(first), to_onnx(second)
    monkeypatch.setattr(export, "serialised", traced_once(lambda *_: traced[0], tmp_path))
    assert (to_onnx(first), to_onnx(second)) == traced
    assert traced[0] != traced[1]


@pytest.mark.parametrize(
    ("other", "files"),
    [
        (of_seed(2, OneLayer()), 1),
        (of_seed(1, OneLayer("elu+1")), 2),
        (of_seed(1, OneLayer(), (5.0, 6.0)), 2),
        (of_seed(1, DepthNet(4)), 2),
    ],
    ids=["weights", "activation", "range", "architecture"],
)
def test_what_other_tests_export_is_traced_where_the_graph_is_another(other, files, tmp_path, monkeypatch):
    empty = onnx.helper.make_model(onnx.helper.make_graph([], "empty", [], []))
    monkeypatch.setattr(export, "serialised", traced_once(lambda *_: empty.SerializeToString(), tmp_path))
    for model in (of_seed(1, OneLayer()), other):
        to_onnx(model)
    assert len(list(tmp_path.iterdir())) == files
