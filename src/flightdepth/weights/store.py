"""Networks on the disk: `<name>.onnx` beside its card `<name>.json`; bytes are checked, then opened."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from flightdepth.errors import BadInput
from flightdepth.files import write_atomic
from flightdepth.weights.card import NetworkCard

SHIPPED = Path(__file__).parent

# A pickle runs code when it is opened, and each PyTorch checkpoint is one (inside a zip since PyTorch 1.6).
PICKLE_SUFFIXES = frozenset({".pt", ".pth", ".pkl", ".pickle", ".ckpt", ".bin", ".tar"})
PICKLE_STARTS = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05", b"PK\x03\x04")


@dataclass(frozen=True)
class StoredNetwork:
    """A card and the bytes of the ONNX file that it describes; the SHA-256 of the bytes is the card's."""

    card: NetworkCard
    onnx: bytes

    def __post_init__(self) -> None:
        got = hashlib.sha256(self.onnx).hexdigest()
        if got != self.card.sha256:
            raise BadInput(
                f"weights of {self.card.name}",
                expected=f"the SHA-256 on the card, {self.card.sha256[:16] or 'which has none'}...",
                got=f"{got[:16]}... in {len(self.onnx)} bytes",
                mend="The file is truncated or another one; export or download it again.",
            )


def shipped_networks(folder: Path = SHIPPED) -> tuple[str, ...]:
    """Names of the networks in `folder`, sorted; by default those that ship with the package."""
    return tuple(sorted(path.stem for path in folder.glob("*.onnx") if path.with_suffix(".json").is_file()))


def find_network(name_or_path: str | Path, folder: Path = SHIPPED) -> Path:
    """The ONNX file of a shipped name, or of a path to one."""
    names = shipped_networks(folder)
    if str(name_or_path) in names:
        return folder / f"{name_or_path}.onnx"
    path = Path(name_or_path)
    refuse_pickle(path)
    if path.suffix.lower() == ".onnx" and path.is_file():
        return path
    is_run = path.is_dir() or path.suffix == ".safetensors"
    raise BadInput(
        "network",
        expected=f"a path to an ONNX file or one of: {', '.join(names) or '(none ships with this build)'}",
        got=repr(str(name_or_path)),
        mend=f"Make one of a run with: flightdepth export {path}." if is_run else None,
    )


def read_card(path: Path) -> NetworkCard:
    """The card beside the ONNX file `path`."""
    card_path = path.with_suffix(".json")
    try:
        return NetworkCard.model_validate_json(card_path.read_bytes())
    except OSError as error:
        raise BadInput(
            f"network card {card_path}",
            expected="a readable file beside the ONNX file",
            got=str(error.strerror),
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise BadInput(f"network card {card_path}", expected=f"a valid {where}", got=first["msg"]) from error


def read_network(name_or_path: str | Path, folder: Path = SHIPPED) -> StoredNetwork:
    """Card and checked bytes of a shipped name or of a path: what was hashed is what will be opened."""
    path = find_network(name_or_path, folder)
    card = read_card(path)
    try:
        onnx = path.read_bytes()
    except OSError as error:
        raise BadInput(f"weights {path}", expected="a readable file", got=str(error.strerror)) from error
    refuse_pickle(path, onnx)
    return StoredNetwork(card, onnx)


def save_network(folder: Path, card: NetworkCard, onnx: bytes) -> Path:
    """Write `<name>.onnx`, then its card with the SHA-256 filled in; returns the ONNX file's path.

    A crash between the two leaves a pair that does not match, which `read_network` refuses.
    """
    path = folder / f"{card.name}.onnx"
    signed = card.model_copy(update={"sha256": hashlib.sha256(onnx).hexdigest()})
    write_atomic(path, onnx)
    write_atomic(path.with_suffix(".json"), (signed.model_dump_json(indent=2) + "\n").encode())
    return path


def refuse_pickle(path: Path, start: bytes = b"") -> None:
    """Refuse a file that is a pickle by its suffix or its first bytes; nothing here ever unpickles."""
    if path.suffix.lower() in PICKLE_SUFFIXES or start.startswith(PICKLE_STARTS):
        raise BadInput(
            f"network {path}",
            expected="an ONNX file with its card",
            got="a pickle (a PyTorch checkpoint), which can run any code when opened",
            mend="Of a run of `flightdepth train`, export it; any other: docs/training.md, A network from elsewhere.",
        )
