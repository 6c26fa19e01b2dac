"""Runs of a few steps. As a script, a run that kills itself: python training_runs.py FOLDER STEPS PRECISION; or, of
several processes, one that writes down its losses: python training_runs.py FOLDER.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

import torch

from flightdepth.scenes import Textures
from flightdepth.stillbox import PairStream
from flightdepth.training import Recipe, learner, loop

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


def main() -> None:
    folder, *rest = sys.argv[1:]
    torch.set_num_threads(1)  # as in the other runs: the number of threads decides how sums are rounded
    loop.pool_scenes = small_pool
    if rest:
        steps, computed_in = rest  # two processes that time the processor may decide differently
        learner.mixed_precision = lambda _=None: computed_in  # type: ignore[assignment, return-value]
        killed_after(int(steps), Path(folder))
    else:
        one_of_several(Path(folder))


def killed_after(steps: int, folder: Path) -> None:
    done = 0

    def kill_at_last(_: object) -> None:
        nonlocal done
        done += 1
        if done == steps:
            os.kill(os.getpid(), signal.SIGKILL)

    loop.train(
        small_recipe(), small_textures(), folder, resume=False, report=kill_at_last, checkpoint_every_s=0
    )


def one_of_several(folder: Path) -> None:
    learner.mixed_precision = lambda _: (
        "no"
    )  # which is faster is timed, and a busy machine may change its mind
    losses: list[float] = []
    loop.train(
        small_recipe(), small_textures(), folder, resume=True, report=lambda step: losses.append(step.loss_m)
    )
    (folder / f"losses-{os.environ['RANK']}.json").write_text(json.dumps(losses))


if __name__ == "__main__":
    main()
