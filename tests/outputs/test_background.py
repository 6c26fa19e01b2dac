import threading

import pytest

from flightdepth.outputs.background import Background


def test_items_are_done_in_order():
    done: list[int] = []
    background = Background(done.append, name="test", length=2)
    for i in range(100):
        background.put(i)
    background.finish()
    assert done == list(range(100))


def fail(item: int) -> None:
    raise OSError(f"disk full at {item}")


def test_finish_raises_what_the_task_raised():
    background = Background(fail, name="test")
    background.put(7)
    with pytest.raises(OSError, match="disk full at 7"):
        background.finish()


def test_put_raises_what_the_task_raised_instead_of_waiting_for_ever():
    background = Background(fail, name="test", length=1)
    with pytest.raises(OSError, match="disk full at 0"):
        for i in range(100):
            background.put(i)


def test_put_waits_while_the_queue_is_full():
    go, done = threading.Event(), []

    def task(item: int) -> None:
        go.wait(10)
        done.append(item)

    background = Background(task, name="test", length=1)
    background.put(0)
    timer = threading.Timer(0.3, go.set)
    timer.start()
    background.put(1)
    background.put(2)  # one in work, one queued: this one had to wait for the first
    assert done[0] == 0
    background.finish()
    assert done == [0, 1, 2]


def test_abandon_forgets_what_is_queued():
    started, go, done = threading.Event(), threading.Event(), []

    def task(item: int) -> None:
        started.set()
        go.wait(10)
        done.append(item)

    background = Background(task, name="test", length=8)
    for i in range(5):
        background.put(i)
    started.wait(10)
    threading.Timer(0.1, go.set).start()
    background.abandon()
    assert len(done) < 5


def test_nothing_was_put():
    Background(fail, name="test").finish()
