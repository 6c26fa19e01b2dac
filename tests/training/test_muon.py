"""Muon: PyTorch's own, which knows matrices only, gives the same steps; what is no kernel goes AdamW's way."""

import copy
from itertools import pairwise, starmap

import pytest
import torch
from torch import nn, optim

from flightdepth.training.muon import Muon, orthogonal

SETTINGS = {"lr": 0.02, "weight_decay": 0.1}


def learn(network, optimizer, *, steps=3):
    """A few steps towards an arbitrary target."""
    generator = torch.Generator().manual_seed(5)
    for _ in range(steps):
        pictures = torch.randn((2, 3, 8, 8), generator=generator)
        optimizer.zero_grad()
        (network(pictures) - 1).square().mean().backward()
        optimizer.step()
    return network


@pytest.fixture
def network():
    torch.manual_seed(3)
    layers = (
        nn.Conv2d(3, 40, 3),
        nn.BatchNorm2d(40),
        nn.ConvTranspose2d(40, 4, 4, bias=False),
        nn.Conv2d(4, 1, 1),
    )
    return nn.Sequential(*layers)


def gradients(network, *, steps=3):
    """Arbitrary ones, so that no direction is lost in bf16."""
    generator = torch.Generator().manual_seed(7)
    for _ in range(steps):
        yield [torch.randn(weights.shape, generator=generator) for weights in network.parameters()]


def stepped(weights, optimizer, gradients):
    for each in gradients:
        for parameter, gradient in zip(weights, each, strict=True):
            parameter.grad = gradient.reshape(parameter.shape).clone()
        optimizer.step()
    return [parameter.detach() for parameter in weights]


def test_kernels_go_as_pytorch_moves_matrices(network):
    begun = [weights.detach().clone() for weights in network.parameters()]
    kernels = [number for number, weights in enumerate(begun) if weights.ndim == 4 and len(weights) > 1]
    matrices = [nn.Parameter(begun[number].flatten(1).clone()) for number in kernels]
    asked = [[each[number] for number in kernels] for each in gradients(network)]
    theirs = stepped(matrices, optim.Muon(matrices, adjust_lr_fn="match_rms_adamw", **SETTINGS), asked)
    ours = stepped(list(network.parameters()), Muon(network, **SETTINGS), gradients(network))
    assert len(kernels) == 2
    for number, expected in zip(kernels, theirs, strict=True):
        start = begun[number].flatten(1)
        moved, wanted = ours[number].flatten(1) - start, expected - start
        assert (moved - wanted).norm() < 0.02 * wanted.norm()  # theirs multiplies in bf16


def test_the_rest_goes_as_adamw_moves_it(network):
    other = copy.deepcopy(network)
    ours = stepped(list(network.parameters()), Muon(network, **SETTINGS), gradients(network))
    theirs = stepped(list(other.parameters()), optim.AdamW(other.parameters(), **SETTINGS), gradients(other))
    same = {
        name
        for (name, _), a, b in zip(network.named_parameters(), ours, theirs, strict=True)
        if torch.allclose(a, b, atol=1e-6)
    }
    assert same == {"0.bias", "1.weight", "1.bias", "3.weight", "3.bias"}


@pytest.mark.parametrize(
    ("layer", "edges"),
    [
        (nn.Conv2d(3, 130, 7), (0, 44, 87, 130)),
        (nn.ConvTranspose2d(130, 3, 7), (0, 44, 87, 130)),
        (nn.Conv2d(3, 128, 7), (0, 64, 128)),
    ],
)
def test_many_channels_move_in_even_blocks(layer, edges):
    """Each along an orthogonal matrix of its own, whether blocks are as large as one another or not."""
    before = layer.weight.detach().clone()
    optimizer = Muon(layer, lr=1.0, weight_decay=0.0)
    ((gradient, _),) = gradients(layer, steps=1)
    weights, _ = stepped(list(layer.parameters()), optimizer, gradients(layer, steps=1))
    moved, wide = (before - weights).flatten(1) / (0.2 * 147**0.5), gradient.flatten(1)
    for rows in starmap(slice, pairwise(edges)):
        assert torch.allclose(moved[rows], orthogonal(wide[rows]), atol=1e-5)
    assert not torch.allclose(moved, orthogonal(wide), atol=0.01)


@pytest.mark.parametrize("shape", [(5, 40), (16, 16)])
def test_a_matrix_becomes_nearly_orthogonal(shape):
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0)).double()
    left, values, right = torch.linalg.svd(matrix, full_matrices=False)
    found = orthogonal(matrix)
    assert torch.linalg.svdvals(found) == pytest.approx(torch.ones_like(values), abs=0.35)
    turned = left.T @ found @ right.T
    assert torch.allclose(turned, torch.diag(torch.diagonal(turned)), atol=1e-9)


@pytest.mark.parametrize("shape", [(5, 40), (16, 16), (64, 576)])
def test_is_the_iteration_of_jordan_turn_by_turn(shape):
    x = matrix = torch.randn(shape, generator=torch.Generator().manual_seed(1))
    x = x / x.norm()
    for _ in range(5):
        x = 3.4445 * x - 4.7750 * x @ x.T @ x + 2.0315 * x @ x.T @ x @ x.T @ x
    assert (orthogonal(matrix) - x).norm() < 1e-3 * x.norm()


def test_no_momentum_is_no_step():
    assert not orthogonal(torch.zeros(3, 7)).any()


def test_a_loaded_state_goes_on_as_it_would_have(network):
    """As accelerate does before the first step, and as a checkpoint does."""
    optimizer = Muon(network, **SETTINGS)
    optimizer.load_state_dict(optimizer.state_dict())
    learn(network, optimizer, steps=1)
    other = copy.deepcopy(network)
    again = Muon(other, **SETTINGS)
    again.load_state_dict(copy.deepcopy(optimizer.state_dict()))
    learn(network, optimizer)
    learn(other, again)
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), other.parameters(), strict=True))
