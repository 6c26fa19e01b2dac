import threading

import pytest

from flightdepth.outputs.background import MOST_WAITING, Background


def test_items_are_done_in_order():
    done: list[int] = []
    background = Background(done.append, name="test")
    for i in range(100):
        background.put(i)
    background.finish()
    assert done == list(range(100))


def test_what_the_task_gives_can_be_waited_for():
    background = Background(str, name="test")
    assert [background.put(i).result(10) for i in range(3)] == ["0", "1", "2"]
    background.finish()


def fail(item: int) -> None:
    raise OSError(f"disk full at {item}")


def test_finish_raises_what_the_task_raised():
    background = Background(fail, name="test")
    background.put(7)
    with pytest.raises(OSError, match="disk full at 7"):
        background.finish()


def test_put_raises_what_the_task_raised_instead_of_waiting_for_ever():
    background = Background(fail, name="test")
    with pytest.raises(OSError, match="disk full at 0"):
        for i in range(100):
            background.put(i)


def test_put_waits_while_the_queue_is_full():
    go, done = threading.Event(), []

    def task(item: int) -> None:
        go.wait(10)
        done.append(item)

    background = Background(task, name="test")
    background.put(0)
    timer = threading.Timer(0.3, go.set)
    timer.start()
    for i in range(1, MOST_WAITING + 1):
        background.put(i)
    assert not done
    background.put(MOST_WAITING + 1)  # had to wait for the first
    assert done[0] == 0
    background.finish()
    assert done == list(range(MOST_WAITING + 2))


def test_abandon_forgets_what_is_queued():
    started, go, done = threading.Event(), threading.Event(), []

    def task(item: int) -> None:
        started.set()
        go.wait(10)
        done.append(item)

    background = Background(task, name="test")
    background.put(0)
    started.wait(10)
    for i in range(1, MOST_WAITING + 1):
        background.put(i)
    threading.Timer(0.1, go.set).start()
    background.abandon()
    assert done == [0]


def test_nothing_was_put():
    Background(fail, name="test").finish()
