"""Pictures of single results, laid out as in the paper's figure of results at 512 px."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.files import write_atomic
from flightdepth.levels import Image
from flightdepth.outputs.encoding import rgb_png
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.network import Network

GREEN, RED, BLUE, GREY = (0, 190, 0), (230, 0, 0), (0, 0, 230), (90, 90, 90)
ERROR_SHARE = 0.2  # of the largest depth: an error of this size or more has the full colour


def error_picture(prediction_m: Maps, truth_m: Maps, full_m: float) -> Image:
    """RGB [h, w, 3]: green no error, red too far, blue too near, full at `full_m` metres; grey unknown."""
    error = ((prediction_m - truth_m) / np.float32(full_m)).clip(-1, 1)[..., None]
    share, ends = np.abs(error), np.where(error > 0, np.array(RED), np.array(BLUE))
    picture = (1 - share) * np.array(GREEN) + share * ends
    picture = np.where(np.isfinite(error), picture, np.array(GREY))
    return picture.round().astype(np.uint8)


def depth_picture(depth_m: Maps, far_m: float) -> Image:
    """RGB [h, w, 3]: near bright, `far_m` dark, linear in metres as the network's L1 is; grey unknown."""
    levels = 255 * (1 - np.nan_to_num(depth_m, nan=0.0) / far_m).clip(0, 1)
    picture = cv2.applyColorMap(levels.round().astype(np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1]
    return np.where(np.isfinite(depth_m)[..., None], picture, np.array(GREY, np.uint8)).astype(np.uint8)


def sheet(current: Image, truth_m: Maps, prediction_m: Maps, far_m: float) -> Image:
    """RGB [2 H, 2 W, 3]: input and error above, truth and prediction below."""
    size = (current.shape[1], current.shape[0])
    error, truth, prediction = (
        cv2.resize(small, size, interpolation=cv2.INTER_NEAREST)
        for small in (
            error_picture(prediction_m, truth_m, ERROR_SHARE * far_m),
            depth_picture(truth_m, far_m),
            depth_picture(prediction_m, far_m),
        )
    )
    return np.vstack([np.hstack([current, error]), np.hstack([truth, prediction])]).astype(np.uint8)


def answered_sheet(network: Network, pair: TruePair) -> Image:
    """The sheet of what a network says of a pair."""
    task = Task.of(pair, network.card)
    prediction = task.ask(network, pair)
    return sheet(pair.current, task.truth_m, prediction.depth_m[0], task.card.depth_max_m)


def write_sheets(network: Network, pairs: Iterable[TruePair], folder: Path) -> list[Path]:
    """Write one sheet per pair as `000.png`, `001.png`, ... into an existing folder."""
    paths = []
    for number, pair in enumerate(pairs):
        paths.append(folder / f"{number:03d}.png")
        write_atomic(paths[-1], rgb_png(answered_sheet(network, pair)))
    return paths
