"""Small flights on the disk: a textured picture that slides slowly, as seen when flying sideways."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np

SIZE = 128
FRAMES = 14


def make_video(path: Path, frames: int = FRAMES) -> Path:
    noise = np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3), np.uint8)
    blurred = cv2.resize(cv2.GaussianBlur(noise, (0, 0), 2), None, fx=1.2, fy=1.2)
    texture = np.where(blurred > 127, 255, 0).astype(
        np.uint8
    )  # so strong that the network made by hand sees it
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
        for i in range(frames):
            shift = np.float32([[1, 0, -0.5 * i], [0, 1, 0]])
            image = cv2.warpAffine(texture, shift, (SIZE, SIZE))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


def make_log(path: Path, rows: list[str] | None = None) -> Path:
    every = [f"{t / 10:.1f},0.0,3.0,0.0" for t in range(8)] if rows is None else rows
    path.write_text("\n".join(["time_s,vn_m_s,ve_m_s,vd_m_s", *every]) + "\n")
    return path
