"""The pictures of a flight, from its folder: the preview's panels, so that the video need not be at hand."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest

import av
import cv2
import numpy as np
from av.error import FFmpegError

from flightdepth.errors import BadInput
from flightdepth.levels import rgb
from flightdepth.outputs.palette import Picture
from flightdepth.outputs.preview import Layout
from flightdepth.outputs.read import FlightFolder
from flightdepth.outputs.writer import PREVIEW


def pictures(
    folder: FlightFolder, every: int = 1, size: tuple[int, int] | None = None
) -> Iterator[tuple[int, Picture]]:
    """Index and picture, uint8 RGB [H, W, 3] at the camera's size, or at `size`, of each `every`-th frame.

    They were scaled to the preview's size and packed by its encoder: good for colours, not for measuring. Of an
    interrupted flight its last ones may be missing.
    """
    for index, (image,) in panels(folder, every, 1, size):
        yield index, image


def panels(
    folder: FlightFolder, every: int, count: int, size: tuple[int, int] | None = None
) -> Iterator[tuple[int, list[Picture]]]:
    """As `pictures`, of the preview's first `count` panels: the input, then depth in colours."""
    layout, camera = layout_of(folder), folder.record.source.camera
    for number, (row, frame) in enumerate(zip_longest(folder.rows, _decoded(folder, layout.size))):
        if row is None or frame is None:
            if not folder.record.whole:
                return
            raise _not_ours(folder, f"{len(folder.rows)} frames, as frames.csv tells", "another number")
        if number % every == 0:
            image = rgb(frame)
            yield (
                row.index,
                [_cut(image, layout, i, size or (camera.width, camera.height)) for i in range(count)],
            )


def _cut(image: Picture, layout: Layout, panel: int, size: tuple[int, int]) -> Picture:
    """One panel of the preview's picture, at a size."""
    x, y = layout.corner(panel)
    shrinks = size[0] < layout.width
    sized = cv2.resize(
        image[y : y + layout.height, x : x + layout.width],
        size,
        interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR,
    )
    return np.asarray(sized, np.uint8)


def layout_of(folder: FlightFolder) -> Layout:
    """Where the panels of its preview are."""
    source = folder.record.source
    ranges = source.settings.get("ranges") if source.settings.get("preview_ranges") else 0
    return Layout.of(source.camera.width, source.camera.height, 2 + int(ranges or 0))


def _decoded(folder: FlightFolder, size: tuple[int, int]) -> Iterator[av.VideoFrame]:
    began = False
    try:
        with av.open(str((folder.folder / PREVIEW).absolute())) as film:
            for frame in film.decode(video=0):
                if (frame.width, frame.height) != size:
                    raise _not_ours(folder, f"{size[0]}x{size[1]} px", f"{frame.width}x{frame.height}")
                began = True
                yield frame
    except (FFmpegError, OSError, IndexError) as error:
        if began and not folder.record.whole:  # cut off there
            return
        raise _not_ours(folder, "the preview of this flight", str(error)) from error


def _not_ours(folder: FlightFolder, expected: str, got: str) -> BadInput:
    mend = "Of what `convert` writes only .bt needs no preview."
    return BadInput(f"preview {folder.folder / PREVIEW}", expected=expected, got=got, mend=mend)
