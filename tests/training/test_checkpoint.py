"""Checkpoints: all of a run's state and back; what is not one is refused; a crash leaves the old one."""

import math
import pickle
from pathlib import Path

import pytest
import torch
from training_runs import small_recipe

from flightdepth.architectures import DepthNet
from flightdepth.errors import BadInput
from flightdepth.training.checkpoint import (
    Progress,
    read_optimizer,
    read_progress,
    read_weights,
    save_checkpoint,
)
from flightdepth.training.learner import optimizer_of

PROGRESS = Progress("small", "0123456789abcdef", 1, 640, 1280, 3.5)


def trained(seed, optimizer="adamw"):
    """A network, an average and an optimizer after two steps, in the memory layout that training uses."""
    torch.manual_seed(seed)
    network, averaged = (DepthNet(2).to(memory_format=torch.channels_last) for _ in range(2))
    optimizer = optimizer_of(small_recipe(), network, optimizer)
    for group in optimizer.param_groups:
        group["lr"] = 1e-3
    for _ in range(2):
        network(torch.randn(2, 6, 64, 64))[0].sum().backward()
        optimizer.step()
    return network, averaged, optimizer


@pytest.fixture
def saved(tmp_path):
    state = trained(1)
    save_checkpoint(tmp_path / "c.safetensors", PROGRESS, *state)
    return tmp_path / "c.safetensors", state


def test_progress_comes_back(saved):
    assert read_progress(saved[0]) == PROGRESS


def test_progress_without_a_loss_comes_back(tmp_path):
    save_checkpoint(tmp_path / "c", Progress("small", "0", 0, 0, 0, math.nan), *trained(1))
    assert math.isnan(read_progress(tmp_path / "c").loss_m)


@pytest.mark.parametrize(("part", "index"), [("network", 0), ("averaged", 1)])
def test_weights_come_back(saved, part, index):
    path, state = saved
    found, expected = read_weights(path, part), state[index].state_dict()
    assert found.keys() == expected.keys()
    assert all(torch.equal(found[key], expected[key]) for key in expected)


@pytest.mark.parametrize("kind", ["adamw", "sgd"])
def test_the_optimizer_comes_back(tmp_path, kind):
    network, averaged, optimizer = trained(1, kind)
    save_checkpoint(tmp_path / "c", PROGRESS, network, averaged, optimizer)
    other, _, fresh = trained(2, kind)
    read_optimizer(tmp_path / "c", other, fresh)
    for mine, theirs in zip(network.parameters(), other.parameters(), strict=True):
        before, after = optimizer.state[mine], fresh.state[theirs]
        assert before.keys() == after.keys() != set()
        assert all(torch.equal(before[key], after[key]) for key in before)


def test_moments_get_the_layout_of_their_parameter(saved):
    """Fused AdamW walks through memory: moments laid out in another order would reach the wrong weights."""
    network, _, optimizer = trained(2)
    read_optimizer(saved[0], network, optimizer)
    for parameter in network.parameters():
        assert optimizer.state[parameter]["exp_avg"].stride() == parameter.stride()


@pytest.mark.parametrize("size", [0, 1, 7, 8, 100, 5000, -1])
def test_a_cut_file_is_refused(saved, size):
    path, _ = saved
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(BadInput, match="a checkpoint of flightdepth train"):
        read_progress(path)


def test_trash_is_refused(saved):
    path, _ = saved
    trash = torch.randint(0, 256, (4096,), generator=torch.Generator().manual_seed(5), dtype=torch.uint8)
    path.write_bytes(bytes(trash.tolist()))
    with pytest.raises(BadInput):
        read_progress(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        read_progress(tmp_path / "none.safetensors")


def test_a_safetensors_file_of_somebody_else_is_refused(tmp_path):
    from safetensors.torch import save_file

    save_file({"weight": torch.zeros(1)}, str(tmp_path / "other.safetensors"))
    with pytest.raises(BadInput, match="a checkpoint of flightdepth train"):
        read_progress(tmp_path / "other.safetensors")


class Trap:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


def test_a_pickle_is_refused_unopened(tmp_path):
    path, mark = tmp_path / "c.safetensors", tmp_path / "opened"
    path.write_bytes(pickle.dumps(Trap(mark)))
    with pytest.raises(BadInput):
        read_progress(path)
    assert not mark.exists()


@pytest.mark.parametrize("moment", ["flightdepth.files.os.fsync", "flightdepth.files.Path.replace"])
def test_a_crash_while_writing_leaves_the_old_one(saved, monkeypatch, moment):
    path, state = saved
    before = path.read_bytes()

    def crash(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(moment, crash)
    with pytest.raises(KeyboardInterrupt):
        save_checkpoint(path, Progress("small", "0", 9, 9, 9, 0.0), *state)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]
