"""Faults 16 and 17: slow inference, and an accelerator without memory."""

import gc
import logging
import time
import tracemalloc
import weakref

import numpy as np
import pytest
from fault_flights import FPS, SIZE, film, fly, log, view

from flightdepth.camera import Camera
from flightdepth.flight import open_flight
from flightdepth.outputs import FlightWriter, Preview, Source
from flightdepth.outputs.run import run_flight
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.memory_limit import MemoryLimit
from flightdepth.runtimes.devices import open_runtime
from flightdepth.runtimes.memory import OutOfMemory, memory_errors
from flightdepth.runtimes.network import load_network
from flightdepth.weights.store import read_network

FRAME_NS = round(1e9 / FPS)
CAMERA = Camera.from_fov(128, 128, 90)
SPEED = (3.0, 0.0, 0.0)
# In these words ONNX Runtime, CUDA, TensorRT and OpenVINO say it; the numbers are of real reports.
SAID = [
    "[ONNXRuntimeError] : 6 : RUNTIME_EXCEPTION : Non-zero status code returned while running Conv node. Name:'c'"
    " Status Message: bfc_arena.cc:376 void* onnxruntime::BFCArena::AllocateRawInternal(size_t, bool)"
    " Failed to allocate memory for requested buffer of size 8388608000",
    "CUDA failure 2: out of memory ; GPU=0 ; hostname=drone ; expr=cudaMalloc((void**)&p, size);",
    "CUBLAS failure 3: CUBLAS_STATUS_ALLOC_FAILED ; GPU=0",
    "CUDNN failure 4: CUDNN_STATUS_ALLOC_FAILED ; GPU=0",
    "Exception from ocl_engine.cpp:185: [GPU] out of GPU resources",
    "[GPU] Exceeded max size of memory object allocation: requested 4831838208 bytes",
    "std::bad_alloc",
]


# Fault 16: slow inference.


class Slow:
    """A runtime that takes its time."""

    def __init__(self, runtime, seconds):
        self._runtime, self._seconds = runtime, seconds
        self.description, self.architecture = runtime.description, runtime.architecture

    def __call__(self, inputs):
        time.sleep(self._seconds)
        return self._runtime(inputs)


@pytest.mark.parametrize("slow", ["inference", "preview"])
def test_fault_16_who_is_slow_holds_up_the_reader_not_the_memory(
    tmp_path, save_difference_network, monkeypatch, slow
):
    video, most = film(tmp_path / "flight.mp4", 30), 0
    log(tmp_path / "log.csv")
    network = load_network(save_difference_network())
    alive = weakref.WeakSet()
    if slow == "inference":
        network.runtime = Slow(network.runtime, 0.02)
    else:
        draw = Preview.draw
        monkeypatch.setattr(Preview, "draw", lambda *given: time.sleep(0.02) or draw(*given))

    def count(frame, result):
        nonlocal most
        alive.add(frame)
        most = max(most, len(alive))

    with open_flight(video, tmp_path / "log.csv", hfov_deg=90) as flight:
        source = Source(flight="a", telemetry="b", camera=flight.camera, network=network.card)
        with FlightWriter(tmp_path / "out", source, Preview(SIZE, SIZE)) as writer:
            run_flight(flight, MultiRangeEstimator(network, flight.camera), writer, count)
    assert 0 < most <= 16  # two queues of four, what they work on, and the loop's own


def growth_bytes(network, frames):
    """What Python holds more after the second half of a flight than after the first, bytes a frame.

    Ten pictures a second, so that the buffer is full after forty.
    """
    estimator, half = MultiRangeEstimator(network, Camera.from_fov(64, 64, 90), derotate=False), []
    pictures = [view(2 * phase, 64, 64) for phase in range(40)]
    tracemalloc.start()
    try:
        for index in range(frames):
            if index in (frames // 2, frames - 1):
                gc.collect()
                half.append(tracemalloc.get_traced_memory()[0])
            estimator.add_velocity(index * 10**8, SPEED)
            estimator.add_attitude(index * 10**8, (1, 0, 0, 0))
            estimator.add_frame(index * 10**8, pictures[index % 40])
    finally:
        tracemalloc.stop()
    return (half[1] - half[0]) / (frames / 2)


def test_fault_16_memory_is_flat(save_difference_network):
    assert growth_bytes(load_network(save_difference_network()), 140) < 2000  # a picture has 12,288


@pytest.mark.slow
def test_fault_16_memory_is_flat_over_a_long_run(save_difference_network):
    assert growth_bytes(load_network(save_difference_network()), 20_000) < 5


# Fault 17: no memory left on the accelerator.


@pytest.fixture
def small_device(monkeypatch):
    """ONNX Runtime with 300 kB for its tensors: its own arena, its own error."""
    onnxruntime = pytest.importorskip("onnxruntime")
    arena, anywhere = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, onnxruntime.OrtMemType.DEFAULT
    place = onnxruntime.OrtMemoryInfo("Cpu", arena, 0, anywhere)
    limit = onnxruntime.OrtArenaCfg({"max_mem": 300_000, "arena_extend_strategy": 1})
    onnxruntime.create_and_register_allocator(place, limit)
    made = onnxruntime.SessionOptions

    def options():
        chosen = made()
        chosen.add_session_config_entry("session.use_env_allocators", "1")
        return chosen

    monkeypatch.setattr(onnxruntime, "SessionOptions", options)


def flown(network, camera, ranges, frames=12):
    estimator = MultiRangeEstimator(network, camera, ranges=ranges)
    results = []
    for index in range(frames):
        estimator.add_velocity(index * FRAME_NS, SPEED)
        image = view(2 * index, camera.width, camera.height)
        results.append(estimator.add_frame(index * FRAME_NS, image))
    return results, estimator


@pytest.fixture
def loaded(save_difference_network, small_device):
    return load_network(save_difference_network(), device="onnxruntime")


def test_fault_17_the_injected_error_is_the_runtimes_own(loaded):
    pairs = np.zeros((4, 64, 64, 6), np.uint8)
    loaded.runtime({"pairs": pairs[:1]})
    with pytest.raises(OutOfMemory, match="no memory left on onnxruntime") as caught:
        loaded.runtime({"pairs": pairs})
    assert type(caught.value.__cause__).__module__.startswith("onnxruntime")


def test_fault_17_with_fewer_ranges_it_goes_on_and_says_so_once(loaded, caplog):
    """The device has room for one pair of 64x64 px."""
    results, estimator = flown(loaded, Camera.from_fov(64, 64, 90), ranges=4)
    assert all(result.reason is None for result in results[1:])
    assert {len(result.shifts) for result in results[1:]} == {1}
    assert estimator.ranges == 1
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "fewer frame pairs" in caplog.text
    assert results[-1].notes == ("no memory left on onnxruntime: after that at most 1 of a frame's pairs",)


def test_fault_17_the_pairs_that_are_left_are_those_of_the_shortest_shifts():
    def with_room_for_two(pairs):
        if len(pairs) > 2:
            raise OutOfMemory("full")
        return pairs[::-1]

    limit = MemoryLimit(4)
    assert limit.predicted(("a", "b", "c", "d"), None, with_room_for_two) == (("a", "b"), ("b", "a"))
    assert limit.most_pairs == 2
    assert limit.notes == ("full: after that at most 2 of a frame's pairs",)


def test_fault_17_then_it_goes_on_on_the_cpu(save_difference_network, small_device, caplog):
    """The device has no room for a single pair of 128x128 px."""
    loaded = load_network(save_difference_network(focal_px=64.0), device="onnxruntime")
    results, estimator = flown(loaded, CAMERA, ranges=2)
    assert all(result.reason is None for result in results[1:])
    assert loaded.runtime.description.startswith("OpenVINO")
    assert estimator.ranges == 2  # there is room for all of them
    assert len(caplog.records) == 1
    assert results[-1].notes == ("no memory left on onnxruntime: after that on the CPU",)


def test_fault_17_the_depth_is_that_of_the_cpu(save_difference_network, small_device):
    path = save_difference_network(focal_px=64.0)
    results, _ = flown(load_network(path, device="onnxruntime"), CAMERA, ranges=1)
    expected, _ = flown(load_network(path), CAMERA, ranges=1)
    for result, other in zip(results, expected, strict=True):
        np.testing.assert_allclose(result.depth_m, other.depth_m, rtol=1e-4)


def test_fault_17_warming_up_leaves_it_to_the_flight(loaded, caplog):
    loaded.warm_up(Camera.from_fov(64, 64, 90), pairs=2)
    assert not caplog.records


def test_fault_17_no_room_for_the_weights(save_difference_network, monkeypatch, caplog):
    onnxruntime = pytest.importorskip("onnxruntime")
    from onnxruntime.capi.onnxruntime_pybind11_state import RuntimeException

    def full(*_, **__):
        raise RuntimeException(SAID[0])

    monkeypatch.setattr(onnxruntime, "InferenceSession", full)
    stored = read_network(save_difference_network())
    runtime = open_runtime(stored.card, stored.onnx, device="onnxruntime", precision=None, threads=1)
    assert runtime.description.startswith("OpenVINO")
    assert "while the network was loaded: it runs on the CPU" in caplog.text
    assert len(caplog.records) == 1


@pytest.mark.parametrize("text", SAID)
def test_fault_17_each_runtimes_words_are_known(text):
    with pytest.raises(OutOfMemory), memory_errors("cuda"):
        raise RuntimeError(text)


def test_fault_17_other_errors_are_themselves():
    with pytest.raises(RuntimeError, match="invalid argument"), memory_errors("cuda"):
        raise RuntimeError("CUDA failure 1: invalid argument")


def test_fault_17_where_there_is_no_other_place_the_run_ends_with_its_error(save_difference_network):
    network = load_network(save_difference_network(), device="onnxruntime")
    network.move_to_cpu()

    def full(_):
        raise OutOfMemory("no memory left on the CPU")

    network.runtime = full
    with pytest.raises(OutOfMemory, match="no memory left on the CPU"):
        flown(network, Camera.from_fov(64, 64, 90), ranges=2)


def test_fault_17_a_whole_flight_ends_well(tmp_path, save_difference_network, loaded, monkeypatch):
    monkeypatch.setattr("fault_flights.load_network", lambda _: loaded)
    video = film(tmp_path / "flight.mp4", 12)
    log(tmp_path / "log.csv")
    results, _ = fly(video, save_difference_network())
    assert all(result.reason is None for _, result in results[1:])
