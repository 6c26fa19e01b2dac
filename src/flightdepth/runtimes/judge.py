"""The judge that ships: a few convolutions that say which of two depths is right, run by OpenCV."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from threading import local

import cv2
import numpy as np

from flightdepth.runtimes.arrays import Maps

JUDGE = Path(__file__).with_name("judge.onnx")


class Judge(local):
    """An `architectures.judge.JudgeNet` as an ONNX file. Any thread may ask: each has a network of its own."""

    def __init__(self, onnx: bytes) -> None:
        self._network = cv2.dnn.readNetFromONNX(np.frombuffer(onnx, np.uint8))

    def __call__(self, clues: Maps) -> tuple[Maps, Maps]:
        """Clues [k, h, w] to the logarithm of the new depth over the network's, and the error bar over that depth."""
        self._network.setInput(clues[None])
        change, spread = self._network.forward()[0]
        return change, spread


@cache
def judge() -> Judge:
    """The one that ships."""
    return Judge(JUDGE.read_bytes())


def judge_sha256() -> str:
    """SHA-256 of the judge that ships."""
    return hashlib.sha256(JUDGE.read_bytes()).hexdigest()
