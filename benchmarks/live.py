"""Age and memory of a live run: python benchmarks/live.py [--seconds 60] [--network motion-tiny] [--ranges 2].

The sample flight is sent again and again as MPEG-TS over UDP by a process of its own, at 30 frames/s, encoded
without delay as a camera would; its velocities are fed at 20 Hz. Printed: age from reception to result (p50, p95, of
each quarter of the run), pictures dropped, ranges in use, and memory at each quarter. Everything shares the cores
that this process may use: `taskset -c 0,1 python benchmarks/live.py` is a computer with two.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from estimator import cpu

import flightdepth
from flightdepth.flight.records import Telemetry, VelocitySample
from flightdepth.flight.video import Video
from flightdepth.live.depth_stage import DepthStage, Lens
from flightdepth.live.engine import LiveEngine, Parts
from flightdepth.live.log_player import LogPlayer
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.status import LiveResult
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import VideoInput
from flightdepth.runtimes.network import load_network

SAMPLE = Path(flightdepth.__file__).parent / "sample" / "flight.mp4"
RATE_HZ = 30
WARM_UP_S = 5.0
SPEED_M_S = 5.7
FOV_DEG = 75.0


def send(address: str, size: tuple[int, int], seconds: float) -> None:
    """The sample's first five seconds, forth and back, to `address`, as fast as a camera would."""
    with Video(SAMPLE, end_s=5.0) as video:
        forth = [cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA) for frame in video.frames()]
    pictures = forth + forth[-2:0:-1]
    output = av.open(address, "w", format="mpegts")
    stream = output.add_stream(
        "libx264", rate=RATE_HZ, options={"preset": "ultrafast", "tune": "zerolatency"}
    )
    stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
    stream.codec_context.gop_size = RATE_HZ
    began = time.monotonic()
    for i in range(round(seconds * RATE_HZ)):
        time.sleep(max(0.0, began + i / RATE_HZ - time.monotonic()))
        picture = av.VideoFrame.from_ndarray(pictures[i % len(pictures)], format="rgb24")
        output.mux(stream.encode(picture))
    output.close()


@dataclass(frozen=True)
class Sample:
    """One result: when it was ready, how old, how many ranges; memory of the process, MB."""

    ready_s: float
    age_ms: float
    ranges: int
    rss_mb: float


class Watch:
    """A sink that keeps figures only."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []

    def __call__(self, result: LiveResult) -> None:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        rss_mb = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
        self.samples.append(Sample(result.ready_ns / 1e9, result.age_ms, result.status.ranges, rss_mb))


def steady(seconds: float) -> Telemetry:
    """A constant velocity at 20 Hz."""
    velocity = np.array([SPEED_M_S, 0.0, 0.0])
    # A filter's output is never twice the same; one that is would be taken for dead.
    noise = np.random.default_rng(0).normal(0, 0.02, (round(20 * seconds), 3))
    samples = [VelocitySample(round(i * 5e7), velocity + noise[i]) for i in range(len(noise))]
    return Telemetry("constant", tuple(samples))


def run(arguments: argparse.Namespace) -> tuple[list[Sample], dict[str, int]]:
    """Samples after the warm-up, and the pictures dropped."""
    network = load_network(arguments.network)
    store, size = MotionStore(), (arguments.size[0], arguments.size[1])
    stage = DepthStage(network, Lens(hfov_deg=FOV_DEG), store, ranges=arguments.ranges, fixed=False)
    stage.prepare(*size)
    address = video_address(f"udp://127.0.0.1:{arguments.port}")
    seconds = arguments.seconds + WARM_UP_S
    engine = LiveEngine(
        Parts(
            stage=stage,
            store=store,
            video=lambda listener: VideoInput(address, listener),
            motion=lambda engine: LogPlayer(
                steady(seconds + 60), store, epoch_ns=time.monotonic_ns(), on_velocity=engine.on_velocity
            ),
        )
    )
    watch = Watch()
    engine.add_sink("watch", watch)
    target = f"udp://127.0.0.1:{arguments.port}?pkt_size=1316"
    sender = multiprocessing.get_context("spawn").Process(target=send, args=(target, size, seconds + 30))
    sender.start()
    with engine:
        engine.run(threading.Event(), seconds)
        dropped = dict(engine.status().frames.dropped)
    sender.kill()
    sender.join()
    began_s = watch.samples[0].ready_s + WARM_UP_S
    return [sample for sample in watch.samples if sample.ready_s >= began_s], dropped


def figures(samples: list[Sample]) -> dict[str, object]:
    """Of the whole run, and of each quarter."""
    parts = [list(part) for part in np.array_split(np.array(samples, dtype=object), 4)]
    ages = np.array([sample.age_ms for sample in samples])
    return {
        "results": len(samples),
        "results_a_second": len(samples) / max(samples[-1].ready_s - samples[0].ready_s, 1e-9),
        "age_ms_p50": float(np.median(ages)),
        "age_ms_p95": float(np.percentile(ages, 95)),
        "age_ms_p95_by_quarter": [float(np.percentile([s.age_ms for s in part], 95)) for part in parts],
        "rss_mb_by_quarter": [part[-1].rss_mb for part in parts],
        "ranges_mean": float(np.mean([sample.ranges for sample in samples])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--network", default="motion-tiny")
    parser.add_argument("--ranges", type=int, default=2)
    parser.add_argument("--size", type=int, nargs=2, default=[256, 192], help="pictures, px")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--port", type=int, default=5655)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    arguments = parser.parse_args()
    samples, dropped = run(arguments)
    found = figures(samples) | {"dropped": dropped, "cpu": cpu(), "load_average": os.getloadavg()[0]}
    found |= {"cores": len(os.sched_getaffinity(0)), "network": arguments.network}
    for name, value in found.items():
        print(f"{name:24}{value}")
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
