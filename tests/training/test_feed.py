"""Which batch comes when, of which stream; from one process or several."""

from __future__ import annotations

import gc
import os
import sys
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from training_runs import small_recipe

from flightdepth.camera import Camera
from flightdepth.errors import FlightDepthError
from flightdepth.stillbox import Batch
from flightdepth.stillbox.pairs import Pair
from flightdepth.training import loop
from flightdepth.training.feed import Feed

SIZE, BROKEN_AT = 3, 1000
CAMERA = Camera(64, 64, 32.0, 32.0, 31.5, 31.5)
BLANK = np.zeros((64, 64, 3), np.uint8)


class Numbered:
    """A stream whose targets, in metres, tell which stream and which pair of it they are: 207 is pair 7 of stream 2."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __enter__(self) -> Numbered:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def batch(self, start: int, size: int) -> Batch:
        if start >= BROKEN_AT:
            raise FlightDepthError("a texture is gone")
        targets = (np.full((64, 64), 100 * self.number + start + i, np.float32) for i in range(size))
        return Batch(tuple(Pair(BLANK, BLANK, target, np.array([0.3, 0, 0]), CAMERA) for target in targets))


def told(feed: Feed, first: int, count: int) -> list[list[int]]:
    """Stream and pair of all that is in some batches."""
    with feed.batches(first) as batches:
        return [[int(target[0, 0]) for target in batch.target_m] for batch in islice(batches, count)]


def several(workers: int) -> Feed:
    if sys.platform != loop.FORKING:
        pytest.skip("workers are forked")
    return Feed(small_recipe(), Numbered, SIZE, workers)


def test_one_process_takes_one_stream_from_the_batch_on_that_is_asked_for() -> None:
    assert told(Feed(small_recipe(), Numbered, SIZE), 5, 2) == [[15, 16, 17], [18, 19, 20]]


@pytest.mark.parametrize("first", [0, 5])
def test_a_batch_is_the_next_of_the_worker_whose_turn_it_is(first: int) -> None:
    """Number b of worker b % 2, of which it is number b // 2: wherever a run went on."""
    expected = [[100 * (b % 2) + SIZE * (b // 2) + i for i in range(SIZE)] for b in range(first, first + 5)]
    assert told(several(2), first, 5) == expected


class Engine:
    """Something whose end takes threads of the process that began it: elsewhere it is a crash."""

    def __init__(self) -> None:
        self.owner, self.itself = os.getpid(), self

    def __del__(self) -> None:
        if os.getpid() != self.owner:
            os.abort()


class Collecting(Numbered):
    def batch(self, start: int, size: int) -> Batch:
        gc.collect()
        return super().batch(start, size)


def test_workers_leave_the_garbage_of_their_parent_to_it() -> None:
    feed = replace(several(2), stream=Collecting)
    gc.disable()
    try:
        Engine()
        assert len(told(feed, 0, 4)) == 4
        assert gc.get_freeze_count() == 0
    finally:
        gc.enable()


def test_a_worker_s_error_is_told_as_it_is() -> None:
    with pytest.raises(FlightDepthError, match=r"^a texture is gone$"):
        told(several(2), 2 * BROKEN_AT, 1)


@pytest.mark.parametrize("later", [False, True])
def test_sweeps_are_made_where_they_are_wanted(later: bool) -> None:
    feed = Feed(
        small_recipe(architecture="MotionNet", reference_focal_px=32.0), Numbered, SIZE, sweep_later=later
    )
    with feed.batches(0) as batches:
        assert next(batches).unswept == later
