"""How commands speak: results and progress on stdout, warnings and errors on stderr, a line each."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar

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
from rich.table import Column
from rich.text import Text

if TYPE_CHECKING:
    from rich.table import Table

UNBOUNDED = 1000  # columns
TOLD_EVERY_S = 30.0  # of a bar that no terminal shows

Item = TypeVar("Item")


class Speed(ProgressColumn):
    """Steps a second, averaged over the last half minute by rich."""

    def __init__(self, unit: str) -> None:
        super().__init__(_whole())
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The column's text."""
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.1f} {self._unit}/s" if speed else "", style="progress.data.speed")


class ToldProgress(Progress):
    """A bar for one task; where there is no terminal to draw it on, a line now and then."""

    def __init__(self, *columns: ProgressColumn, unit: str) -> None:
        super().__init__(*columns, console=Console())
        self._unit = unit
        self._began: tuple[float, float] | None = None  # when the first step was done, and how many were then
        self._told_s = time.monotonic()

    def step(self, steps: float = 1) -> None:
        """One more is done, or several."""
        self.advance(self.task_ids[0], steps)
        self._tell(self.tasks[0])

    def reach(self, completed: float, description: str) -> None:
        """So much is done by now, and what is under way."""
        self.update(self.task_ids[0], completed=completed, description=description)
        self._tell(self.tasks[0])

    def begin_at(self, completed: float, total: float) -> None:
        """Go on with what was begun earlier; rich would take an update to there for speed."""
        self.reset(self.task_ids[0], total=total, completed=int(completed))
        self._began = time.monotonic(), completed

    def _tell(self, task: Task) -> None:
        now_s = time.monotonic()
        if self._began is None:  # what came before the first step says nothing of the others
            self._began = now_s, task.completed
            return
        if self.console.is_terminal or now_s < self._told_s + TOLD_EVERY_S:
            return
        self._told_s = now_s
        began_s, first = self._began
        rate = (task.completed - first) / max(now_s - began_s, 1e-9)
        of = "" if task.total is None else f" of {task.total:,.0f}"
        line = f"{task.description}: {task.completed:,.0f}{of} {self._unit}, {rate:.1f} {self._unit}/s"
        if task.total is not None and rate > 0:
            left_min = (task.total - task.completed) / rate / 60
            line += f", {left_min:.0f} min left" if left_min >= 1 else ", less than 1 min left"
        say(line)


def print_any_name() -> None:
    """What stdout's encoding lacks comes out as escapes, as stderr's does: a file or a pipe has no UTF-8 on Windows,
    where a name in Greek ended the command.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """One line of result."""
    Console().print(text, soft_wrap=True, markup=False, highlight=False, emoji=False)


def mention(text: str) -> None:
    """One line that nobody need read: no reason to stop where the terminal is gone, or the disk of a log is full."""
    with suppress(OSError, SystemExit):
        say(text)


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
def progress_bar(title: str, total: int | None, unit: str) -> Iterator[ToldProgress]:
    """A bar with `unit`/s and the time left, or lines of it; call its `step` for each."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(table_column=_whole()),
        Speed(unit),
        TimeRemainingColumn(),
    )
    with ToldProgress(*columns, unit=unit) as bar:
        task = bar.add_task(title, total=total)
        yield bar
        if total is not None and not bar.finished:  # what was promised and did not come is not waited for
            bar.update(task, total=bar.tasks[task].completed)


def _whole() -> Column:
    """A column of figures: where a terminal is narrow the bar gives way, not they."""
    return Column(no_wrap=True)


def counted(items: Iterable[Item], title: str, unit: str, *, total: int | None = None) -> Iterator[Item]:
    """The items one by one, with a progress bar; `total` where they do not say how many they are."""
    with progress_bar(title, len(items) if isinstance(items, Sized) else total, unit) as bar:
        for item in items:
            yield item
            bar.step()


def _to_stderr(text: str, style: str) -> None:
    console = Console(stderr=True)
    console.print(Text(text, style=style), soft_wrap=True)
