"""Several flights, one after the other or on a Ray cluster; what stands is not done again."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain, count
from pathlib import Path
from typing import Literal, TypeAlias

from flightdepth.commands.terminal import report, say
from flightdepth.errors import FlightDepthError

CORES_PER_FLIGHT = 2


Engine: TypeAlias = Literal["local", "ray"]


class Outcome(StrEnum):
    """What came of a flight."""

    DONE = "done"
    EMPTY = "without any depth"
    STOOD = "finished before"
    STOOD_EMPTY = "finished before without any depth"
    FAILED = "failed"


@dataclass(frozen=True)
class Job:
    """One flight and the folder for its depth."""

    flight: Path
    target: Path

    def anywhere(self) -> Job:
        """The same, with paths that hold from any folder."""
        return Job(self.flight.absolute(), self.target.absolute())


Run = Callable[[Path, Path], Outcome]  # a flight, its folder
Attempt = Outcome | FlightDepthError


def named(flight: Path) -> Path:
    """The path that tells a flight's name: that of the folders . and .. too."""
    return Path(os.path.abspath(flight))  # noqa: PTH100  which keeps the name of a link


def jobs_of(flights: Sequence[Path], out: Path) -> list[Job]:
    """A folder in `out` for each flight, named after it; the second of a name gets -2, and so on.

    Names that differ by case are one: they would be one folder on Windows and macOS.
    """
    jobs: dict[str, Job] = {}
    for flight in flights:
        stem = named(flight).stem
        numbered = (f"{stem}-{number}" for number in count(2))
        name = next(name for name in chain([stem], numbered) if name.casefold() not in jobs)
        jobs[name.casefold()] = Job(flight, out / name)
    return list(jobs.values())


def run_jobs(jobs: Sequence[Job], run: Run, engine: Engine, address: str | None) -> int:
    """Run them all; one that fails is reported and does not stop the others. The worst exit code."""
    attempts = here(jobs, run) if engine == "local" else on_ray(jobs, run, address)
    outcomes: Counter[Outcome] = Counter()
    worst = 0
    for job, attempt in zip(jobs, attempts, strict=True):
        if isinstance(attempt, FlightDepthError):
            report(attempt)
            worst = max(worst, attempt.exit_code)
        outcomes[Outcome.FAILED if isinstance(attempt, FlightDepthError) else attempt] += 1
        if attempt in (Outcome.EMPTY, Outcome.STOOD_EMPTY):
            worst = max(worst, FlightDepthError.exit_code)
        if attempt in (Outcome.STOOD, Outcome.STOOD_EMPTY):
            say(f"{job.flight}: finished before, skipped; remove {job.target} to have it done again")
        elif attempt is Outcome.DONE and engine == "ray":
            say(f"{job.flight}: done, {job.target}")
    if len(jobs) > 1:
        counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
        say(f"{len(jobs)} flights: {counts}")
    return worst


def here(jobs: Sequence[Job], run: Run) -> Iterator[Attempt]:
    """One after the other on this machine."""
    for job in jobs:
        try:
            yield run(job.flight, job.target)
        except FlightDepthError as error:
            yield error
        except OSError as error:  # a file that may not be read, a disk that is full
            yield FlightDepthError(str(error))
        except Exception as error:  # a fault of ours: the other flights have nothing to do with it
            yield FlightDepthError(f"flight {job.flight}: {type(error).__name__}: {error}")


def on_ray(jobs: Sequence[Job], run: Run, address: str | None) -> Iterator[Attempt]:
    """On a cluster whose machines see the same files under the same paths."""
    import ray

    from flightdepth.cluster import ahead, cluster, failed

    with cluster(ray, address) as cores:
        task = ray.remote(num_cpus=min(CORES_PER_FLIGHT, cores))(_run)
        references = ahead(jobs, lambda job: task.remote(run, job.anywhere()), max(2, cores))
        for job, reference in zip(jobs, references, strict=True):
            try:
                yield ray.get(reference)
            except ray.exceptions.RayError as error:
                yield failed(f"flight {job.flight}", error)


def _run(run: Run, job: Job) -> Outcome:
    return run(job.flight, job.target)
