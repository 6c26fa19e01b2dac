"""Stamps that jump cost themselves, and nothing after them."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.flight.order import rising


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
