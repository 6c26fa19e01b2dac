"""The exponential mean of weights."""

import copy

import torch
from torch import nn

from flightdepth.training.averaging import MovingAverage


def pair(decay):
    network = nn.BatchNorm1d(1)
    averaged = copy.deepcopy(network)
    return network, averaged, MovingAverage(network, averaged, decay)


def test_it_moves_by_what_the_decay_leaves():
    network, averaged, average = pair(0.75)
    nn.init.constant_(network.weight, 5.0)
    average.update(10**6)
    assert averaged.weight.item() == 1 + 0.25 * 4


def test_its_memory_is_short_in_the_beginning():
    network, averaged, average = pair(0.998)
    nn.init.constant_(network.weight, 11.0)
    average.update(0)
    assert torch.isclose(averaged.weight, torch.tensor([1 + 0.9 * 10])).all()


def test_batch_statistics_are_averaged_too():
    network, averaged, average = pair(0.5)
    network.running_mean += 4
    average.update(10**6)
    assert averaged.running_mean.item() == 2


def test_equal_weights_stay():
    network, averaged, average = pair(0.5)
    average.update(3)
    assert torch.equal(averaged.weight, network.weight)
