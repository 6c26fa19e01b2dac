"""What ends a command from outside: Ctrl-C, SIGTERM (service managers, batch systems), SIGHUP (a lost terminal)."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from flightdepth.commands.terminal import mention

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def stop_request(told: str | None = None, *, insist: bool = True) -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM and SIGHUP set, so that what is under way is finished; from the main thread only.

    told    a line to say then
    insist  whether a second one ends at once, by KeyboardInterrupt; else it says no more than the first
    """
    stop = threading.Event()

    def request(*_: object) -> None:
        if stop.is_set():
            if insist:
                raise KeyboardInterrupt
            return
        stop.set()
        if told is not None:
            mention(told)

    with _handled(request, signal.SIGINT, signal.SIGTERM):
        yield stop


_interrupted, _heeded = threading.Event(), threading.Event()


@contextmanager
def stopped_as_by_ctrl_c() -> Iterator[None]:
    """SIGTERM and SIGHUP raise KeyboardInterrupt too, so what was begun is cleared away; from the main thread only.

    Python drops what is raised within a destructor or a callback from C; `heed_interrupt` raises it again.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        waits = _heeded.is_set() and not _interrupted.is_set()
        _interrupted.set()
        if not waits:
            signal.default_int_handler(number, frame)

    _interrupted.clear()
    # A script's `&` has Ctrl-C ignored.
    ctrl_c = [signal.SIGINT] if signal.getsignal(signal.SIGINT) is signal.default_int_handler else []
    with _handled(interrupt, signal.SIGTERM, *ctrl_c):
        yield


def heed_interrupt() -> None:
    """Raise KeyboardInterrupt where one came within the last `stopped_as_by_ctrl_c`; to be called again and again."""
    if _interrupted.is_set():
        raise KeyboardInterrupt


@contextmanager
def interrupts_heeded() -> Iterator[None]:
    """Within, an interrupt waits for `heed_interrupt`, or for the end; a second one does not.

    What is raised in the midst of C may end the process: where arguments fit only a function's second form, OpenCV asks
    for the first one's error as text, and takes for granted that Python gives it, which raises the interrupt instead.
    """
    _heeded.set()
    try:
        yield
    finally:
        _heeded.clear()
    heed_interrupt()


@contextmanager
def _handled(handler: Handler, *numbers: int) -> Iterator[None]:
    """`handler` for these signals and for SIGHUP where there is one; the handlers before it come back."""
    lost = getattr(signal, "SIGHUP", None)  # not on Windows
    if lost is not None and signal.getsignal(lost) is not signal.SIG_IGN:  # as under nohup
        numbers = (*numbers, lost)
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, each in before.items():
            signal.signal(number, each)
