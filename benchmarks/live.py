"""Age, drops, processor time and memory of a live run: python benchmarks/live.py [--seconds 20 | --minutes 60].

The sample flight comes again and again at 30 frames/s, as H.264 in RTP (or MPEG-TS) over UDP, from a process of
its own that encoded it beforehand, since a companion computer does not encode; what the sender costs is printed.
Velocities are fed at 20 Hz and no attitude, so direction and rotation must be seen in the pictures: the most work.
Ages count from the moment when the sender sent (RTCP; both clocks are this machine's), or with --transport ts
from reception. Everything shares the cores that this process may use: `taskset -c 0,1 python benchmarks/live.py`
is a computer with two.

--seconds: one table, and the time by stage. --minutes: a line a minute, how age and memory rise by the hour, and
the ten minutes in which others used these cores least.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, get_args

import av
import cv2
import numpy as np
from slopes import resident_mib, slope_an_hour

import flightdepth
from flightdepth.evaluation.provenance import network_facts, origin_of, source_commit
from flightdepth.files import without_nan, write_json
from flightdepth.flight.records import Telemetry, VelocitySample
from flightdepth.flight.steadiness import Steadiness
from flightdepth.flight.video import Video
from flightdepth.live.depth_stage import DepthStage, Lens
from flightdepth.live.engine import LiveEngine, Parts
from flightdepth.live.lens_watch import LensWatch
from flightdepth.live.log_player import LogPlayer
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.page import Page, PageServer
from flightdepth.live.sound_decoder import SoundDecoder
from flightdepth.live.status import LiveResult
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import VideoInput
from flightdepth.live.video_stream import Picture
from flightdepth.machine import usable_cores
from flightdepth.processor import cpu_name
from flightdepth.ranges.derotation import Derotation
from flightdepth.ranges.direction import SeenDirections
from flightdepth.ranges.estimator import MultiRangeEstimator
from flightdepth.ranges.plan import Planner
from flightdepth.ranges.seen import Seen
from flightdepth.ranges.view import View
from flightdepth.runtimes import network as runtimes_network
from flightdepth.runtimes.contract import Precision
from flightdepth.runtimes.network import Network, load_network

SAMPLE = Path(flightdepth.__file__).parent / "sample" / "flight.mp4"
RATE_HZ = 30
TICKS_HZ = 90_000
GROUP = 30  # pictures from one key frame to the next
WARM_UP_S = 5.0
SPEED_M_S = 5.7
FOV_DEG = 75.0
MOST_A_MINUTE = 70 * RATE_HZ
# What a picture goes through, in order; a stage that is part of another stands below it.
STAGES: tuple[tuple[str, Any, str], ...] = (
    ("decode", SoundDecoder, "decode"),
    ("to RGB", Picture, "rgb"),
    ("turning?", Steadiness, "add"),
    ("pairs", MultiRangeEstimator, "_pairs"),
    ("  direction", SeenDirections, "of"),
    ("derotate", Derotation, "of"),
    ("network", View, "predict"),
    ("  its inputs", Network, "_batch"),
    ("  aligning", runtimes_network, "align"),
    ("fuse", View, "fuse"),
    ("plan", Planner, "learn"),
    ("result", Seen, "result"),
    ("estimator, all", MultiRangeEstimator, "add_frame"),
    ("publish", LiveEngine, "_publish"),
)


def encoded(size: tuple[int, int]) -> list[bytes]:
    """The sample's first five seconds, forth and back, each picture as H.264; the first is a key frame."""
    with Video(SAMPLE, end_s=5.0) as video:
        forth = [cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA) for frame in video.frames()]
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = *size, "yuv420p"
    encoder.time_base, encoder.framerate, encoder.gop_size = Fraction(1, RATE_HZ), Fraction(RATE_HZ), GROUP
    encoder.options = {"preset": "ultrafast", "tune": "zerolatency"}
    packets: list[bytes] = []
    for i, image in enumerate(forth + forth[-2:0:-1]):
        picture = av.VideoFrame.from_ndarray(image, format="rgb24")
        picture.pts = i
        packets += [bytes(packet) for packet in encoder.encode(picture)]
    return packets


def send(target: str, transport: str, size: tuple[int, int], seconds: float, spent: Any) -> None:
    """Send as fast as a camera would; `spent` gets this process's processor seconds, and how many were sent."""
    packets = encoded(size)
    output = av.open(target, "w", format={"rtp": "rtp", "ts": "mpegts"}[transport])
    stream = output.add_stream("libx264", rate=RATE_HZ)
    stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
    spent[2] = 1.0
    began, began_cpu_s, ticks = time.monotonic(), time.process_time(), -1
    for i in range(round(seconds * RATE_HZ)):
        time.sleep(max(0.0, began + i / RATE_HZ - time.monotonic()))
        packet = av.Packet(packets[i % len(packets)])
        # Stamped when it leaves: on a busy machine this process is held up too, which no receiver can help.
        ticks = max(ticks + 1, round((time.monotonic() - began) * TICKS_HZ))
        packet.stream, packet.time_base, packet.pts, packet.dts = stream, Fraction(1, TICKS_HZ), ticks, ticks
        packet.is_keyframe = i % len(packets) % GROUP == 0
        output.mux(packet)
        spent[0], spent[1] = time.process_time() - began_cpu_s, i + 1


@dataclass(frozen=True)
class Minute:
    """One minute, or one run: results and their ages; what the process and its pictures cost."""

    results_a_second: float
    received_a_second: float
    age_ms_p50: float
    age_ms_p95: float
    age_ms_p99: float
    ranges_mean: float
    cpu_ms_a_result: float
    rss_mib: float
    from_sender: float
    others: float  # share of these cores that other processes used (the sender, and the host's others, among them)

    def line(self) -> str:
        """For people."""
        return (
            f"{self.results_a_second:5.1f} of {self.received_a_second:4.1f}/s   age {self.age_ms_p50:5.1f}"
            f" {self.age_ms_p95:5.1f} {self.age_ms_p99:5.1f} ms (p50 p95 p99)   n = {self.ranges_mean:.2f}"
            f"   {self.cpu_ms_a_result:5.1f} ms of processor a result   {self.rss_mib:6.1f} MiB"
            f"   others {self.others:4.0%}"
        )


def busy_s() -> float:
    """Seconds for which the cores that this process may use were busy since the machine started, summed."""
    cores = {f"cpu{core}" for core in os.sched_getaffinity(0)}
    rows = [line.split() for line in Path("/proc/stat").read_text().splitlines()]
    # proc(5): user nice system idle iowait irq softirq steal
    ticks = sum(sum(map(int, row[1:4] + row[6:9])) for row in rows if row[0] in cores)
    return ticks / os.sysconf("SC_CLK_TCK")


class Watch:
    """A sink that keeps figures in memory taken beforehand, so that memory measured is not its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows = np.ones((MOST_A_MINUTE, 3), dtype=np.float32)
        self._count = 0
        self._since = (0.0, 0.0, 0.0, 0)

    def __call__(self, result: LiveResult) -> None:
        with self._lock:
            if self._count < MOST_A_MINUTE:
                row = result.age_ms, result.status.ranges, result.status.age_from == "sender"
                self._rows[self._count] = row
                self._count += 1

    def begin(self, received: int) -> None:
        """Count from now on; `received`: pictures that the stream gave so far."""
        with self._lock:
            self._count = 0
        self._since = time.monotonic(), time.process_time(), busy_s(), received

    def end(self, received: int) -> Minute:
        """Figures since `begin`, which is now again."""
        began_s, began_cpu_s, began_busy_s, received_then = self._since
        seconds, cpu_s = time.monotonic() - began_s, time.process_time() - began_cpu_s
        others_s = max(0.0, busy_s() - began_busy_s - cpu_s)
        with self._lock:
            rows = self._rows[: self._count].copy()
        if not len(rows):
            raise SystemExit("no result came: is the port free?")
        p50, p95, p99 = np.percentile(rows[:, 0], [50, 95, 99])
        rss_mib = resident_mib()
        self.begin(received)
        return Minute(
            len(rows) / seconds,
            (received - received_then) / seconds,
            float(p50),
            float(p95),
            float(p99),
            float(rows[:, 1].mean()),
            1e3 * cpu_s / len(rows),
            rss_mib,
            float(rows[:, 2].mean()),
            others_s / (seconds * usable_cores()),
        )


class StageTimes:
    """Wall and processor time of each stage, a call; the processor's is that of the calling thread."""

    def __init__(self) -> None:
        self.wall_ms: dict[str, list[float]] = defaultdict(list)
        self.cpu_ms: dict[str, list[float]] = defaultdict(list)

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Each of STAGES is timed meanwhile."""
        before = [(owner, name, getattr(owner, name)) for _, owner, name in STAGES]
        for (label, owner, name), (_, _, function) in zip(STAGES, before, strict=True):
            setattr(owner, name, self._timed(label, function))
        try:
            yield
        finally:
            for owner, name, function in before:
                setattr(owner, name, function)

    def clear(self) -> None:
        """Forget what was before."""
        self.wall_ms.clear()
        self.cpu_ms.clear()

    def table(self, results: int) -> list[dict[str, Any]]:
        """A row a stage: wall time p50 and p95 of a call, and processor time a result, ms."""
        return [
            {
                "stage": label,
                "calls": len(self.wall_ms[label]),
                "wall_ms_p50": float(np.median(self.wall_ms[label])),
                "wall_ms_p95": float(np.percentile(self.wall_ms[label], 95)),
                "thread_cpu_ms_a_result": sum(self.cpu_ms[label]) / results,
            }
            for label, _, _ in STAGES
            if self.wall_ms[label]
        ]

    def _timed(self, label: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **options: Any) -> Any:
            wall, own = time.perf_counter(), time.thread_time()
            found = function(*arguments, **options)
            if isinstance(found, Iterator):
                found = list(found)
            self.wall_ms[label].append(1e3 * (time.perf_counter() - wall))
            self.cpu_ms[label].append(1e3 * (time.thread_time() - own))
            return found

        return timed


def steady(seconds: float) -> Telemetry:
    """A constant velocity at 20 Hz."""
    velocity = np.array([SPEED_M_S, 0.0, 0.0])
    # A filter's output is never twice the same; one that is would be taken for dead.
    noise = np.random.default_rng(0).normal(0, 0.02, (round(20 * seconds), 3))
    samples = [VelocitySample(round(i * 5e7), velocity + noise[i]) for i in range(len(noise))]
    return Telemetry("constant", tuple(samples))


@contextmanager
def flying(
    arguments: argparse.Namespace, seconds: float, network: Network
) -> Iterator[tuple[LiveEngine, Watch, Any]]:
    """An engine at work, its watch, and what the sender spends; begun and warm."""
    store, size = MotionStore(), (arguments.size[0], arguments.size[1])
    stage = DepthStage(network, Lens(hfov_deg=FOV_DEG), store, ranges=arguments.ranges, fixed=False)
    stage.prepare(*size)
    rtp, at = arguments.transport == "rtp", f"127.0.0.1:{arguments.port}"
    address = video_address(f"rtp://{at}" if rtp else f"udp://{at}")
    telemetry = steady(seconds + 120)
    engine = LiveEngine(
        Parts(
            stage=stage,
            store=store,
            lens=LensWatch(store),
            video=lambda listener: VideoInput(address, listener, sender_clock=rtp),
            motion=lambda engine: LogPlayer(
                telemetry, store, epoch_ns=time.monotonic_ns(), on_velocity=engine.on_velocity
            ),
        )
    )
    watch = Watch()
    engine.add_sink("watch", watch)
    spawn = multiprocessing.get_context("spawn")
    spent = spawn.Array("d", 3)
    target = f"rtp://{at}" if rtp else f"udp://{at}?pkt_size=1316"
    sender = spawn.Process(target=send, args=(target, arguments.transport, size, seconds + 60, spent))
    sender.start()
    stop = threading.Event()
    worker = threading.Thread(target=engine.run, args=(stop,))
    try:
        while not spent[2]:
            time.sleep(0.05)
        with engine:
            worker.start()
            time.sleep(WARM_UP_S)
            if arguments.page:
                page = Page(engine.status, None)
                engine.add_sink("page", page.take)
                with PageServer(page, arguments.page):
                    yield engine, watch, spent
            else:
                yield engine, watch, spent
            stop.set()
            worker.join()
    finally:
        stop.set()
        sender.kill()
        sender.join()


def run_once(arguments: argparse.Namespace, network: Network) -> dict[str, Any]:
    """The figures of `--seconds`, printed."""
    stages = StageTimes()
    with stages.taken(), flying(arguments, arguments.seconds, network) as (engine, watch, spent):
        stages.clear()
        watch.begin(engine.status().frames.received)
        dropped_then, (sent_cpu_s, sent, _) = Counter(engine.status().frames.dropped), tuple(spent)
        time.sleep(arguments.seconds)
        frames = engine.status().frames
        figures = watch.end(frames.received)
        table = stages.table(round(figures.results_a_second * arguments.seconds))
        sender_ms = 1e3 * (spent[0] - sent_cpu_s) / max(spent[1] - sent, 1)
    dropped = dict(Counter(frames.dropped) - dropped_then)
    print(figures.line())
    print(f"{'stage':18}{'calls':>6}{'wall p50':>10}{'p95 ms':>8}{'thread cpu, ms a result':>25}")
    for row in table:
        walls = f"{row['wall_ms_p50']:10.2f}{row['wall_ms_p95']:8.2f}"
        print(f"{row['stage']:18}{row['calls']:6}{walls}{row['thread_cpu_ms_a_result']:25.2f}")
    own = {"stages": table, "dropped": dropped, "sender_cpu_ms_a_picture": sender_ms}
    print(
        f"dropped {dropped}; sender {sender_ms:.2f} ms of processor a picture; from the sender's clock"
        f" {figures.from_sender:.0%}"
    )
    return asdict(figures) | own


def run_minutes(arguments: argparse.Namespace, network: Network) -> dict[str, Any]:
    """The figures of `--minutes`, printed as they come."""
    found: list[Minute] = []
    with flying(arguments, 60 * arguments.minutes, network) as (engine, watch, _):
        watch.begin(engine.status().frames.received)
        began, dropped_then = time.monotonic(), Counter(engine.status().frames.dropped)
        for minute in range(1, arguments.minutes + 1):
            time.sleep(max(0.0, began + 60 * minute - time.monotonic()))
            found.append(watch.end(engine.status().frames.received))
            print(f"minute {minute:3}  {found[-1].line()}", flush=True)
        dropped = dict(Counter(engine.status().frames.dropped) - dropped_then)
    age, rss = slopes(found)
    print(
        f"age p95 rises by {age[0]:.2f} +- {age[1]:.2f} ms an hour, memory by {rss[0]:.2f} +- {rss[1]:.2f} MiB"
    )
    print(f"dropped {dropped}")
    first = quietest(found)
    print(
        f"quietest ten minutes, others {np.mean([minute.others for minute in found[first : first + 10]]):.0%}:"
    )
    for i, minute in enumerate(found[first : first + 10], first + 1):
        print(f"minute {i:3}  {minute.line()}")
    return {
        "minutes": [asdict(minute) for minute in found],
        "quietest_from": first,
        "age_p95_ms_an_hour": list(age),
        "rss_mib_an_hour": list(rss),
        "dropped": dropped,
    }


def slopes(found: list[Minute]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Of age p95 (ms an hour) and of memory (MiB an hour), each with its standard error."""
    minutes = np.arange(len(found))
    age = slope_an_hour(minutes, np.array([minute.age_ms_p95 for minute in found]))
    return age, slope_an_hour(minutes, np.array([minute.rss_mib for minute in found]))


def quietest(found: list[Minute], length: int = 10) -> int:
    """Where the `length` minutes in a row begin in which others used these cores least."""
    sums = [
        sum(minute.others for minute in found[i : i + length]) for i in range(max(1, len(found) - length + 1))
    ]
    return int(np.argmin(sums))


def run(arguments: argparse.Namespace, precision: Precision | None) -> dict[str, Any]:
    """The figures of one precision, and what was measured."""
    network = load_network(arguments.network, precision=precision)
    print(f"{arguments.network}: {origin_of(network)}", flush=True)
    figures = run_minutes if arguments.minutes else run_once
    return figures(arguments, network) | {"network": network_facts(network)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--network", default="tiny-clamped-256")
    parser.add_argument(
        "--precision", nargs="+", choices=get_args(Precision), default=[None], help="one after the other"
    )
    parser.add_argument("--ranges", type=int, default=2, help="at most")
    parser.add_argument("--size", type=int, nargs=2, default=[256, 192], help="pictures, px")
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--minutes", type=int, help="instead of --seconds")
    parser.add_argument("--transport", choices=["rtp", "ts"], default="rtp")
    parser.add_argument("--page", metavar="HOST:PORT", help="with the page, for a browser to look at")
    parser.add_argument("--port", type=int, default=5654)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    arguments = parser.parse_args()
    wanted = arguments.precision[:1] if arguments.minutes else arguments.precision
    found: dict[str, Any] = {"runs": {str(each or "auto"): run(arguments, each) for each in wanted}}
    found |= {"cpu": cpu_name(), "cores": usable_cores(), "load_average": os.getloadavg()[0]}
    found |= {
        "commit": source_commit(),
        "ranges": arguments.ranges,
        "transport": arguments.transport,
        "size": arguments.size,
    }
    print(
        f"{found['cpu']}, {found['cores']} in use, {arguments.network}, {arguments.size}, {arguments.transport}"
    )
    if arguments.json:
        write_json(arguments.json, without_nan(found))


if __name__ == "__main__":
    main()
