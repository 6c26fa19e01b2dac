"""What is written on a preview: text, and the scale bar in metres."""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.outputs.palette import (
    FARTHER_HATCH,
    NEARER_HATCH,
    UNKNOWN_HATCH,
    DepthScale,
    Hatch,
    Picture,
    coloured,
    steps_of,
)

GROUND_RGB = (18, 20, 24)
TEXT_RGB = (228, 228, 228)
FAINT_RGB = (150, 154, 160)
WARNING_RGB = (255, 190, 80)
FONT = cv2.FONT_HERSHEY_SIMPLEX
TEXT_SCALE = 0.45
LEGEND_WIDTH = 100
BAR_WIDTH = 18
MARGIN = 12
SWATCH_HEIGHT, SWATCH_STEP = 16, 24
LEAST_BAR = 40  # pixels; where less is left the hatches are not explained, and below that nothing is
SWATCHES = (("farther", FARTHER_HATCH), ("nearer", NEARER_HATCH), ("unknown", UNKNOWN_HATCH))


def write(
    picture: Picture,
    text: str,
    x: int,
    y: int,
    rgb: tuple[int, int, int] = TEXT_RGB,
    *,
    scale: float = TEXT_SCALE,
) -> int:
    """Write a line whose baseline starts at (x, y), into `picture`; the x where it ends."""
    cv2.putText(picture, text, (x, y), FONT, scale, rgb, 1, cv2.LINE_AA)
    (width, _), _ = cv2.getTextSize(text, FONT, scale, 1)
    return x + width


def legend(scale: DepthScale, height: int) -> Picture:
    """The scale bar with ticks in metres, and what the hatches mean, as far as there is room.

    RGB [height, LEGEND_WIDTH, 3].
    """
    picture = np.full((height, LEGEND_WIDTH, 3), GROUND_RGB, np.uint8)
    top, whole = 26, height - 8
    swatches = SWATCHES if whole - len(SWATCHES) * SWATCH_STEP - top >= LEAST_BAR else ()
    bottom = whole - len(swatches) * SWATCH_STEP
    if bottom - top < LEAST_BAR:
        return picture
    write(picture, "metres", MARGIN, 14, FAINT_RGB)
    shares = np.linspace(0, 1, bottom - top)  # near at the bottom, as near ground is at the picture's
    picture[top:bottom, MARGIN : MARGIN + BAR_WIDTH] = coloured(steps_of(shares)[:, None])
    for tick_m in scale.ticks_m:
        _tick(picture, scale, tick_m, top + round(scale.position(tick_m) * (bottom - top - 1)))
    for i, (text, hatch) in enumerate(swatches):
        _swatch(picture, bottom + 10 + i * SWATCH_STEP, text, hatch)
    return picture


def _tick(picture: Picture, scale: DepthScale, tick_m: int, y: int) -> None:
    x = MARGIN + BAR_WIDTH
    cv2.line(picture, (x, y), (x + 5, y), TEXT_RGB, 1)
    beyond = ">" if tick_m == scale.far_m else "<" if tick_m == scale.near_m else ""
    write(picture, f"{beyond}{tick_m}", x + 9, y + 5)


def _swatch(picture: Picture, y: int, text: str, hatch: Hatch) -> None:
    picture[y : y + SWATCH_HEIGHT, MARGIN : MARGIN + BAR_WIDTH] = hatch.picture(BAR_WIDTH, SWATCH_HEIGHT)
    write(picture, text, MARGIN + BAR_WIDTH + 6, y + 12, FAINT_RGB, scale=0.4)
