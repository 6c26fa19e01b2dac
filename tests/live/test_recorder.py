"""Recordings that end before the flight does."""

import json
import shutil
import threading
from dataclasses import replace
from types import SimpleNamespace

import pytest
from page_flights import Flying

from flightdepth.errors import BadInput
from flightdepth.live.recorder import Recorder
from flightdepth.outputs import FlightFolder
from flightdepth.outputs.writer import FlightWriter
from flightdepth.weights.store import find_network, read_card

SETTINGS = {"video": "rtsp://host/path"}


def results(count):
    taken = []
    with Flying() as flying:
        flying.page = SimpleNamespace(take=taken.append)
        for _ in range(count):
            flying.fly()
    return taken


@pytest.fixture
def recorder(tmp_path):
    return Recorder(tmp_path / "recording", read_card(find_network("motion-tiny")), "a link", SETTINGS)


def test_a_disk_that_is_nearly_full_ends_the_recording_and_keeps_it(recorder, tmp_path, monkeypatch):
    first, second, third, fourth = results(4)
    recorder(first)
    recorder(second)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=400 * 10**6))
    with pytest.raises(BadInput, match="expected 500 MB free on its disk, got 400 MB: it ends here"):
        recorder(third)
    recorder(fourth)
    recorder.close({})
    assert len(FlightFolder(tmp_path / "recording").rows) == 2


def test_results_of_another_size_are_left_out_and_stand_in_the_folder(recorder, tmp_path):
    """They were counted on the terminal alone; the folder looked whole."""
    first, second = results(2)
    recorder(first)
    size = (second.camera.width // 2, second.camera.height // 2)
    half = SimpleNamespace(camera=second.camera.resized(*size))
    with pytest.raises(BadInput, match=r"expected pictures of \d+x\d+, as it began, got \d+x\d+: left out"):
        recorder(half)
    recorder.close({"a newer picture came first": 3})
    told = json.loads((tmp_path / "recording" / "flight.json").read_text())["counts"]["dropped"]
    assert told == {"a newer picture came first": 3, "of another size than the first": 1}


def test_a_picture_s_own_focal_length_stands_beside_it_where_the_lens_zooms(recorder, tmp_path):
    first, second = results(2)
    recorder(first)
    recorder(replace(second, camera=second.camera.zoomed(2.0)))
    recorder.close({})
    folder = FlightFolder(tmp_path / "recording")
    assert [row.focal_px for row in folder.rows] == [None, pytest.approx(2 * first.camera.fx, abs=1e-3)]
    assert folder.camera(1).fx == pytest.approx(2 * first.camera.fx, rel=1e-5)


def test_a_result_that_a_slow_disk_takes_at_the_end_is_whole(recorder, tmp_path, monkeypatch):
    """`close` waits for it, and what comes after is not written."""
    begun, add = threading.Event(), FlightWriter.add

    def slow(writer, frame, result):
        begun.set()
        threading.Event().wait(0.2)
        add(writer, frame, result)

    monkeypatch.setattr(FlightWriter, "add", slow)
    first, second = results(2)
    writing = threading.Thread(target=recorder, args=[first])
    writing.start()
    begun.wait(10)
    recorder.close({})
    writing.join()
    recorder(second)
    folder = FlightFolder(tmp_path / "recording")
    assert [folder.depth_m(row.index).ndim for row in folder.rows] == [2]
