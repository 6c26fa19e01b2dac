"""What each choice of a recipe is worth: short runs at 64 px that differ from a base in one thing.

    python benchmarks/recipes.py [--samples 4000] [--width 16] [--scenes 300] [--only NAME ...] [--json FILE]

Every run sees as many pairs, drawn from the same scenes where the choice lets it; errors are of the averaged weights on
the fixed 64 px set, processor seconds those of training, rendering included. Stopped, it goes on where it was; what is
done is kept in --runs. One seed a run: differences of a few per cent are chance (--seeds 1 2 3 says by how much).
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.table import Table

from flightdepth.commands.table import opened
from flightdepth.evaluation.network import evaluate_network
from flightdepth.evaluation.network_tables import laid_out
from flightdepth.evaluation.provenance import source_commit
from flightdepth.evaluation.table import parameters, whole_set
from flightdepth.files import write_json
from flightdepth.processor import cpu_name
from flightdepth.scenes import Textures
from flightdepth.training import Recipe
from flightdepth.training.loop import train
from flightdepth.training.run_folder import CHECKPOINT, read_trained

BASE: dict[str, Any] = {
    "activation": "elu+1",
    "nominal_shift": 3,
    "depth_min_m": 0.0,
    "depth_max_m": 100.0,
    "loss": "saturating-l1",
    "weight_decay": 1e-4,
    "ema_decay": 0.99,
    "floor": 0.02,
}
STAGE: dict[str, Any] = {"name": "64", "full_width": 64, "width": 64, "height": 64, "batch": 32}
RATE = 2e-3

# Name -> (changes of the recipe, changes of its stage).
CHOICES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "base": ({}, {}),
    "learning rate 1e-3": ({}, {"learning_rate": 1e-3}),
    "learning rate 4e-3": ({}, {"learning_rate": 4e-3}),
    "batch 16": ({}, {"batch": 16}),
    "batch 64": ({}, {"batch": 64}),
    "SGD 0.01, constant": ({"optimizer": "sgd", "floor": 1.0}, {"learning_rate": 0.01}),
    "SGD 0.01, cosine": ({"optimizer": "sgd"}, {"learning_rate": 0.01}),
    "learning rate 8e-3": ({}, {"learning_rate": 8e-3}),
    "Muon 8e-3": ({"optimizer": "muon"}, {"learning_rate": 8e-3}),
    "Muon 16e-3": ({"optimizer": "muon"}, {"learning_rate": 16e-3}),
    "Muon 32e-3": ({"optimizer": "muon"}, {"learning_rate": 32e-3}),
    "Muon 16e-3, batch 16": ({"optimizer": "muon"}, {"learning_rate": 16e-3, "batch": 16}),
    "learning rate 4e-3, batch 16": ({}, {"learning_rate": 4e-3, "batch": 16}),
    "constant learning rate": ({"floor": 1.0}, {}),
    "no average of weights": ({"ema_decay": 0.0}, {}),
    "batch norm momentum 0.01": ({"batch_norm_momentum": 0.01}, {}),
    "LeakyReLU 0.1": ({"leaky_slope": 0.1}, {}),
    "no activation of depth": ({"activation": "none"}, {}),
    "loss in inverse depth": ({"loss_space": "inverse-depth"}, {}),
    "plain L1 at the clip": ({"loss": "l1"}, {}),
    "forward pairs only": ({"backward_pairs": False}, {}),
    "no still pairs": ({"still_pairs": False}, {}),
    "10 pairs a scene": ({"pairs_per_scene": 10}, {}),
    "160 pairs a scene": ({"pairs_per_scene": 160}, {}),
    "FlowNetS": ({"architecture": "FlowNetS"}, {"learning_rate": 5e-4}),
    "FlowNetS, Muon 2e-3": ({"architecture": "FlowNetS", "optimizer": "muon"}, {"learning_rate": 2e-3}),
    "FlowNetS, Muon 6e-3": ({"architecture": "FlowNetS", "optimizer": "muon"}, {"learning_rate": 6e-3}),
}


def recipe_of(choice: str, samples: int, width: int, seed: int) -> Recipe:
    """The base with one thing changed; FlowNetS has twice the width, as in the paper."""
    changes, stage_changes = CHOICES[choice]
    stage = STAGE | {"samples": samples, "learning_rate": RATE} | stage_changes
    facts = {
        "name": choice,
        "base_width": width,
        "seed": seed,
        "warmup_samples": samples // 20,
        "stages": [stage],
    }
    if choice.startswith("FlowNetS"):
        facts["base_width"] = 2 * width
    return Recipe.model_validate(BASE | facts | changes)


def measured(recipe: Recipe, folder: Path, textures: Textures, scenes: int) -> dict[str, Any]:
    """Train, or go on, then measure."""
    fresh, began = not (folder / CHECKPOINT).exists(), time.process_time()
    checkpoint = train(recipe, textures, folder, resume=True, threads=torch.get_num_threads())
    seconds = time.process_time() - began
    trained = read_trained(checkpoint.parent / "64.safetensors")
    network = opened(trained, recipe.name)
    tests = whole_set(network.card, scenes)
    result = evaluate_network(network, tests, set_name="fixed", seed=tests.seed)
    return {
        "samples": trained.progress.seen,
        "parameters": parameters(recipe.architecture, recipe.base_width),
        "train_loss_m": trained.progress.loss_m,
        "processor_s": round(seconds, 1) if fresh else None,  # of a run that went on, only a part is known
        **{name: result["network"][name] for name in ("l1_m", "rmse_m", "abs_rel")},
        **{f"{peer}_l1_m": result[peer]["l1_m"] for peer in ("constant", "classical")},
        "weights_sha256": network.card.sha256,
        "commit": source_commit(),
    }


def kept_or_measured(recipe: Recipe, folder: Path, textures: Textures, scenes: int) -> dict[str, Any]:
    """What an earlier call measured of the same recipe, or what is measured now."""
    path = folder / "figures.json"
    key = {"digest": recipe.digest, "scenes": scenes, "seed": recipe.seed}
    before: dict[str, Any] = json.loads(path.read_bytes()) if path.exists() else {}
    if {name: before.get(name) for name in key} == key:
        return before
    found = key | measured(recipe, folder, textures, scenes)
    write_json(path, found)
    return found


def table(rows: Sequence[dict[str, Any]], title: str) -> Table:
    base = next((row for row in rows if row["choice"] == "base"), rows[0])
    headings = ("one change", "L1 m", "of the base's", "RMSE m", "abs rel", "processor s")
    shown = laid_out(title, headings, (), names="one change")
    for row in rows:
        l1_m = statistics.mean(run["l1_m"] for run in row["runs"])
        of_base = l1_m / statistics.mean(run["l1_m"] for run in base["runs"])
        cells = [statistics.mean(run[key] for run in row["runs"]) for key in ("rmse_m", "abs_rel")]
        took = [run["processor_s"] for run in row["runs"] if run["processor_s"] is not None]
        spread = (
            "" if len(row["runs"]) == 1 else f" ±{statistics.stdev(run['l1_m'] for run in row['runs']):.2f}"
        )
        figures = (f"{cells[0]:.2f}", f"{cells[1]:.3f}", f"{statistics.mean(took):.0f}" if took else "-")
        shown.add_row(row["choice"], f"{l1_m:.2f}{spread}", f"{of_base:.3f}", *figures)
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=4000)
    parser.add_argument("--width", type=int, default=16)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument(
        "--only",
        metavar="NAME",
        help=", ".join(CHOICES),
        nargs="+",
        choices=list(CHOICES),
        default=list(CHOICES),
    )
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--runs", type=Path, default=Path("runs/recipes"))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    textures, rows = Textures.procedural(200, 1), []
    title = f"{options.samples:,} pairs at 64 px, width {options.width}, {options.scenes} test scenes"
    for choice in options.only:
        runs = []
        for seed in options.seeds:
            recipe = recipe_of(choice, options.samples, options.width, seed)
            folder = options.runs / f"{choice.replace(' ', '-').replace(',', '')}-{options.samples}-{seed}"
            runs.append(kept_or_measured(recipe, folder, textures, options.scenes))
            print(f"{choice}, seed {seed}: L1 {runs[-1]['l1_m']:.2f} m", flush=True)
        rows.append({"choice": choice, "runs": runs})
        if options.json:
            facts = {"commit": source_commit(), "cpu": cpu_name(), "torch": torch.__version__}
            write_json(
                options.json, facts | {"samples": options.samples, "width": options.width, "rows": rows}
            )
    Console().print(table(rows, title))


if __name__ == "__main__":
    main()
