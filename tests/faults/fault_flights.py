"""Real files to damage: films of a sliding texture through PyAV, their packets, logs, and a flight through `run`."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from flightdepth.cli import main
from flightdepth.flight import Frame, open_flight
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator, RangedDepth
from flightdepth.runtimes.network import load_network

Counts = dict[str, int]

SIZE = 128
FPS = 30
STEP_PX = 0.5
GROUP = 10  # pictures from key frame to key frame
TICKS = 60_000  # MPEG-4 takes no finer ones


def texture() -> np.ndarray:
    """Black and white blobs, so strong that the network made by hand sees them move."""
    noise = np.random.default_rng(0).integers(0, 256, (SIZE, 2 * SIZE, 3), np.uint8)
    return np.where(cv2.GaussianBlur(noise, (0, 0), 2) > 127, 255, 0).astype(np.uint8)


TEXTURE = texture()


def view(phase: float, width: int = SIZE, height: int = SIZE) -> np.ndarray:
    """The texture, slid to the left by `phase` steps."""
    slid = cv2.warpAffine(TEXTURE, np.float32([[1, 0, -STEP_PX * phase], [0, 1, 0]]), (SIZE, SIZE))
    return slid if (width, height) == (SIZE, SIZE) else cv2.resize(slid, (width, height))


def film(
    path: Path,
    frames: int = 40,
    *,
    codec: str = "libx264",
    group: int = GROUP,
    stamps_s: Sequence[float] | None = None,
    phase: Callable[[int], float] = float,
    shown: Callable[[int], np.ndarray] | None = None,
    size: tuple[int, int] = (SIZE, SIZE),
    muxer: dict[str, str] | None = None,
    encoder: dict[str, str] | None = None,
) -> Path:
    """`frames` pictures at 30 a second, or at `stamps_s`; picture i is `shown(i)`, else `view(phase(i))`."""
    stamps = [i / FPS for i in range(frames)] if stamps_s is None else stamps_s
    with av.open(str(path), "w", options=muxer or {}) as container:
        options = {"g": str(group)} | ({"sc_threshold": "0"} if codec == "libx264" else {}) | (encoder or {})
        stream = container.add_stream(codec, rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        stream.codec_context.time_base = Fraction(1, TICKS)
        for index, stamp_s in enumerate(stamps):
            image = view(phase(index), *size) if shown is None else shown(index)
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = round(stamp_s * TICKS), Fraction(1, TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def packets(path: Path) -> list[tuple[int, int, bool]]:
    """Place in the file, size, and whether it is a key frame, of each video packet in decoding order."""
    with av.open(str(path)) as container:
        return [(p.pos, p.size, p.is_keyframe) for p in container.demux(container.streams.video[0]) if p.size]


def log(path: Path, rows: Sequence[tuple[float, float, float, float]] | None = None) -> Path:
    """CSV of (time s, north, east, down m/s); by default 3 m/s east, ten times a second, for 3 s."""
    rows = [(t / 10, 0.0, 3.0, 0.0) for t in range(31)] if rows is None else rows
    lines = [",".join(map(repr, row)) for row in rows]
    path.write_text("\n".join(["time_s,vn_m_s,ve_m_s,vd_m_s", *lines]) + "\n")
    return path


def run(video: Path, network: Path, out: Path, *arguments: object) -> int:
    """`flightdepth run` of a video beside its `log.csv`; the exit code."""
    fixed = ["--hfov", "90", "--network", network, "--out", out]
    told = "--telemetry" in arguments or "--speed" in arguments
    telemetry = [] if told else ["--telemetry", video.with_name("log.csv")]
    return main([str(word) for word in ["run", video, *fixed, *telemetry, *arguments]])


def fly(video: Path, network: Path, **options: object) -> tuple[list[tuple[Frame, RangedDepth]], Counts]:
    """The same without files: each frame with its depth, and what was dropped."""
    if "speed_m_s" not in options:
        options["telemetry"] = video.with_name("log.csv")
    with open_flight(video, hfov_deg=90, **options) as flight:
        estimator = MultiRangeEstimator(load_network(network), flight.camera)
        results = list(depths(flight, estimator))
        return results, {**flight.counts, **estimator.dropped}


def table(out: Path) -> list[dict[str, str]]:
    """frames.csv of a run."""
    with (out / "frames.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
