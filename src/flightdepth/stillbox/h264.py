"""What a video's compression does to the pictures of a pair: both are frames of one H.264 stream."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace

import av
import numpy as np

from flightdepth.levels import rgb
from flightdepth.stillbox.pairs import Image, Pair

LEAST_FACTOR, LARGEST_FACTOR = 8.0, 22.0
ENCODER = {"threads": "1"}  # the rest as x264 has it


def filmed(rng: np.random.Generator, pair: Pair) -> Pair:
    """The pair in a video of some quality: a constant rate factor of 8 (good) to 22 (bad), drawn."""
    factor = float(rng.uniform(LEAST_FACTOR, LARGEST_FACTOR))
    previous, current = through_h264((pair.previous, pair.current), factor)
    return replace(pair, previous=previous, current=current)


def through_h264(pictures: Sequence[Image], rate_factor: float) -> list[Image]:
    """Successive frames of a video, uint8 RGB [H, W, 3] of even sides, as x264 at a constant rate factor shows them."""
    file = io.BytesIO()
    with av.open(file, "w", format="h264") as video:
        stream = video.add_stream("libx264", rate=30, options=ENCODER | {"crf": f"{rate_factor:.1f}"})
        stream.height, stream.width = pictures[0].shape[:2]
        for picture in pictures:
            video.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        video.mux(stream.encode(None))
    file.seek(0)
    with av.open(file, "r", format="h264") as video:
        return [rgb(frame) for frame in video.decode(video=0)]
