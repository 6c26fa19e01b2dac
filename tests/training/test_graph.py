"""A step as one CUDA graph: that each network's can be recorded, and, where there is a GPU, that it learns the same."""

from functools import partial

import pytest
import torch
from torch.overrides import TorchFunctionMode
from training_runs import BATCH, small_recipe, small_stream, small_textures

from flightdepth.training.graph import WARM_UP
from flightdepth.training.inputs import TensorBatch
from flightdepth.training.learner import Learner, optimizer_of, set_learning_rate
from flightdepth.training.network import network_of

MOTION = {"architecture": "MotionNet", "looks": 2, "thorough_last_look": True, "residual_blocks": True}
RECIPES = {
    "DepthNet": small_recipe(optimizer="muon"),
    "FlowNetS": small_recipe(architecture="FlowNetS"),
    "MotionNet": small_recipe(reference_focal_px=32.0, optimizer="muon", **MOTION),
}
# What takes numbers from Python, or waits for the GPU to give some: neither can be recorded.
BETWEEN_PYTHON_AND_GPU = {
    torch.tensor,
    torch.as_tensor,
    torch.Tensor.new_tensor,
    torch.Tensor.item,
    torch.Tensor.tolist,
    torch.Tensor.cpu,
    torch.Tensor.__bool__,
    torch.Tensor.__float__,
    torch.Tensor.__int__,
}


class Watched(TorchFunctionMode):
    """Notes which of those are called."""

    def __init__(self):
        super().__init__()
        self.called = []

    def __torch_function__(self, function, types, arguments=(), named=None):
        if function in BETWEEN_PYTHON_AND_GPU:
            self.called.append(function)
        return function(*arguments, **(named or {}))


def begun(recipe):
    learner = Learner(recipe)
    learner.prepare()
    learner.begin(recipe.stages[0])
    return learner


def batches(recipe, count, sweep_later=False):
    with small_stream(recipe.scenes, small_textures(), recipe.stages[0].picture, recipe.rule, 1) as stream:
        pairs = [stream.batch(BATCH * each, BATCH) for each in range(count)]
    return [TensorBatch.of(recipe, each, sweep_later=sweep_later) for each in pairs]


def test_what_is_watched_is_seen():
    with Watched() as watched:
        torch.zeros(1).new_tensor((1.0, 2.0))
        torch.tensor(1.0)
        bool(torch.ones(()))
    assert watched.called == [torch.Tensor.new_tensor, torch.tensor, torch.Tensor.__bool__]


@pytest.mark.parametrize("sweep_later", [False, True])
@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_a_step_is_the_same_whatever_it_learns_from(recipe, sweep_later):
    """All of it, once the optimizer has its state: nothing comes from Python, and nothing goes there."""
    learner = begun(recipe)
    first, second = batches(recipe, 2, sweep_later)
    learner.step([first], recipe.stages[0], 0)
    with Watched() as watched:
        learner._learn_all([second])
    assert watched.called == []


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_a_recorded_step_learns_as_one_that_is_not(recipe):
    made = batches(recipe, 3 * WARM_UP, sweep_later=True)

    def losses(learner):
        steps = enumerate(made)
        return [learner.step([batch], recipe.stages[0], BATCH * number) for number, batch in steps]

    recorded, plain = begun(recipe), begun(recipe)
    assert recorded._graph is not None
    plain._graph = partial(plain._learn_all)
    assert losses(recorded) == pytest.approx(losses(plain), rel=0.02)


@pytest.mark.parametrize("name", ["sgd", "adamw", "muon"])
def test_a_learning_rate_in_memory_moves_weights_as_far(name):
    """As what is recorded reads it."""

    def moved(rate):
        recipe = RECIPES["DepthNet"]
        torch.manual_seed(1)
        network = network_of(recipe)
        optimizer = optimizer_of(recipe, network, name)
        for group in optimizer.param_groups:
            group["lr"] = rate
        for number in range(2):
            set_learning_rate(optimizer, 0.01 * (number + 1))
            for weights in network.parameters():
                weights.grad = torch.full_like(weights, 0.1) + weights.detach()
            optimizer.step()
        return torch.cat([weights.detach().flatten() for weights in network.parameters()])

    assert torch.allclose(moved(torch.zeros(())), moved(0.0), rtol=1e-5, atol=1e-7)
