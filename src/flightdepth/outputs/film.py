"""H.264 in an MP4 that begins with its first picture, and keeps the true times between them."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.flight.records import NS_PER_S

TICKS_PER_S = 90_000
# Measured on 1820x534 previews, CPU time a picture: superfast 9 ms, veryfast 13 ms at 0.7 times the bytes,
# ultrafast 5 ms at 1.9 times the bytes. Conversion to YUV in OpenCV spares 2 ms.
ENCODER = {"preset": "superfast", "crf": "23"}
# In pieces of a second, until `close` makes a plain file of them: what a killed process leaves can be read, too.
# With `delay_moov` in place of negative offsets FFmpeg 8 hides the last pictures, with neither all are late.
CONTAINER = {
    "movflags": "+hybrid_fragmented+negative_cts_offsets",
    "frag_duration": "1000000",  # microseconds
    "flush_packets": "1",
}


class Film:
    """Writes uint8 RGB pictures [H, W, 3] of one even size. Plays in browsers and on phones (yuv420p)."""

    def __init__(self, path: Path, width: int, height: int) -> None:
        if width % 2 or height % 2:
            raise BadInput("film size", expected="an even width and height", got=f"{width}x{height}")
        self._size = (height, width, 3)
        self._last_tick = -1
        self._container = av.open(str(path.absolute()), "w", format="mp4", options=CONTAINER)
        self._stream: Any = self._container.add_stream("libx264", rate=30, options=ENCODER)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
        self._stream.codec_context.time_base = Fraction(1, TICKS_PER_S)
        # As OpenCV converts. Of untold ones players take large pictures for BT.709, and show other colours.
        self._stream.codec_context.colorspace = Colorspace.ITU601
        self._stream.codec_context.color_range = ColorRange.MPEG

    def add(self, stamp_ns: int, picture: NDArray[np.uint8]) -> None:
        """Append one picture, shown so long after the first one as `stamp_ns` says; stamps must rise."""
        if picture.shape != self._size:
            raise BadInput("film picture", expected=str(self._size), got=str(picture.shape))
        planes = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2YUV_I420), np.uint8)
        frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.time_base = Fraction(1, TICKS_PER_S)
        # The container counts from the first picture on. Two within one tick would be refused by it.
        frame.pts = self._last_tick = max(stamp_ns * TICKS_PER_S // NS_PER_S, self._last_tick + 1)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Write what the encoder still holds, and the index."""
        try:
            if self._last_tick >= 0:
                self._container.mux(self._stream.encode(None))
        finally:
            self._container.close()

    def abandon(self) -> None:
        """Close the file as it stands; for a film that will be removed."""
        self._container.close()
