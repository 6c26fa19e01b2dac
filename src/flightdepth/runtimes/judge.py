"""The judge that ships: a few convolutions that say which of two depths is right, run by OpenCV."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from threading import local
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Maps = NDArray[np.float32]

JUDGE = Path(__file__).with_name("judge.onnx")


class Judge:
    """An `architectures.judge.JudgeNet` as an ONNX file. Any thread may ask."""

    def __init__(self, onnx: bytes) -> None:
        self._onnx = np.frombuffer(onnx, np.uint8)
        self._own = local()

    def __call__(self, clues: Maps) -> tuple[Maps, Maps]:
        """Clues [k, h, w] to the logarithm of the new depth over the network's, and the error bar over that depth."""
        network = self._network()
        network.setInput(clues[None])
        change, spread = network.forward()[0]
        return change, spread

    def _network(self) -> Any:
        """One for each thread: it keeps its buffers."""
        if not hasattr(self._own, "network"):
            self._own.network = cv2.dnn.readNetFromONNX(self._onnx)
        return self._own.network


@cache
def judge() -> Judge:
    """The one that ships."""
    return Judge(JUDGE.read_bytes())


def judge_sha256() -> str:
    """SHA-256 of the judge that ships."""
    return hashlib.sha256(JUDGE.read_bytes()).hexdigest()
