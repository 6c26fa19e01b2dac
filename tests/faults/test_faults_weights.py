"""Fault 18: weights that are cut, of another architecture, not numbers, or a pickle: refused, never opened."""

import pickle
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightdepth.cli import main
from flightdepth.errors import BadInput
from flightdepth.runtimes.network import load_network
from flightdepth.weights.store import SHIPPED, read_card, read_network, save_network
from tests_networks import difference_card, difference_onnx

onnx = pytest.importorskip("onnx")


def refused(path, *words):
    """One line that holds `words`."""
    with pytest.raises(BadInput) as caught:
        load_network(path)
    assert "\n" not in str(caught.value)
    assert [word for word in words if word not in str(caught.value)] == []


def changed(tmp_path, change, **card):
    """The network made by hand with its graph changed, and a card that vouches for it."""
    model = onnx.load_from_string(difference_onnx())
    change(model.graph)
    return save_network(tmp_path, difference_card(**card), model.SerializeToString())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.999])
def test_fault_18_truncated_weights(save_difference_network, share):
    path = save_difference_network()
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    refused(path, "SHA-256", "truncated")


def test_fault_18_truncated_before_the_card_was_written(tmp_path):
    whole = difference_onnx()
    refused(save_network(tmp_path, difference_card(), whole[: len(whole) // 2]), "ONNX")


@given(st.binary(max_size=300))
@settings(max_examples=30)
def test_fault_18_any_bytes(tmp_path_factory, data):
    with pytest.raises(BadInput):
        load_network(save_network(tmp_path_factory.getbasetemp(), difference_card(), data))


@given(at=st.integers(0, 10**6), value=st.integers(0, 255))
@settings(max_examples=30)
def test_fault_18_any_changed_byte(tmp_path_factory, at, value):
    data = bytearray(difference_onnx())
    if data[at % len(data)] == value:
        return
    folder = tmp_path_factory.getbasetemp()
    path = save_network(folder, difference_card(), bytes(data))
    data[at % len(data)] = value
    path.write_bytes(data)
    with pytest.raises(BadInput, match="SHA-256"):
        load_network(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("device", ["auto", "onnxruntime"])
def test_fault_18_weights_that_are_not_numbers(tmp_path, value, device):
    def spoil(graph):
        weights = np.ones((1, 1, 3, 3), np.float32)
        weights[0, 0, 1, 2] = value
        graph.initializer.append(onnx.numpy_helper.from_array(weights, "conv1.weight"))
        pool = next(node for node in graph.node if node.op_type == "AveragePool")
        conv = onnx.helper.make_node("Conv", [pool.input[0], "conv1.weight"], ["seen"], pads=[1, 1, 1, 1])
        graph.node.insert(list(graph.node).index(pool), conv)
        pool.input[0] = "seen"

    path = changed(tmp_path, spoil)
    with pytest.raises(BadInput, match=r"finite numbers, got NaN or infinity in 11% of conv1\.weight"):
        load_network(path, device)


def test_fault_18_nan_in_a_single_number(tmp_path):
    def spoil(graph):
        slope = next(each for each in graph.initializer if each.name == "slope")
        slope.CopyFrom(onnx.numpy_helper.from_array(np.float32(np.nan), "slope"))

    refused(changed(tmp_path, spoil), "finite numbers", "slope")


@pytest.mark.parametrize("name", ["depthnet-256", "motion"])
def test_fault_18_nan_in_a_shipped_network(tmp_path, name):
    """Bytes changed in place, as a bad disk would, and a hash to go with them."""
    stored = read_network(name)
    model = onnx.load_from_string(stored.onnx)
    tensor = max(model.graph.initializer, key=lambda each: len(each.raw_data))
    at = stored.onnx.index(tensor.raw_data[:64])
    size, nan = (
        (2, b"\x00\x7e") if tensor.data_type == onnx.TensorProto.FLOAT16 else (4, struct.pack("<f", np.nan))
    )
    spoilt = bytearray(stored.onnx)
    spoilt[at + 8 * size : at + 9 * size] = nan
    refused(save_network(tmp_path, stored.card, bytes(spoilt)), "finite numbers")


def test_fault_18_another_graph(tmp_path):
    def rename(graph):
        graph.input[0].name = graph.node[0].input[0] = "images"

    refused(changed(tmp_path, rename), "ONNX graph", "images", "flightdepth export")


def test_fault_18_a_card_of_another_architecture(tmp_path):
    path = changed(tmp_path, lambda graph: None, architecture="MotionNet", any_lens=True)
    refused(path, "a MotionNet, as the card says", "a DepthNet")


def test_fault_18_the_weights_of_another_card(tmp_path, save_difference_network):
    path = save_difference_network()
    path.write_bytes((SHIPPED / "motion.onnx").read_bytes())
    refused(path, "SHA-256")


class Trap:
    """Unpickling this would leave a mark."""

    def __init__(self, mark):
        self._mark = mark

    def __reduce__(self):
        return open, (str(self._mark), "w")


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("suffix", [".onnx", ".pth", ".bin", ""])
def test_fault_18_a_pickle_is_never_opened(tmp_path, protocol, suffix, capsys):
    mark, path = tmp_path / "mark", tmp_path / f"network{suffix}"
    data = pickle.dumps(Trap(mark), protocol)
    if suffix == ".onnx":
        path = save_network(tmp_path, difference_card(name="network"), data)
    else:
        path.write_bytes(data)
    with pytest.raises(BadInput):
        load_network(path)
    assert main(["run", "flight.mp4", "--speed", "3", "--hfov", "80", "--network", str(path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not mark.exists()


def test_fault_18_pytorchs_own_file_is_never_opened(tmp_path):
    torch = pytest.importorskip("torch")
    mark, path = tmp_path / "mark", tmp_path / "network.onnx"
    torch.save({"weights": Trap(mark)}, path)
    refused(save_network(tmp_path, difference_card(name="network"), path.read_bytes()), "pickle")
    assert not mark.exists()


def test_fault_18_every_shipped_network_is_sound():
    for path in SHIPPED.glob("*.onnx"):
        assert load_network(path).card == read_card(path)
