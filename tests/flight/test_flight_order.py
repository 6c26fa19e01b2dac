"""Stamps that jump cost themselves, and nothing after them."""

import itertools
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.flight.order import AHEAD, LONG_NS, rising, with_jumps


def kept(*stamps: int) -> list[int]:
    return [stamps[index] for index in rising(stamps)]


@given(st.lists(st.integers(0, 100)))
def test_what_is_kept_rises_and_is_all_of_what_rises_already(stamps: list[int]) -> None:
    found = kept(*stamps)
    assert all(a < b for a, b in itertools.pairwise(found))
    assert kept(*sorted(set(stamps))) == sorted(set(stamps))


@pytest.mark.parametrize("damaged", [(1000,), (1000, 1001), (1000, 5000, 1002)])
@pytest.mark.parametrize("place", [0, 1, 10, 28])
def test_damaged_stamps_far_ahead_cost_themselves(damaged: tuple[int, ...], place: int) -> None:
    whole = list(range(40))
    assert kept(*whole[:place], *damaged, *whole[place:]) == whole


@pytest.mark.parametrize("place", [1, 10, 40])
def test_damaged_stamps_in_the_past_cost_themselves(place: int) -> None:
    whole = list(range(100, 140))
    assert kept(*whole[:place], 3, 4, *whole[place:]) == whole


def test_one_that_comes_late_costs_one() -> None:
    assert kept(10, 20, 30, 50, 60, 70, 40, 80, 90) == [10, 20, 30, 50, 60, 70, 80, 90]


def test_a_log_that_begins_again_keeps_its_first_part() -> None:
    assert kept(*range(50), *range(50)) == list(range(50))


def streamed(stamps: list[int]) -> list[int]:
    """What is kept of stamps that come one by one."""
    found: list[int] = []
    for stamp, _, jumps in with_jumps((stamp, None) for stamp in stamps):
        if not jumps and (not found or stamp > found[-1]):
            found.append(stamp)
    return found


@pytest.mark.parametrize("damaged", [(1000,), (1000, 1001), (1000, 5000, 1002)])
@pytest.mark.parametrize("place", [1, 10, 28])
def test_one_by_one_stamps_far_ahead_cost_themselves_too(damaged: tuple[int, ...], place: int) -> None:
    whole = [LONG_NS // 10 * index for index in range(40)]
    ahead = [LONG_NS * each for each in damaged]
    assert streamed([*whole[:place], *ahead, *whole[place:]]) == whole


@given(st.lists(st.integers(0, 10), min_size=1))
def test_one_by_one_what_rises_is_kept_whatever_the_gaps(steps: list[int]) -> None:
    rises = [LONG_NS * stamp for stamp in itertools.accumulate(steps, lambda a, b: a + b + 1)]
    assert streamed(rises) == rises


def test_only_behind_a_gap_is_anything_held_back() -> None:
    asked: list[int] = []

    def stamps() -> Iterator[tuple[int, None]]:
        for stamp in (0, 1, 2, 100, *range(101, 120)):
            asked.append(stamp)
            yield LONG_NS * stamp // 10, None

    given = [(stamp * 10 // LONG_NS, len(asked)) for stamp, _, _ in with_jumps(stamps())]
    assert given[:3] == [(0, 1), (1, 2), (2, 3)]
    assert given[3] == (100, 4 + AHEAD)
    assert given[-1] == (119, len(asked))
