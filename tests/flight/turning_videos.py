"""Videos of a far landscape through a camera that turns as a case of benchmarks/turned_focal.py does."""

import importlib
import sys
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from flightdepth.runtimes.lens import undistort

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
simulated = importlib.import_module("turned_focal")


def looking(case, turned, at_s):
    """World from camera at a time."""
    return simulated.attitudes(case, turned, at_s, np.zeros((1, 2)))[0]


def write_video(path, camera, looks, rate_hz=15, lasts_s=10, *, text=()):
    """`text` [h, W, 3] hides the uppermost rows of each picture."""
    noise = np.random.default_rng(3).uniform(0, 255, (700, 1400, 3)).astype(np.float32)
    smooth = sum(cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (2, 5, 12))
    scene = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    height, width = camera.height, camera.width
    columns, rows = np.meshgrid(np.arange(float(width)), np.arange(float(height)))
    rays = np.dstack([undistort(np.dstack([columns, rows]), camera), np.ones((height, width))])
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate_hz, options={"crf": "16"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, rate_hz)
        for number in range(rate_hz * lasts_s):
            north, east, down = np.moveaxis(rays @ looks(number / rate_hz).T, -1, 0)
            x = 700 + np.arctan2(east, north) * 300  # a cylinder of landscape
            y = 350 + down / np.hypot(north, east) * 300
            image = cv2.remap(
                scene,
                x.astype(np.float32),
                y.astype(np.float32),
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_WRAP,
            )
            image[: len(text)] = text if len(text) else image[:0]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
