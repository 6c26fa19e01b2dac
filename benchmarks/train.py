"""Training speed with rendering included and with data ready in memory: `python benchmarks/train.py [--json FILE]`.

Each round trains on as many pairs as one exchange of scenes in the pool pays for, first rendered as in a
real run on a CPU, then from batches that are ready; figures are medians over rounds, so both see the same machine.
"""

from __future__ import annotations

import argparse
import itertools
import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import torch

from flightdepth.evaluation.provenance import source_commit
from flightdepth.files import write_json
from flightdepth.machine import usable_cores
from flightdepth.processor import cpu_name
from flightdepth.renderers.raycast import VERSION
from flightdepth.scenes import Textures
from flightdepth.stillbox.stream import CHUNK
from flightdepth.training import Recipe, Stage, load_recipe
from flightdepth.training.feed import Feed
from flightdepth.training.freed_memory import keep_freed_memory
from flightdepth.training.inputs import TensorBatch
from flightdepth.training.learner import Learner
from flightdepth.training.loop import stage_stream

POOL_SCENES = 4 * CHUNK  # filled before the clock starts; scenes a pair do not depend on it
READY = 8  # batches kept in memory


def measured(recipe: Recipe, number: int, textures: Textures, rounds: int, threads: int) -> dict[str, float]:
    """Samples per second of stage `number`, both ways."""
    learner, stage = Learner(recipe), recipe.stages[number]
    learner.prepare()
    learner.begin(stage)
    drawn = stage_stream(recipe, number, 0, textures=textures, sets={}, threads=threads)
    per_round = math.lcm(CHUNK * recipe.pairs_per_scene, stage.batch)
    feed = Feed(
        recipe, lambda _: replace(drawn, pool_scenes=POOL_SCENES), stage.batch, sweep_later=learner.on_gpu
    )
    rates: dict[str, list[float]] = {"rendered": [], "ready": []}
    with feed.batches(0) as rendered:
        ready = itertools.cycle(list(itertools.islice(rendered, READY)))

        def rate(batches: Iterator[TensorBatch]) -> float:
            return per_round / seconds(lambda: train_on(learner, stage, batches, per_round))

        train_on(learner, stage, ready, 3 * stage.batch)
        for _ in range(rounds):
            rates["rendered"].append(rate(rendered))
            rates["ready"].append(rate(ready))
    found = {name: statistics.median(values) for name, values in rates.items()}
    return found | {"ratio": found["rendered"] / found["ready"]}


def train_on(learner: Learner, stage: Stage, batches: Iterator[TensorBatch], samples: int) -> None:
    for batch in itertools.islice(batches, samples // stage.batch):
        learner.step([batch], stage, stage.samples // 2)


def seconds(work: Callable[[], None]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recipes", nargs="+", default=["depthnet-256", "tiny-clamped-256"])
    parser.add_argument("--stages", nargs="+", default=["64", "256"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=usable_cores())
    parser.add_argument("--return-memory", action="store_true", help="as the C library does, not as `train`")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if not options.return_memory:
        keep_freed_memory()
    threads = options.threads
    torch.set_num_threads(threads)
    textures = Textures.procedural(32, 1)
    print(f"PyTorch {torch.__version__}, {VERSION}, {threads} cores of {cpu_name()}")
    print(f"{'recipe':18s} {'px':>4s}  {'rendered':>9s}  {'ready':>9s} samples/s  {'ratio':>6s}")
    rows = []
    for name in options.recipes:
        recipe = load_recipe(name)
        for number, stage in enumerate(recipe.stages):
            if stage.name not in options.stages:
                continue
            row = measured(recipe, number, textures, options.rounds, threads)
            print(
                f"{name:18s} {stage.width:4d}  {row['rendered']:9.1f}  {row['ready']:9.1f} {row['ratio']:17.1%}",
                flush=True,
            )
            rows.append({"recipe": name, "stage": stage.name, "batch": stage.batch} | row)
    if options.json:
        facts = {"cpu": cpu_name(), "threads": threads, "torch": torch.__version__, "renderer": VERSION}
        facts |= {"commit": source_commit(), "rounds": options.rounds}
        write_json(options.json, facts | {"rows": rows})


if __name__ == "__main__":
    main()
