from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

from flightdepth.errors import BadInput
from flightdepth.weights.store import (
    find_network,
    read_card,
    read_network,
    save_network,
    shipped_networks,
)

Save = Callable[..., Path]


def test_what_was_saved_is_what_is_read(save_difference_network: Save) -> None:
    path = save_difference_network(name="a", samples=7)
    stored = read_network(path)
    assert stored.onnx == path.read_bytes()
    assert stored.card.samples == 7


def test_a_name_and_a_path_find_the_same_file(save_difference_network: Save, tmp_path: Path) -> None:
    path = save_difference_network(name="a")
    assert find_network("a", tmp_path) == find_network(path, tmp_path) == path


def test_names_are_sorted_and_need_a_card(save_difference_network: Save, tmp_path: Path) -> None:
    save_difference_network(name="b")
    save_difference_network(name="a")
    (tmp_path / "no-card.onnx").write_bytes(b"x")
    assert shipped_networks(tmp_path) == ("a", "b")


def test_an_unknown_name_is_answered_with_the_names(save_difference_network: Save, tmp_path: Path) -> None:
    save_difference_network(name="depthnet-256")
    with pytest.raises(BadInput, match=r"one of: depthnet-256, got 'depthnet-265'"):
        read_network("depthnet-265", tmp_path)


def test_a_missing_file_is_an_unknown_network(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="expected a path to an ONNX file"):
        read_network(tmp_path / "gone.onnx")


@pytest.mark.parametrize("name", ["runs/mine", "runs/mine/checkpoint.safetensors"])
def test_a_run_is_no_network_yet(tmp_path: Path, name: str) -> None:
    (tmp_path / "runs/mine").mkdir(parents=True)
    with pytest.raises(BadInput, match=rf"Make one of a run with: flightdepth export .*/{name}\.$"):
        read_network(tmp_path / name)


@pytest.mark.parametrize("kept", [0, 1, 100, -1])
def test_a_truncated_file_is_refused(save_difference_network: Save, kept: int) -> None:
    path = save_difference_network()
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(BadInput, match="truncated"):
        read_network(path)


def test_one_changed_bit_is_refused(save_difference_network: Save) -> None:
    path = save_difference_network()
    onnx = bytearray(path.read_bytes())
    onnx[len(onnx) // 2] ^= 1
    path.write_bytes(onnx)
    with pytest.raises(BadInput, match="SHA-256"):
        read_network(path)


def test_a_card_without_a_hash_vouches_for_nothing(save_difference_network: Save) -> None:
    path = save_difference_network()
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps(card | {"sha256": ""}))
    with pytest.raises(BadInput, match="which has none"):
        read_network(path)


class Trap:
    """Unpickling this would raise ZeroDivisionError."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return eval, ("1 / 0",)


@pytest.mark.parametrize("name", ["net.pt", "net.pth", "net.pkl", "NET.PTH", "net.ckpt"])
def test_a_pickle_is_refused_by_its_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(BadInput, match="got a pickle"):
        read_network(path)


@pytest.mark.parametrize("content", [pickle.dumps(Trap()), b"PK\x03\x04 a zip, as torch.save writes"])
def test_a_pickle_is_refused_by_its_content(save_difference_network: Save, content: bytes) -> None:
    path = save_difference_network()
    save_network(path.parent, read_card(path), content)
    with pytest.raises(BadInput, match="got a pickle"):
        read_network(path)


def test_a_missing_card_is_named(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"x")
    with pytest.raises(BadInput, match=r"net\.json: expected a readable file"):
        read_network(tmp_path / "net.onnx")


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"name": 3}'])
def test_a_broken_card_is_one_line(save_difference_network: Save, text: str) -> None:
    path = save_difference_network()
    path.with_suffix(".json").write_text(text)
    with pytest.raises(BadInput, match="network card") as caught:
        read_card(path)
    assert "\n" not in str(caught.value)


def test_an_unknown_key_on_a_card_is_refused(save_difference_network: Save) -> None:
    path = save_difference_network()
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps(card | {"colour": "red"}))
    with pytest.raises(BadInput, match="colour"):
        read_card(path)
