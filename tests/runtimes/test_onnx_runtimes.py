from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from flightdepth import processor
from flightdepth.errors import BadInput
from flightdepth.runtimes.contract import Runtime
from flightdepth.runtimes.devices import BF16_COST, BF16_COST_BEFORE, best_precision, open_runtime
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from flightdepth.runtimes.onnx_ort import OnnxRuntime
from tests_networks import difference_card, difference_onnx

RUNTIMES: dict[str, Callable[[bytes], Runtime]] = {"openvino": OpenVinoRuntime, "onnxruntime": OnnxRuntime}


@pytest.fixture(params=list(RUNTIMES))
def open_onnx(request: pytest.FixtureRequest) -> Callable[[bytes], Runtime]:
    if request.param == "onnxruntime":
        pytest.importorskip("onnxruntime")
    return RUNTIMES[request.param]


def depth_of(run: Runtime, pairs: np.ndarray) -> np.ndarray:
    return run({"pairs": pairs})["depth_m"]


def pairs_with_step(n: int, height: int, width: int, levels: int) -> np.ndarray:
    pairs = np.full((n, height, width, 6), 100, np.uint8)
    pairs[..., 3:] += np.uint8(levels)
    return pairs


def test_51_grey_levels_cost_10_m(open_onnx: Callable[[bytes], Runtime]) -> None:
    depth = depth_of(open_onnx(difference_onnx()), pairs_with_step(1, 64, 64, 51))
    assert depth.dtype == np.float32
    assert depth == pytest.approx(np.full((1, 16, 16), 90.0), rel=1e-5)


def test_the_output_is_a_quarter_of_any_size(open_onnx: Callable[[bytes], Runtime]) -> None:
    run = open_onnx(difference_onnx())
    for shape in ((1, 64, 64), (3, 128, 64), (2, 64, 192), (1, 64, 64)):
        n, height, width = shape
        assert depth_of(run, pairs_with_step(n, height, width, 0)).shape == (n, height // 4, width // 4)


def test_a_batch_is_its_pairs_one_by_one(open_onnx: Callable[[bytes], Runtime]) -> None:
    run = open_onnx(difference_onnx())
    pairs = np.random.default_rng(0).integers(0, 256, (3, 64, 128, 6)).astype(np.uint8)
    assert depth_of(run, pairs) == pytest.approx(
        np.concatenate([depth_of(run, pair[None]) for pair in pairs]), rel=1e-5
    )


def test_a_result_outlives_the_next_call(open_onnx: Callable[[bytes], Runtime]) -> None:
    run = open_onnx(difference_onnx())
    first = depth_of(run, pairs_with_step(1, 64, 64, 0))
    depth_of(run, pairs_with_step(1, 64, 64, 51))
    assert (first == 100).all()


def test_more_shapes_than_are_kept_still_run() -> None:
    run = OpenVinoRuntime(difference_onnx())
    for size in [*range(64, 704, 64), 64]:
        assert depth_of(run, pairs_with_step(1, 64, size, 51))[0, 0, 0] == pytest.approx(90)


def test_another_number_of_pairs_compiles_nothing() -> None:
    """Each graph costs a third of a second and 55 MB."""
    run = OpenVinoRuntime(difference_onnx())
    for n in (1, 2, 5):
        depth_of(run, pairs_with_step(n, 64, 64, 0))
    assert len(run._requests) == 1


def test_threads_share_a_runtime(open_onnx: Callable[[bytes], Runtime]) -> None:
    run = open_onnx(difference_onnx())
    steps = [0, 51, 102] * 8
    with ThreadPoolExecutor(4) as pool:
        depths = list(pool.map(lambda step: depth_of(run, pairs_with_step(1, 64, 64, step))[0, 3, 3], steps))
    assert depths == pytest.approx([100 - step / 5.1 for step in steps], rel=1e-4)


def test_runtimes_agree() -> None:
    pytest.importorskip("onnxruntime")
    pairs = np.random.default_rng(1).integers(0, 256, (2, 128, 64, 6)).astype(np.uint8)
    onnx = difference_onnx()
    assert depth_of(OpenVinoRuntime(onnx), pairs) == pytest.approx(
        depth_of(OnnxRuntime(onnx), pairs), rel=1e-4
    )


@pytest.mark.parametrize("kept", [0, 1, 37, -20])
def test_a_truncated_graph_is_refused(open_onnx: Callable[[bytes], Runtime], kept: int) -> None:
    with pytest.raises(BadInput, match="ONNX") as caught:
        open_onnx(difference_onnx()[:kept])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("seed", range(5))
def test_trash_is_refused(open_onnx: Callable[[bytes], Runtime], seed: int) -> None:
    with pytest.raises(BadInput, match="ONNX"):
        open_onnx(np.random.default_rng(seed).bytes(500))


def test_a_graph_with_other_names_is_refused(open_onnx: Callable[[bytes], Runtime]) -> None:
    with pytest.raises(BadInput, match=r"ONNX graph: expected \['pairs'\] to \['depth_m'\] or \['current'"):
        open_onnx(difference_onnx().replace(b"pairs", b"peers"))


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        ((1, 64, 60, 6), np.uint8),
        ((1, 64, 64, 3), np.uint8),
        ((64, 64, 6), np.uint8),
        ((0, 64, 64, 6), np.uint8),
        ((1, 64, 64, 6), np.float32),
    ],
)
def test_a_batch_that_breaks_the_contract_is_our_bug(
    open_onnx: Callable[[bytes], Runtime], shape: tuple[int, ...], kind: type
) -> None:
    with pytest.raises(ValueError, match="expected DepthNet inputs"):
        open_onnx(difference_onnx())({"pairs": np.zeros(shape, kind)})


def test_bf16_is_near_f32() -> None:
    if not processor.cpu_runs_bf16():
        pytest.skip("this CPU does not compute bf16")
    pairs = np.random.default_rng(2).integers(0, 256, (1, 64, 64, 6)).astype(np.uint8)
    onnx = difference_onnx()
    assert depth_of(OpenVinoRuntime(onnx, precision="bf16"), pairs) == pytest.approx(
        depth_of(OpenVinoRuntime(onnx), pairs), rel=0.02
    )


@pytest.mark.parametrize("device", ["auto", "cpu", "openvino"])
def test_openvino_is_the_cpus_runtime(device: str) -> None:
    runtime = open_runtime(difference_card(), difference_onnx(), device=device, precision=None, threads=1)
    assert runtime.description.startswith("OpenVINO 20")


def test_an_unknown_device_is_answered_with_the_devices() -> None:
    with pytest.raises(BadInput, match="expected one of auto, cpu, openvino, onnxruntime, cuda"):
        open_runtime(difference_card(), difference_onnx(), device="gpu", precision=None, threads=None)


def test_a_gpu_that_is_not_there_is_said() -> None:
    onnxruntime = pytest.importorskip("onnxruntime")
    if "CUDAExecutionProvider" in onnxruntime.get_available_providers():
        pytest.skip("this build of ONNX Runtime has CUDA")
    with pytest.raises(BadInput, match="got CUDAExecutionProvider"):
        open_runtime(difference_card(), difference_onnx(), device="cuda", precision=None, threads=None)


def test_bf16_is_for_openvino_only() -> None:
    with pytest.raises(BadInput, match="Use device openvino"):
        open_runtime(
            difference_card(), difference_onnx(), device="onnxruntime", precision="bf16", threads=None
        )


@pytest.mark.parametrize(
    "metrics",
    [
        {},
        {BF16_COST: 0.011},
        {"L1": 0.0},
        {BF16_COST_BEFORE: 0.011},
        {BF16_COST: 0.011, BF16_COST_BEFORE: 0.0},
    ],
)
def test_f32_unless_the_card_measured_that_bf16_is_cheap(metrics: dict[str, float]) -> None:
    assert best_precision(difference_card(metrics=metrics)) == "f32"


@pytest.fixture
def timed_bf16(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[float], None]]:
    """Sets how long bf16 takes beside float32 on a CPU that computes it."""
    monkeypatch.setattr(processor, "cpu_runs_bf16", lambda: True)

    def takes(ratio: float) -> None:
        monkeypatch.setattr(processor, "bf16_over_f32", lambda: ratio)
        processor.cpu_gains_by_bf16.cache_clear()

    yield takes
    processor.cpu_gains_by_bf16.cache_clear()


@pytest.mark.parametrize("measured", [BF16_COST, BF16_COST_BEFORE])
@pytest.mark.parametrize(("ratio", "chosen"), [(0.5, "bf16"), (1.6, "f32")])
def test_bf16_where_its_cost_is_one_percent_and_the_cpu_is_faster_in_it(
    timed_bf16: Callable[[float], None], measured: str, ratio: float, chosen: str
) -> None:
    """Intel's CPUs without AMX compute it, 1.6 times as slowly as float32."""
    timed_bf16(ratio)
    assert best_precision(difference_card(metrics={measured: 0.01})) == chosen


def test_bf16_is_timed_where_the_cpu_computes_it() -> None:
    if not processor.cpu_runs_bf16():
        pytest.skip("this CPU does not compute bf16")
    assert 0.02 < processor.bf16_over_f32() < 5
