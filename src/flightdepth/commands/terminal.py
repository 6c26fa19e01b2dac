"""How commands speak: results and progress on stdout, warnings and errors on stderr, a line each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

if TYPE_CHECKING:
    from rich.table import Table

UNBOUNDED = 1000  # columns

Item_co = TypeVar("Item_co", covariant=True)


class Countable(Sized, Iterable[Item_co], Protocol[Item_co]):
    """What says how many it holds, and yields them."""


class Speed(ProgressColumn):
    """Steps a second, averaged over the last half minute by rich."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The column's text."""
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.1f} {self._unit}/s" if speed else "", style="progress.data.speed")


def say(text: str) -> None:
    """One line of result."""
    Console().print(text, soft_wrap=True, markup=False, highlight=False)


def show_table(table: Table) -> None:
    """A table, into a file or a pipe as wide as it is."""
    console = Console()
    Console(width=console.width if console.is_terminal else UNBOUNDED).print(table)


def warn(text: str) -> None:
    """One yellow line on stderr."""
    _to_stderr(f"warning: {text}", "yellow")


def report(error: Exception) -> None:
    """One red line on stderr, whatever the error's text holds."""
    _to_stderr(f"error: {' '.join(str(error).splitlines())}", "red")


@contextmanager
def progress_bar(title: str, total: int | None, unit: str) -> Iterator[Progress]:
    """A bar with `unit`/s and the time left; advance it with `bar.advance(bar.task_ids[0])`."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        Speed(unit),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console()) as bar:
        task = bar.add_task(title, total=total)
        yield bar
        if total is not None:  # what was promised and did not come is not waited for
            bar.update(task, total=bar.tasks[task].completed)


def counted(items: Countable[Item_co], title: str, unit: str) -> Iterator[Item_co]:
    """The items one by one, with a progress bar."""
    with progress_bar(title, len(items), unit) as bar:
        for item in items:
            yield item
            bar.advance(bar.task_ids[0])


def _to_stderr(text: str, style: str) -> None:
    console = Console(stderr=True)
    console.print(Text(text, style=style), soft_wrap=True)
