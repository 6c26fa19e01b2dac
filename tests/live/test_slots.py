"""Slots keep the newest; a sink that fails, hangs or dawdles costs the engine nothing."""

import threading

from live_peers import lasts_s, until

from flightdepth.live.slots import Newest, SinkThread

PATIENCE_S = 10.0


def test_only_the_newest_is_taken_and_the_others_counted():
    slot = Newest()
    for i in range(5):
        slot.put(i)
    assert slot.take(0) == 4
    assert slot.take(0) is None
    assert slot.replaced == 4


def test_what_is_false_is_an_item_too():
    slot = Newest()
    slot.put(0)
    assert slot.take(0) == 0


def test_taking_waits_for_the_next():
    slot = Newest()
    threading.Timer(0.05, slot.put, ["late"]).start()
    assert slot.take(PATIENCE_S) == "late"


def test_nothing_is_lost_uncounted_between_threads():
    slot, taken, over = Newest(), [], threading.Event()

    def take():
        while not over.is_set():
            item = slot.take(0.001)
            if item is not None:
                taken.append(item)

    thread = threading.Thread(target=take)
    thread.start()
    for i in range(3000):
        slot.put(i)
    until(lambda: taken and taken[-1] == 2999)
    over.set()
    thread.join()
    assert taken == sorted(taken)
    assert len(taken) + slot.replaced == 3000


def test_a_sink_that_always_fails_is_told_once_and_counted():
    told = []

    def broken(result):
        raise RuntimeError(f"no disk for {result}")

    sink = SinkThread("disk", broken, lambda name, error: told.append((name, str(error))))
    for i in range(3):
        sink.put(i)
        until(lambda n=i: sink.counts.failed == n + 1)
    sink.close()
    assert told == [("disk", "no disk for 0")]
    assert (sink.counts.taken, sink.counts.failed) == (0, 3)


def test_each_result_is_taken_missed_or_failed_on():
    """Found in review: those that failed counted as taken, too."""

    def choosy(result):
        if result % 2:
            raise ValueError(result)

    sink = SinkThread("page", choosy, lambda name, error: None)
    for i in range(5):
        sink.put(i)
        until(lambda n=i: sink.counts.taken + sink.counts.failed == n + 1)
    sink.close()
    assert (sink.counts.taken, sink.counts.missed, sink.counts.failed) == (3, 0, 2)


def test_a_slow_sink_gets_the_newest_and_its_misses_are_counted():
    hold, seen = threading.Event(), []

    def slow(result):
        seen.append(result)
        hold.wait(PATIENCE_S)

    sink = SinkThread("page", slow, lambda name, error: None)
    sink.put(0)
    until(lambda: seen == [0])

    def put_many():
        for i in range(1, 1000):
            sink.put(i)

    assert lasts_s(put_many) < 1.0
    hold.set()
    until(lambda: seen == [0, 999])
    sink.close()
    assert sink.counts.missed == 998


def test_a_hanging_sink_is_left_behind():
    hold = threading.Event()
    sink = SinkThread("link", lambda result: hold.wait(PATIENCE_S), lambda name, error: None)
    sink.put(1)
    assert lasts_s(sink.close) < 4
    hold.set()


def test_the_last_result_is_written_before_a_sink_is_closed():
    begun, hold, seen = threading.Event(), threading.Event(), []

    def slow(result):
        begun.set()
        hold.wait(PATIENCE_S)
        seen.append(result)

    sink = SinkThread("recorder", slow, lambda name, error: None)
    sink.put(1)
    assert begun.wait(PATIENCE_S)
    sink.put(2)
    threading.Timer(0.05, hold.set).start()
    sink.close()
    assert seen == [1, 2]
    assert (sink.counts.taken, sink.counts.missed) == (2, 0)


def test_a_taker_is_woken_by_what_comes_and_does_not_wait_for_its_time_to_end():
    slot, taken = Newest(), []
    threading.Timer(0.05, slot.put, ["late"]).start()
    assert lasts_s(lambda: taken.append(slot.take(PATIENCE_S))) < PATIENCE_S / 2
    assert taken == ["late"]


def test_a_sink_that_never_ends_does_not_keep_the_process_alive():
    hold = threading.Event()
    sink = SinkThread("link", lambda result: hold.wait(PATIENCE_S), lambda name, error: None)
    assert sink._thread.daemon
    sink.close()
