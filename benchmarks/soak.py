"""A long flight, and what it does to memory: python benchmarks/soak.py --minutes 30.

The sample flight again and again as one: decoded, its velocities given, depth estimated, files encoded and thrown
away. Every few seconds the resident memory is read (after a collection); its slope after warm-up is fitted, with its
standard error. What leaks leaks by the frame: --shrink makes the pictures smaller and the frames more.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from flightdepth.flight import AttitudeSample, Flight, Frame, VelocitySample, open_flight
from flightdepth.outputs import FlightWriter, Preview, Source
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.network import Network, load_network

SAMPLE = Path(sys.modules["flightdepth"].__file__ or "").parent / "sample"
PASS_NS = 13_000_000_000  # from one beginning of the sample to the next: nothing is integrated across the cut
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
FLAT_MIB_AN_HOUR = 20.0
WARM_UP = 300  # frames: the buffer holds those of four seconds


def resident_mib() -> float:
    """Memory of this process that is in RAM."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 2**20


class EndlessFlight:
    """The sample flight over and over until `seconds` of wall time have passed; looks like a Flight."""

    def __init__(self, seconds: float, shrink: int) -> None:
        self._shrink = shrink
        self._until = time.monotonic() + seconds
        self.passes = 0
        with self._open() as flight:
            camera, self.gyroscope = flight.camera, flight.gyroscope
            self.camera = camera.resized(camera.width // shrink, camera.height // shrink)

    def _open(self) -> Flight:
        return open_flight(SAMPLE / "flight.mp4", SAMPLE / "telemetry.csv", SAMPLE / "camera.json")

    def __iter__(self) -> Iterator[Frame | VelocitySample | AttitudeSample]:
        index = 0
        while True:
            with self._open() as flight:
                for event in flight:
                    if time.monotonic() >= self._until:
                        return
                    later = replace(event, stamp_ns=event.stamp_ns + self.passes * PASS_NS)
                    if isinstance(later, Frame):
                        image = cv2.resize(later.image, (self.camera.width, self.camera.height))
                        later = replace(later, index=index, image=image)
                        index += 1
                    yield later
            self.passes += 1


def soak(
    network: Network, minutes: float, every_s: float, shrink: int
) -> tuple[list[tuple[float, float]], int]:
    """(seconds, MiB) every `every_s` seconds, and how many frames were flown."""
    flight = EndlessFlight(60 * minutes, shrink)
    camera = flight.camera
    estimator = MultiRangeEstimator(network, camera)
    source = Source(flight="sample", telemetry="sample", camera=camera, network=network.card)
    taken: list[tuple[float, float]] = []  # once the buffer of frames is full and all sizes are compiled
    began = next_look = time.monotonic()
    preview = Preview(camera.width, camera.height)
    with TemporaryDirectory() as folder, FlightWriter(Path(folder) / "out", source, preview) as writer:
        for frames, (frame, result) in enumerate(depths(flight, estimator), start=1):  # type: ignore[arg-type]
            writer.add(frame, result)
            throw_away(Path(folder), frame.index)
            if time.monotonic() >= next_look:
                next_look = time.monotonic() + every_s
                gc.collect()
                look = time.monotonic() - began, resident_mib()
                print(f"{look[0]:7.0f} s {frames:7d} frames {look[1]:9.1f} MiB", flush=True)
                taken += [look] if frames > WARM_UP else []
    return taken, frames


def throw_away(folder: Path, index: int) -> None:
    """Remove the maps of a frame long written, so that no disk fills up."""
    for path in folder.glob(f".out.*/*/{index - 100:06d}.*"):
        path.unlink()


def slope(taken: list[tuple[float, float]]) -> tuple[float, float]:
    """MiB an hour, and its standard error."""
    seconds, mib = np.array(taken).T
    hours = seconds / 3600
    (per_hour, _), covariance = np.polyfit(hours, mib, 1, cov=True)
    return float(per_hour), float(np.sqrt(covariance[0, 0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--network", default="motion-tiny", help="a shipped name or an ONNX file")
    parser.add_argument(
        "--shrink", type=int, default=1, metavar="N", help="pictures of 1/N the width and height"
    )
    parser.add_argument("--every", type=float, default=5.0, help="seconds between two looks at the memory")
    parser.add_argument("--json", type=Path, help="also write the figures here")
    arguments = parser.parse_args()
    network = load_network(arguments.network)
    taken, frames = soak(network, arguments.minutes, arguments.every, arguments.shrink)
    if len(taken) < 4:
        raise SystemExit(f"{frames} frames are too few: {WARM_UP} are warm-up; give more --minutes")
    per_hour, error = slope(taken)
    per_frame = per_hour * 2**20 / max(1, frames / (taken[-1][0] / 3600))
    print(f"{network.card.name}, {network.runtime.description}, {platform.machine()}")
    print(f"{frames} frames in {taken[-1][0]:.0f} s, {taken[0][1]:.0f} to {taken[-1][1]:.0f} MiB")
    print(f"slope {per_hour:.1f} +- {error:.1f} MiB an hour, {per_frame:.0f} bytes a frame")
    print("flat" if per_hour - 2 * error < FLAT_MIB_AN_HOUR else "NOT FLAT")
    if arguments.json:
        figures = {"frames": frames, "mib_an_hour": per_hour, "standard_error": error, "seconds_mib": taken}
        arguments.json.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
