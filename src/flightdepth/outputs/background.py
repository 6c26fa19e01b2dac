"""Work that a thread does behind the frame loop, in order, never more than a few items behind."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

WAIT_S = 0.2  # between two looks at whether the other side still lives
T = TypeVar("T")


class Background(Generic[T]):
    """Hands items to `task` on one thread. What `task` raises is raised by the next `put` or by `finish`."""

    def __init__(self, task: Callable[[T], None], *, name: str, length: int = 4) -> None:
        self._task = task
        self._items: queue.Queue[tuple[T] | None] = queue.Queue(maxsize=length)  # None = the end
        self._abandoned = threading.Event()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def put(self, item: T) -> None:
        """Queue one item; waits while the queue is full."""
        self._offer((item,))

    def finish(self) -> None:
        """Wait until every item is done."""
        self._offer(None)
        self._thread.join()
        self._raise()

    def abandon(self) -> None:
        """Forget what is queued; waits for the item in work."""
        self._abandoned.set()
        self._thread.join()

    def _offer(self, entry: tuple[T] | None) -> None:
        while True:
            self._raise()
            try:
                self._items.put(entry, timeout=WAIT_S)
                return
            except queue.Full:
                continue

    def _work(self) -> None:
        while not self._abandoned.is_set():
            try:
                entry = self._items.get(timeout=WAIT_S)
            except queue.Empty:
                continue
            if entry is None:
                return
            try:
                self._task(entry[0])
            except BaseException as error:  # carried to the owner, who raises it
                self._error = error
                return

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error
