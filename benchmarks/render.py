"""Frames per second of the ray caster: `python benchmarks/render.py [--seconds 4] [--scaling] [--json FILE]`.

Before it, how long the textures take that scenes wear; beside it, where Blender is installed, Cycles at 4 samples in
the same run. `--scaling` adds how the cost of a frame grows with objects, pixels and threads.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from flightdepth.camera import Camera
from flightdepth.evaluation.provenance import source_commit
from flightdepth.files import write_json
from flightdepth.machine import usable_cores
from flightdepth.processor import cpu_name
from flightdepth.renderers.blender import Blender
from flightdepth.renderers.blender_process import find_blender
from flightdepth.renderers.raycast import VERSION, render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene

SEED = 5
TEXTURES = 64
WIDTHS = (64, 128, 256, 512)
CYCLES_SCENES = 4  # the first of those that the ray caster renders, by Cycles


@dataclass(frozen=True)
class Rate:
    """Frames/s by the clock, and by processor time: what the same cores reach when nothing else runs on them."""

    clock: float
    processor: float


def raycast_rate(
    width: int, textures: Textures, seconds: float, threads: int, config: StillBoxConfig | None = None
) -> Rate:
    """Whole scenes of ten frames, one a thread, drawing included; compiled before the clocks start."""
    camera, drawn, coming = Camera.from_fov(width, width, 90), config or StillBoxConfig(), count()

    def one(number: int) -> int:
        return len(render(draw_scene(drawn, len(textures), SEED, number), textures, camera).images)

    one(0)
    began, began_cpu, frames = time.perf_counter(), time.process_time(), 0
    with ThreadPoolExecutor(threads) as executor:
        while time.perf_counter() - began < seconds:
            frames += sum(executor.map(one, [next(coming) for _ in range(4 * threads)]))
    clock, processor = time.perf_counter() - began, time.process_time() - began_cpu
    return Rate(frames / clock, threads * frames / processor)


def cycles_rate(blender: Blender, width: int, textures: Textures, threads: int) -> Rate:
    """The first of the same scenes through Cycles, drawing, meshes, textures and the exchange of files included."""
    camera, config = Camera.from_fov(width, width, 90), StillBoxConfig()

    def one(number: int) -> int:
        scene = draw_scene(config, len(textures), SEED, number)
        return len(blender.render(scene, textures, camera).images)

    one(CYCLES_SCENES)  # warms up
    began, began_cpu = time.perf_counter(), blender.processor_s + time.process_time()
    frames = sum(map(one, range(CYCLES_SCENES)))
    clock = time.perf_counter() - began
    processor = blender.processor_s + time.process_time() - began_cpu
    return Rate(frames / clock, threads * frames / processor)


def print_rates(ours: dict[int, Rate], theirs: dict[int, Rate]) -> None:
    print(
        "   size  by the clock  by processor time"
        + ("   Cycles: clock  processor     ratio" if theirs else "")
    )
    for width, rate in ours.items():
        print(f"{width:4d} px{rate.clock:14.0f}{rate.processor:19.0f}", end="" if theirs else "\n")
        if theirs:
            slow = theirs[width]
            ratios = f"{rate.clock / slow.clock:.0f} / {rate.processor / slow.processor:.0f}"
            print(f"{slow.clock:16.1f}{slow.processor:11.1f}{ratios:>10s}")


def print_scaling(textures: Textures, seconds: float, threads: int) -> dict[str, dict[int, Rate]]:
    """How the cost of a frame grows: with objects (128 px), with pixels, with threads (128 px)."""
    few = {n: StillBoxConfig(meshes=(n, n)) for n in (0, 5, 10, 20, 40, 80)}
    tables = {
        "objects": {n: raycast_rate(128, textures, seconds, 1, config) for n, config in few.items()},
        "width": {w: raycast_rate(w, textures, seconds, 1) for w in (32, *WIDTHS, 1024)},
        "threads": {n: raycast_rate(128, textures, seconds, n) for n in range(1, threads + 1)},
    }
    for name, table in tables.items():
        print(f"{name:>8s}  frames/s by the clock  ms of processor time a frame")
        for number, rate in table.items():
            cores = number if name == "threads" else 1
            print(f"{number:8d}{rate.clock:23.0f}{1000 * cores / rate.processor:30.3f}")
    return tables


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--threads", type=int, default=usable_cores())
    parser.add_argument("--scaling", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    began, began_cpu = time.perf_counter(), time.process_time()
    textures = Textures.procedural(TEXTURES, 1)
    made = {"clock": time.perf_counter() - began, "processor": time.process_time() - began_cpu}
    print(f"{TEXTURES} textures in {made['clock']:.1f} s, {made['processor']:.1f} s of processor time")
    print(f"{VERSION}, {options.threads} threads on {cpu_name()}, frames/s")
    ours = {w: raycast_rate(w, textures, options.seconds, options.threads) for w in WIDTHS}
    theirs: dict[int, Rate] = {}
    if find_blender() is None:
        print("Cycles is left out: Blender is not installed")
    else:
        with Blender(threads=options.threads) as blender:
            theirs = {w: cycles_rate(blender, w, textures, options.threads) for w in WIDTHS}
    print_rates(ours, theirs)
    scaling = print_scaling(textures, options.seconds, options.threads) if options.scaling else {}
    if options.json:
        facts = {
            "commit": source_commit(),
            "renderer": VERSION,
            "seed": SEED,
            "cpu": cpu_name(),
            "threads": options.threads,
            "seconds": options.seconds,
            "textures_s": made,
        }
        tables = {"raycast": ours, "cycles at 4 samples": theirs} | scaling
        figures = {name: {n: vars(rate) for n, rate in table.items()} for name, table in tables.items()}
        write_json(options.json, facts | {"frames_per_s": figures})


if __name__ == "__main__":
    main()
