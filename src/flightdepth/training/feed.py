"""A stage's batches, one after the other: made where they are learnt from, or ahead of time by worker processes, so
that a GPU need not wait for its processor.

Each worker has a stream of scenes of its own, and batch number b of a stage is worker b % workers's: what is learnt
follows from the seed and the number of workers, not from which of them is faster.
"""

from __future__ import annotations

import gc
import signal
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import count

import cv2
import torch
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from flightdepth.errors import FlightDepthError
from flightdepth.stillbox import PairStream
from flightdepth.training.freed_memory import keep_freed_memory
from flightdepth.training.inputs import TensorBatch
from flightdepth.training.recipe import Recipe

BATCHES_AHEAD = 3  # of each worker, while new scenes are rendered
WORKER_DIED = "DataLoader worker (pid"  # as torch tells it
START = "fork"  # so that workers see the textures, and compiled code, where they lie


@dataclass(frozen=True)
class Feed:
    """Batches of `size` pairs for `recipe`; `stream(n)` opens stream number n: one is enough without workers.

    `sweep_later` leaves the sweeps of a MotionNet to where it learns.
    """

    recipe: Recipe
    stream: Callable[[int], PairStream]
    size: int
    workers: int = 0
    sweep_later: bool = False

    @contextmanager
    def batches(self, first: int) -> Generator[Iterator[TensorBatch]]:
        """Batches number `first`, `first` + 1 ... without end; an error in making one surfaces when it is due."""
        if not self.workers:
            with self.stream(0) as stream:
                yield (self.made(stream, number) for number in count(first))
            return
        with closing(self._made_by_workers(first)) as made:
            try:
                yield made
            except RuntimeError as error:  # torch tells of a dead worker whatever is being done
                if not str(error).startswith(WORKER_DIED):
                    raise
                raise FlightDepthError(
                    "a process that makes pairs has died; the last checkpoint stands."
                    " If memory is short, try fewer --workers"
                ) from error

    def _made_by_workers(self, first: int) -> Generator[TensorBatch]:
        with warnings.catch_warnings():
            # A run goes on with the workers that it began with, on fewer cores too.
            warnings.filterwarnings("ignore", "This DataLoader will create", UserWarning)
            loader = DataLoader(
                _WorkersBatches(self, first),
                batch_size=None,
                num_workers=self.workers,
                prefetch_factor=BATCHES_AHEAD,
                pin_memory=torch.cuda.is_available(),
                worker_init_fn=_quiet_worker,
                multiprocessing_context=START,
            )
            with garbage_left_alone():
                batches = iter(loader)
        try:
            for made in batches:
                if isinstance(made, FlightDepthError):
                    raise made
                yield made
        finally:  # the workers end with it, whoever keeps the error and with it this frame
            del batches

    def made(self, stream: PairStream, number: int) -> TensorBatch:
        """Batch number `number` of a stream."""
        pairs = stream.batch(number * self.size, self.size)
        return TensorBatch.of(self.recipe, pairs, sweep_later=self.sweep_later)


@dataclass
class _WorkersBatches(IterableDataset[TensorBatch | FlightDepthError]):
    """What one worker makes: torch takes a batch of each in turn, the first worker's first."""

    feed: Feed
    first: int

    def __iter__(self) -> Iterator[TensorBatch | FlightDepthError]:
        worker, workers = get_worker_info(), self.feed.workers
        assert worker is not None
        begin = self.first + worker.id
        try:
            with self.feed.stream(begin % workers) as stream:
                for number in count(begin // workers):
                    yield self.feed.made(stream, number)
        except FlightDepthError as error:  # as it is: torch would make it a page of another
            yield error


@contextmanager
def garbage_left_alone() -> Generator[None]:
    """What this process has not collected yet, processes that are forked here never do: the threads that a decoder or a
    network's engine ends with are not there, and they would wait for them or crash."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _quiet_worker(_: int) -> None:
    """One thread; what stops a run, often all of its processes at once, is for the one that learns, which saves."""
    cv2.setNumThreads(0)
    keep_freed_memory()
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_IGN)
