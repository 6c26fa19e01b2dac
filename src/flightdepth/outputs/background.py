"""Work that a thread does behind the frame loop, in order, never more than two items behind."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, ParamSpec, TypeVar

# An item holds a frame with all its maps, 190 MB at 4K. Measured there: four that wait bring no speed, and 560 MB more.
MOST_WAITING = 1
P = ParamSpec("P")
T = TypeVar("T")


class Background(Generic[P, T]):
    """Calls `task` on one thread. What it raises is raised by the next `put` or by `finish`."""

    def __init__(self, task: Callable[P, T], *, name: str) -> None:
        self._task = task
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._calls: deque[Future[T]] = deque()  # the oldest may be in work, the others wait

    def put(self, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Queue one call, whose result comes later; waits while MOST_WAITING others do."""
        while self._calls and (self._calls[0].done() or len(self._calls) > MOST_WAITING):
            self._calls.popleft().result()
        call = self._thread.submit(self._task, *args, **kwargs)
        self._calls.append(call)
        return call

    def finish(self) -> None:
        """Wait until every call is done."""
        for call in self._calls:
            call.result()
        self._thread.shutdown()

    def abandon(self) -> None:
        """Forget what is queued; waits for the call in work."""
        self._thread.shutdown(cancel_futures=True)
