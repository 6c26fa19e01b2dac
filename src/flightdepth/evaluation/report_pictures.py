"""The report's pictures: what a camera saw, the truth, and each method's depth in one scale of colours."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from typing import Any

import cv2
import numpy as np

from flightdepth.levels import Image
from flightdepth.outputs.encoding import centimetres_from_depth, depth_from_centimetres, rgb_png
from flightdepth.outputs.legend import legend
from flightdepth.outputs.palette import DepthScale, Palette

SIZE_PX = 192
SCALE = DepthScale(2.0, 100.0)


def gallery(found: Mapping[str, Any]) -> str:
    """HTML: a row of pictures for each example, with the scale of colours beside the first."""
    rows = [_row(example) for example in found["examples"]]
    if not rows:
        return ""
    bar = f"<img class='scale' alt='scale in metres' src='{_source(legend(SCALE, 380))}'>"
    return f"<div class='gallery'><div>{''.join(rows)}</div>{bar}</div>"


def _row(example: Mapping[str, Any]) -> str:
    palette = Palette(SCALE)
    pictures = [_figure("input", f"data:image/jpeg;base64,{example['image_jpeg']}")]
    depths = [("truth", example["truth_png"])]
    depths += [(_label(each), each["depth_png"]) for each in example["depths"]]
    pictures += [_figure(label, _source(painted(text, palette))) for label, text in depths if text]
    return f"<div class='pictures'>{''.join(pictures)}</div>"


def painted(depth_png: str, palette: Palette) -> Image:
    """Colours RGB [SIZE_PX, SIZE_PX, 3] of a depth map in centimetres, PNG as text; hatched where unknown."""
    data = np.frombuffer(base64.b64decode(depth_png), np.uint8)
    small = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), np.uint16)
    large = cv2.resize(depth_from_centimetres(small), (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_NEAREST)
    return palette.paint(centimetres_from_depth(np.asarray(large, np.float32)))


def _label(depth: Mapping[str, Any]) -> str:
    default = depth["trial"]["fusion"] == "saturation"
    return f"{depth['label']}, default fusion" if default else str(depth["label"])


def _figure(label: str, source: str) -> str:
    return (
        f"<figure><img alt='{escape(label)}' src='{source}'><figcaption>{escape(label)}</figcaption></figure>"
    )


def _source(picture: Image) -> str:
    return f"data:image/png;base64,{base64.b64encode(rgb_png(picture)).decode()}"
