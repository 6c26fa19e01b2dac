"""Runs of a few steps, in this process and in others."""

from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import cv2
import torch
from accelerate.state import AcceleratorState

from flightdepth.scenes import Textures
from flightdepth.stillbox import PairStream
from flightdepth.training import Recipe, learner, loop
from flightdepth.training.feed import garbage_left_alone
from flightdepth.training.precision import Arithmetic

BATCH, STEPS = 4, 6  # two stages, four steps and two


def stage(name: str, steps: int) -> dict[str, Any]:
    picture = {"full_width": 64, "width": 64, "height": 64}
    return {"name": name, "samples": steps * BATCH, "batch": BATCH, "learning_rate": 1e-3} | picture


def small_recipe(**changes: Any) -> Recipe:
    """Two stages at 64 px of scenes with three frames, a network of a few thousand parameters."""
    facts: dict[str, Any] = {
        "name": "small",
        "base_width": 4,
        "activation": "elu+1",
        "nominal_shift": 3,
        "depth_min_m": 0.0,
        "depth_max_m": 100.0,
        "loss": "saturating-l1",
        "weight_decay": 1e-4,
        "ema_decay": 0.9,
        "warmup_samples": 8,
        "floor": 0.1,
        "seed": 1,
        "scenes": {"frames": 3},
        "stages": [stage("a", 4), stage("b", 2)],
    }
    return Recipe.model_validate(facts | changes)


def small_textures(seed: int = 1) -> Textures:
    return Textures.procedural(2, seed)


SMALL_POOL = 8  # scenes, instead of 192: nothing else of a stream depends on it
small_stream = partial(PairStream, pool_scenes=SMALL_POOL)


def small_pool(_: int) -> int:
    return SMALL_POOL


def beside(work: Callable[..., None], *arguments: Any) -> BaseProcess:
    """Begin it in a process of its own: a copy of this one, which has imported all that it needs; but a fresh one where
    there is a GPU, which no copy may use.
    """
    fresh = torch.accelerator.is_available()
    process = get_context("spawn" if fresh else "fork").Process(target=alone, args=(work, *arguments))
    with garbage_left_alone():
        process.start()
    return process


def alone(work: Callable[..., None], *arguments: Any) -> None:
    torch.set_num_threads(1)  # as in the other runs: the number of threads decides how sums are rounded
    cv2.setNumThreads(0)  # as in `feed`: a copy has none of the threads that this process had begun
    loop.pool_scenes = small_pool
    work(*arguments)


def killed_after(steps: int, folder: Path, computed_in: Arithmetic) -> None:
    """A run that kills itself. Two processes that time the processor may decide differently, so it is told."""
    learner.mixed_precision = lambda _=None: computed_in
    done = 0

    def kill_at_last(_: object) -> None:
        nonlocal done
        done += 1
        if done == steps:
            os.kill(os.getpid(), signal.SIGKILL)

    loop.train(
        small_recipe(), small_textures(), folder, resume=False, report=kill_at_last, checkpoint_every_s=0
    )


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def each_of_two(work: Callable[..., None], *arguments: Any) -> None:
    """It by two processes, which are told of each other as torchrun does on one machine."""
    port = free_port()
    running = [beside(as_one_of_two, rank, port, work, *arguments) for rank in range(2)]
    for process in running:
        process.join(timeout=900)
    assert [process.exitcode for process in running] == [0, 0]


def as_one_of_two(rank: int, port: int, work: Callable[..., None], *arguments: Any) -> None:
    given = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": 2, "LOCAL_WORLD_SIZE": 2}
    given |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    os.environ |= {key: str(value) for key, value in given.items()}
    AcceleratorState._reset_state(reset_partial_state=True)  # of the process that this is a copy of
    work(*arguments)


def learnt_by_several(folder: Path) -> None:
    """A run that writes down its losses."""
    learner.mixed_precision = lambda _=None: (
        "no"
    )  # which is faster is timed, and a busy machine may change its mind
    losses: list[float] = []
    loop.train(
        small_recipe(), small_textures(), folder, resume=True, report=lambda step: losses.append(step.loss_m)
    )
    (folder / f"losses-{os.environ['RANK']}.json").write_text(json.dumps(losses))
