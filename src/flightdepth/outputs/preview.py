"""The preview film: the input beside its depth, with a scale in metres; if wanted, every range too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.records import Frame, seconds
from flightdepth.outputs.encoding import Map
from flightdepth.outputs.legend import (
    FAINT_RGB,
    GROUND_RGB,
    LEGEND_WIDTH,
    TEXT_RGB,
    WARNING_RGB,
    legend,
    write,
)
from flightdepth.outputs.palette import DepthScale, Palette, Picture
from flightdepth.ranges.result import RangedDepth

CAPTION_HEIGHT = 24
FOOTER_HEIGHT = 30
GAP = 6
BASELINE = 17  # of a caption, from its top
MAX_PANEL = (960, 720)
MAX_RANGE_PANEL = (640, 480)
MIN_PANEL_WIDTH = 400
RANGES_CAP_M = 100.0  # as in the paper's figure of a real flight


@dataclass(frozen=True)
class Layout:
    """Panels of one size in rows, the scale at the right, one line of text below; all sizes even."""

    width: int
    height: int
    panels: int

    @classmethod
    def of(cls, width: int, height: int, panels: int) -> Layout:
        """For pictures of `width` x `height`: large enough to read, small enough for a screen."""
        most = MAX_PANEL if panels == 2 else MAX_RANGE_PANEL
        scale = min(most[0] / width, most[1] / height, max(1.0, MIN_PANEL_WIDTH / width))
        return cls(max(2, round(width * scale / 2) * 2), max(2, round(height * scale / 2) * 2), panels)

    @property
    def columns(self) -> int:
        """2 panels stand side by side, 3 and 4 in two columns, more in three or four."""
        return max(2, (self.panels + 1) // 2)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the whole film."""
        rows = -(-self.panels // self.columns)
        width = self.columns * (self.width + GAP) + LEGEND_WIDTH
        return width, rows * (CAPTION_HEIGHT + self.height) + FOOTER_HEIGHT

    def corner(self, panel: int) -> tuple[int, int]:
        """Top-left pixel (x, y) of a panel's picture; its caption stands above."""
        row, column = divmod(panel, self.columns)
        return column * (self.width + GAP), row * (CAPTION_HEIGHT + self.height) + CAPTION_HEIGHT


class Preview:
    """Draws one picture of the film a frame.

    `range_panels` > 0 adds that many maps of single ranges, and caps the scale at 100 m; `to_source` brings
    them from the network's size [h, w] to the source's [H, W], or says None where it can't any more.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        range_panels: int = 0,
        to_source: Callable[[Map], Map | None] | None = None,
    ) -> None:
        if (range_panels > 0) != (to_source is not None):
            raise ValueError("range panels need to_source, and nothing else does")
        self._palette = Palette(DepthScale(far_m=RANGES_CAP_M) if range_panels else DepthScale())
        self._layout = Layout.of(width, height, 2 + range_panels)
        self._range_panels, self._to_source = range_panels, to_source
        self._last_m = np.empty(0)
        self._empty = self._background()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures that `draw` returns."""
        return self._layout.size

    def draw(self, frame: Frame, result: RangedDepth) -> Picture:
        """Input, depth and text of one frame: uint8 RGB, `size`."""
        picture = self._empty.copy()
        self._place(picture, 0, self._fitted(frame.image))
        self._place(picture, 1, self._painted(result.depth_m, result.farther_than_m, result.nearer_than_m))
        self._draw_ranges(picture, result)
        self._draw_footer(picture, frame, result)
        return picture

    def _background(self) -> Picture:
        """All that never changes: ground, legend, captions."""
        width, height = self.size
        picture = np.full((height, width, 3), GROUND_RGB, np.uint8)
        scale = legend(self._palette.scale, height - FOOTER_HEIGHT - CAPTION_HEIGHT)
        picture[CAPTION_HEIGHT : height - FOOTER_HEIGHT, width - LEGEND_WIDTH :] = scale
        self._caption(picture, 0, "input")
        self._caption(picture, 1, "fused depth" if self._range_panels else "depth", "  log scale")
        return picture

    def _draw_ranges(self, picture: Picture, result: RangedDepth) -> None:
        shown = self._shown_ranges(result.displacements_m)
        for i in range(self._range_panels):
            panel, name = 2 + i, f"range {i + 1}"
            depth_m = None
            if i < len(shown) and self._to_source is not None:
                depth_m = self._to_source(result.range_depths_m[shown[i]])
            if depth_m is None:
                self._caption(picture, panel, name, "  not in use")
                continue
            self._place(picture, panel, self._painted(depth_m))
            pair = f"  {result.displacements_m[shown[i]]:.2f} m in {result.shifts[shown[i]]} frames"
            self._caption(picture, panel, name, pair)

    def _shown_ranges(self, displacements_m: NDArray[np.float64]) -> tuple[int, ...]:
        """Ranges that get a panel: all; where a scout is one too many, those most like the last ones shown."""
        every = range(len(displacements_m))
        likeness = {
            choice: float(np.abs(np.log(displacements_m[list(choice)] / self._last_m)).sum())
            for choice in combinations(every, self._range_panels)
            if len(self._last_m) == self._range_panels
        }
        shown = min(likeness, key=likeness.__getitem__) if likeness else tuple(every)[: self._range_panels]
        if shown:
            self._last_m = displacements_m[list(shown)]
        return shown

    def _draw_footer(self, picture: Picture, frame: Frame, result: RangedDepth) -> None:
        y = picture.shape[0] - 10
        x = write(picture, f"{seconds(frame.stamp_ns)}   frame {frame.index}", 10, y)
        if result.reason is not None:
            write(picture, f"no depth: {result.reason}", x + 24, y, WARNING_RGB)
            return
        flown = ", ".join(
            f"{length:.2f} m in {shift}"
            for length, shift in zip(result.displacements_m, result.shifts, strict=True)
        )
        x = write(picture, f"pairs: {flown} frames", x + 24, y, FAINT_RGB)
        known = float(np.isfinite(result.depth_m).mean())
        write(picture, f"known {known:.0%}   latency {result.latency_ms:.1f} ms", x + 24, y, FAINT_RGB)

    def _painted(self, depth_m: Map, *bounds_m: Map) -> Picture:
        return self._palette.fitted((self._layout.width, self._layout.height), depth_m, *bounds_m)

    def _fitted(self, image: Picture) -> Picture:
        size = (self._layout.width, self._layout.height)
        shrinks = size[0] < image.shape[1]
        fitted = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        return np.asarray(fitted, np.uint8)

    def _place(self, picture: Picture, panel: int, content: Picture) -> None:
        x, y = self._layout.corner(panel)
        picture[y : y + self._layout.height, x : x + self._layout.width] = content

    def _caption(self, picture: Picture, panel: int, name: str, more: str = "") -> None:
        x, y = self._layout.corner(panel)
        end = write(picture, name, x + 8, y - CAPTION_HEIGHT + BASELINE, TEXT_RGB)
        write(picture, more, end, y - CAPTION_HEIGHT + BASELINE, FAINT_RGB)
