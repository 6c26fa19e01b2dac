"""A long flight, and what it does to memory: python benchmarks/soak.py --minutes 30.

The sample flight again and again in one film, through all of `flightdepth run`: decoded, its velocities given, depth
estimated, files encoded (and thrown away). Every few seconds the resident memory is read, after a collection; its
slope after warm-up is fitted, with its standard error. What leaks leaks by the frame: --shrink makes the pictures
smaller and the frames more.
"""

from __future__ import annotations

import argparse
import gc
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np
from slopes import resident_mib, slope_an_hour

from flightdepth.evaluation.provenance import network_facts, source_commit
from flightdepth.files import write_json
from flightdepth.flight import Flight, Frame, open_flight
from flightdepth.flight.telemetry_csv import read_csv, write_csv
from flightdepth.outputs import FlightWriter, Preview, Source
from flightdepth.outputs.run import depths
from flightdepth.processor import cpu_name
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.network import Network, load_network

SAMPLE = Path(sys.modules["flightdepth"].__file__ or "").parent / "sample"
SAMPLE_FRAMES = 300
PASS_NS = 13_000_000_000  # from one beginning of the sample to the next: nothing is integrated across the cut
FASTEST = 40.0  # frames/s that the film must be long enough for
FLAT_MIB_AN_HOUR = 20.0
WARM_UP = 300  # frames: the buffer holds those of four seconds


def write_long_flight(folder: Path, passes: int) -> tuple[Path, Path]:
    """The sample's packets and velocities `passes` times over: a film and its log."""
    film, log = folder / "flight.mp4", folder / "telemetry.csv"
    with av.open(str(SAMPLE / "flight.mp4")) as source, av.open(str(film), "w") as target:
        stream = source.streams.video[0]
        out = target.add_stream_from_template(stream)
        for number in range(passes):
            source.seek(0)
            later = round(number * PASS_NS * 1e-9 / stream.time_base)
            for packet in source.demux(stream):
                if packet.dts is None:
                    continue
                packet.pts, packet.dts, packet.stream = packet.pts + later, packet.dts + later, out
                target.mux(packet)
    samples = read_csv(SAMPLE / "telemetry.csv").samples
    shifts = (number * PASS_NS for number in range(passes))
    write_csv(log, (replace(each, stamp_ns=each.stamp_ns + shift) for shift in shifts for each in samples))
    return film, log


class Shrunk(Flight):
    """A flight with smaller pictures, for `seconds`."""

    def __init__(self, flight: Flight, shrink: int, seconds: float) -> None:
        vars(self).update(vars(flight))  # that one in all else
        self.camera = self.camera.resized(self.camera.width // shrink, self.camera.height // shrink)
        self._until = time.monotonic() + seconds

    def _frames(self) -> Iterator[Frame]:
        size = (self.camera.width, self.camera.height)
        for frame in super()._frames():
            if time.monotonic() >= self._until:
                return
            image = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
            yield replace(frame, image=image.astype(np.uint8, copy=False))


def soak(
    network: Network, minutes: float, every_s: float, shrink: int
) -> tuple[list[tuple[float, float]], int]:
    """(seconds, MiB) every `every_s` seconds once warmed up, and how many frames were flown."""
    taken: list[tuple[float, float]] = []
    passes = math.ceil(60 * minutes * FASTEST / SAMPLE_FRAMES) * min(shrink, 2)
    with TemporaryDirectory() as name:
        film, log = write_long_flight(Path(name), passes)
        with open_flight(film, log, SAMPLE / "camera.json") as whole:
            flight = Shrunk(whole, shrink, 60 * minutes)
            camera, began, next_look = flight.camera, time.monotonic(), 0.0
            source = Source(flight="sample", telemetry="sample", camera=camera, network=network.card)
            estimator = MultiRangeEstimator(network, camera)
            with FlightWriter(Path(name) / "out", source, Preview(camera.width, camera.height)) as writer:
                for frames, (frame, result) in enumerate(depths(flight, estimator), start=1):
                    writer.add(frame, result)
                    throw_away(Path(name), frame.index)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--network", default="motion", help="a shipped name or an ONNX file")
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
    seconds, mib = np.array(taken).T
    per_hour, error = slope_an_hour(seconds / 60, mib)
    per_frame = per_hour * 2**20 / (3600 * frames / taken[-1][0])
    print(f"{network.card.name}, {network.runtime.description}, {cpu_name()}")
    print(f"{frames} frames in {taken[-1][0]:.0f} s, {taken[0][1]:.0f} to {taken[-1][1]:.0f} MiB")
    print(f"slope {per_hour:.1f} +- {error:.1f} MiB an hour, {per_frame:.0f} bytes a frame")
    print("flat" if per_hour - 2 * error < FLAT_MIB_AN_HOUR else "NOT FLAT")
    if arguments.json:
        facts = {"commit": source_commit(), "cpu": cpu_name(), "network": network_facts(network)}
        facts |= {"minutes": arguments.minutes, "shrink": arguments.shrink}
        figures = {"frames": frames, "mib_an_hour": per_hour, "standard_error": error, "seconds_mib": taken}
        write_json(arguments.json, facts | figures)


if __name__ == "__main__":
    main()
