"""Checkpoints: everything a run needs to go on as if it had not stopped, as safetensors, never a pickle."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn, optim

from flightdepth.errors import BadInput
from flightdepth.files import write_atomic
from flightdepth.training.precision import Arithmetic

_STATE = ("step", "exp_avg", "exp_avg_sq", "momentum_buffer")  # of AdamW and SGD, for each parameter


@dataclass(frozen=True)
class Progress:
    """Where a run stands: `sample` pairs of stage number `stage` are done, `seen` in all stages.

    `parts`: of each batch, an equal share of it each; 0 where none came. `workers`: processes that make a part's pairs,
    0 where it is made by the one that learns; each has a stream of scenes of its own.
    `precision`: what it is computed in; `flightdepth`, `torch`: the versions that wrote it; None in checkpoints from
    before they were kept.
    """

    recipe: str
    digest: str
    stage: int
    sample: int
    seen: int
    loss_m: float
    parts: int = 0
    precision: Arithmetic | None = None
    workers: int = 0
    flightdepth: str | None = None
    torch: str | None = None


def versions() -> dict[str, str]:
    """Of what trains here, by their names in `Progress`."""
    package = import_module("flightdepth")  # an import at the top would be of all that it gives a name to
    return {"flightdepth": package.__version__, "torch": str(torch.__version__)}


def save_checkpoint(
    path: Path, progress: Progress, network: nn.Module, averaged: nn.Module, optimizer: optim.Optimizer
) -> None:
    """Write atomically: a kill leaves the previous checkpoint or this one."""
    tensors = {f"network.{k}": v for k, v in network.state_dict().items()}
    tensors |= {f"averaged.{k}": v for k, v in averaged.state_dict().items()}
    for name, parameter in network.named_parameters():
        for key, value in optimizer.state.get(parameter, {}).items():
            tensors[f"optimizer.{name}.{key}"] = torch.as_tensor(value)
    contiguous = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
    write_atomic(path, save(contiguous, metadata={"progress": json.dumps(asdict(progress))}))


def read_progress(path: Path) -> Progress:
    """Where the run of a checkpoint stands.

    Raises:
        BadInput: the file is not a checkpoint of this package.
    """
    try:
        with safe_open(str(path), "pt") as file:
            return Progress(**json.loads(file.metadata()["progress"]))
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise BadInput(
            f"checkpoint {path}", expected="a checkpoint of flightdepth train", got=str(error)
        ) from error


def read_weights(path: Path, part: str) -> dict[str, Tensor]:
    """State dict of `part` ("network" or "averaged")."""
    with safe_open(str(path), "pt") as file:
        keys = [key for key in file.keys() if key.startswith(f"{part}.")]  # noqa: SIM118 (no mapping)
        return {key.removeprefix(f"{part}."): file.get_tensor(key) for key in keys}


def read_optimizer(path: Path, network: nn.Module, optimizer: optim.Optimizer) -> None:
    """Put the optimizer's state back, parameter by parameter."""
    with safe_open(str(path), "pt") as file:
        keys = set(file.keys())
        for name, parameter in network.named_parameters():
            stored = {s: key for s in _STATE if (key := f"optimizer.{name}.{s}") in keys}
            if stored:
                optimizer.state[parameter] = {
                    s: _laid_out_like(parameter, file.get_tensor(key)) for s, key in stored.items()
                }


def _laid_out_like(parameter: Tensor, value: Tensor) -> Tensor:
    """Moments with the parameter's memory layout: fused AdamW walks through both side by side."""
    return torch.empty_like(parameter).copy_(value) if value.shape == parameter.shape else value
