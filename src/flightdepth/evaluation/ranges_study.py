"""The multi-range study: every trial over every sequence, one file each, so that a stopped study goes on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from flightdepth import __version__
from flightdepth.errors import BadInput
from flightdepth.evaluation.pairs import SAME_FOCAL
from flightdepth.evaluation.provenance import source_commit
from flightdepth.evaluation.ranges_flight import MEASURED_FROM, fly
from flightdepth.evaluation.ranges_peers import FLOW_D0_M, FlowNetwork
from flightdepth.evaluation.ranges_sequences import KeptSequences, Sequence, Sequences
from flightdepth.evaluation.ranges_trials import CONSTANT, FLOW, Trial
from flightdepth.files import without_nan, write_json
from flightdepth.processor import cpu_name
from flightdepth.ranges import DepthNetwork
from flightdepth.runtimes.judge import judge_sha256
from flightdepth.runtimes.network import load_network, networks
from flightdepth.scenes import Textures
from flightdepth.stillbox.testset import test_textures
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import find_network, read_card

PARTS, PICTURES = "parts", "sequences"


@dataclass(frozen=True)
class Task:
    """A trial over sequence `number`, and the file that holds its result."""

    number: int
    trial: Trial
    path: Path


class Study:
    """`scenes` sequences, rendered once and kept in `folder`/sequences; results go to `folder`/parts.

    Networks run on one core, so that times can be compared. `textures` None takes those of the fixed test sets.
    """

    def __init__(
        self,
        folder: Path,
        scenes: int,
        sequences: Sequences,
        *,
        trials: tuple[Trial, ...],
        textures: Textures | None = None,
    ) -> None:
        if scenes < 1:
            raise BadInput("scenes of the study", expected="at least 1", got=str(scenes))
        if sequences.frames < MEASURED_FROM + 2:
            got = str(sequences.frames)
            raise BadInput("frames of a sequence", expected=f"at least {MEASURED_FROM + 2}", got=got)
        self.folder, self.scenes, self.sequences = folder, scenes, sequences
        self._wanted = trials
        self._opened: dict[str, DepthNetwork] = {}
        self._digest = "" if textures is None else textures.digest
        worn = test_textures if textures is None else lambda: textures
        self._kept = KeptSequences(folder / PICTURES, sequences, worn, self._digest)
        for name, card in self._cards.items():
            _refuse_unfit(name, card, sequences.focal_px)

    @property
    def missing(self) -> tuple[str, ...]:
        """Networks that trials ask for, and neither this build has nor a file holds."""
        wanted = dict.fromkeys(trial.method for trial in self._wanted)
        there = (FLOW, CONSTANT, *networks())
        return tuple(name for name in wanted if name not in there and not Path(name).is_file())

    @property
    def trials(self) -> tuple[Trial, ...]:
        """Those that can be flown, in the order they were asked for."""
        missing = self.missing
        return tuple(trial for trial in self._wanted if trial.method not in missing)

    @property
    def weights(self) -> dict[str, str]:
        """SHA-256 of the networks that fly, by name; of those that know the direction, with that of their judge."""
        return {
            name: f"{card.sha256}, aligned {judge_sha256()}" if card.knows_direction else card.sha256
            for name, card in self._cards.items()
        }

    @property
    def _cards(self) -> dict[str, NetworkCard]:
        names = dict.fromkeys(trial.method for trial in self.trials)
        return {name: read_card(find_network(name)) for name in names if name not in (FLOW, CONSTANT)}

    @cached_property
    def tasks(self) -> tuple[Task, ...]:
        """All there is to do, trial by trial, so that what comes first is whole when a study is stopped."""
        weights = self.weights
        told = self.sequences.facts | {"textures": self._digest}
        told |= {"flightdepth": __version__, "measured_from": MEASURED_FROM}  # other code measures anew
        weights[FLOW] = f"D0 {FLOW_D0_M} m"
        names = {
            trial: trial.digest(told | {"weights": weights.get(trial.method, "")}) for trial in self.trials
        }
        return tuple(
            Task(number, trial, self.folder / PARTS / f"{number:03d}_{name}.json")
            for trial, name in names.items()
            for number in range(self.scenes)
        )

    def __len__(self) -> int:
        return len(self.tasks)

    def __iter__(self) -> Iterator[Task]:
        """Do what is not done yet; yields each task once its result is on the disk."""
        (self.folder / PARTS).mkdir(parents=True, exist_ok=True)
        measured = {"commit": source_commit(), "machine": cpu_name()}
        for task in self.tasks:
            if not task.path.exists():
                part = {"sequence": task.number, "trial": task.trial.facts} | measured
                sequence = self._kept.get(task.number, task.trial.noise_rad)
                write_json(task.path, without_nan(part | self._fly(task.trial, sequence)))
            yield task

    def left(self) -> tuple[int, int]:
        """How many flights are still to do, and how many sequences to render for them."""
        tasks = [task for task in self.tasks if not task.path.exists()]
        pictures = {self._kept.path(task.number, task.trial.noise_rad) for task in tasks}
        return len(tasks), sum(not path.exists() for path in pictures)

    def parts(self) -> list[dict[str, Any]]:
        """The results, in the order of the tasks."""
        return [json.loads(task.path.read_text("utf-8")) for task in self.tasks]

    def _fly(self, trial: Trial, sequence: Sequence) -> dict[str, Any]:
        network = self._network(trial.method, sequence.camera.fx)
        runtime = getattr(network, "runtime", None)
        return fly(trial, network, sequence) | {"runtime": runtime.description if runtime else ""}

    def _network(self, method: str, focal_px: float) -> DepthNetwork | None:
        if method == CONSTANT:
            return None
        if method not in self._opened:
            flow = method == FLOW
            self._opened[method] = FlowNetwork(focal_px) if flow else load_network(method, threads=1)
        return self._opened[method]


def _refuse_unfit(name: str, card: NetworkCard, focal_px: float) -> None:
    """Maps are compared pixel by pixel with the truth, at a quarter of the pictures' size."""
    seen_px = min(card.focal_px, focal_px) if card.any_lens else card.focal_px
    if abs(seen_px / focal_px - 1) > SAME_FOCAL:
        raise BadInput(
            f"network {name}",
            expected=f"one that sees pictures of {focal_px:g} px of focal length as they are",
            got=f"one that sees them at {seen_px:g} px",
        )
