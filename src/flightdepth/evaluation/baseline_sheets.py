"""What each method sees over each baseline, as one picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.baseline_methods import Answer
from flightdepth.evaluation.baselines import Sight
from flightdepth.levels import Image
from flightdepth.outputs.encoding import centimetres_from_depth
from flightdepth.outputs.legend import GROUND_RGB, legend, write
from flightdepth.outputs.palette import DepthScale, Palette
from flightdepth.runtimes.arrays import Flags

SCALE = DepthScale(2.0, 200.0)
FULL_ERROR = 64.0  # grey levels of difference that are shown white
HEADING_PX = 20
GAP_PX = 2


class SheetSights:
    """Keeps the sights of at most 2 * `frames` frames, evenly spread over a flight of unknown length."""

    def __init__(self, frames: int) -> None:
        self._frames, self._step, self._seen = frames, 1, 0
        self._kept: list[tuple[Sight, ...]] = []

    def add(self, sights: tuple[Sight, ...]) -> None:
        """The sights of the next frame."""
        if self._seen % self._step == 0:
            self._kept.append(sights)
        self._seen += 1
        if len(self._kept) == 2 * self._frames:
            self._kept, self._step = self._kept[::2], 2 * self._step

    @property
    def chosen(self) -> list[tuple[Sight, ...]]:
        """`frames` of them at most: the first, the last and what lies evenly between."""
        places = np.linspace(0, len(self._kept) - 1, min(self._frames, len(self._kept)))
        return [self._kept[round(float(place))] for place in places]


def sheet(frames: Sequence[tuple[Sight, ...]], valid: Flags) -> Image:
    """RGB: a row for each frame and baseline; input, difference without a warp, then each method's depth and
    the difference after the warp. Hatched: no measurement. The part that `valid` [h, w] marks is shown.
    """
    palette = Palette(SCALE)
    rows = [row(sight, palette, valid) for sights in frames for sight in sights]
    body = np.vstack(rows)
    scale = np.full((body.shape[0], 100, 3), GROUND_RGB, np.uint8)
    bar = legend(SCALE, min(body.shape[0], 400))
    scale[: bar.shape[0]] = bar
    return np.hstack([body, scale]).astype(np.uint8)


def row(sight: Sight, palette: Palette, valid: Flags) -> Image:
    """One pair: panels side by side, a heading over each."""
    flown_m = float(np.linalg.norm(sight.pair.displacement))
    panels = [
        (f"frame {sight.index}, {flown_m:.2f} m flown", sight.current),
        ("no warp", difference_picture(sight.unmoved)),
    ]
    for name, answer in sight.answers.items():
        panels += [
            (name, depth_picture(answer, palette, sight.current.shape[:2])),
            (f"{name}: error", difference_picture(sight.errors[name])),
        ]
    top, bottom, left, right = _inside(valid, sight.current.shape[0] // valid.shape[0])
    shown = [(heading, panel[top:bottom, left:right]) for heading, panel in panels]
    return np.hstack([_headed(heading, panel) for heading, panel in shown]).astype(np.uint8)


def depth_picture(answer: Answer, palette: Palette, shape: tuple[int, ...]) -> Image:
    """Depth in the project's colours, RGB [H, W, 3]; hatched where it is no measurement."""
    depth_m, measured = answer.depth_m, answer.measured
    # An end of the range is a threshold of the depth itself; what lies between was not measured at all.
    farther = ~measured & (depth_m > depth_m.max(where=measured, initial=0))
    nearer = ~measured & (depth_m < depth_m.min(where=measured, initial=np.inf)) & ~farther
    known_m = np.where(measured, depth_m, np.float32(np.nan)).astype(np.float32)
    cell = shape[0] // depth_m.shape[0]
    centimetres = enlarged(centimetres_from_depth(known_m), cell)
    return palette.paint(centimetres, enlarged(farther, cell), enlarged(nearer, cell))


def enlarged(map_hw: NDArray[Any], cell: int) -> NDArray[Any]:
    """Each pixel as cell x cell of them."""
    return map_hw.repeat(cell, axis=0).repeat(cell, axis=1)


def difference_picture(error: NDArray[np.float32]) -> Image:
    """|Grey difference| as grey, FULL_ERROR and more white, RGB [H, W, 3]; dark blue outside."""
    level = (np.nan_to_num(error) * (255 / FULL_ERROR)).clip(0, 255).astype(np.uint8)
    picture = np.repeat(level[..., None], 3, axis=2)
    picture[np.isnan(error)] = (30, 40, 90)
    return picture


def _inside(valid: Flags, cell: int) -> tuple[int, int, int, int]:
    """Top, bottom, left and right of the part that shows the scene, pixels."""
    rows, columns = np.flatnonzero(valid.any(axis=1)), np.flatnonzero(valid.any(axis=0))
    return rows[0] * cell, (rows[-1] + 1) * cell, columns[0] * cell, (columns[-1] + 1) * cell


def _headed(heading: str, panel: Image) -> Image:
    height, width = panel.shape[:2]
    picture = np.full((height + HEADING_PX + GAP_PX, width + GAP_PX, 3), GROUND_RGB, np.uint8)
    write(picture, heading, 4, HEADING_PX - 6, scale=0.4)
    picture[HEADING_PX:-GAP_PX, :-GAP_PX] = panel
    return picture
