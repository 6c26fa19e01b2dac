"""Frames per second of the ray caster: `python benchmarks/render.py [--seconds 4] [--json FILE]`."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import VERSION, render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene


def cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    names = [line.split(":")[1] for line in info.read_text().splitlines() if line.startswith("model name")]
    return names[0].strip() if names else platform.processor()


def frames_per_s(width: int, textures: Textures, seconds: float, threads: int) -> tuple[float, float]:
    """Whole scenes of ten frames, one a thread, drawing included; compiled before the clocks start.

    By the wall clock, and by processor time: what the same cores reach when nothing else runs on them.
    """
    camera, config = Camera.from_fov(width, width, 90), StillBoxConfig()
    scenes = iter(range(10**9))

    def one(number: int) -> int:
        return len(render(draw_scene(config, len(textures), 5, number), textures, camera).images)

    one(0)
    began, began_cpu, frames = time.perf_counter(), time.process_time(), 0
    with ThreadPoolExecutor(threads) as executor:
        while time.perf_counter() - began < seconds:
            frames += sum(executor.map(one, [next(scenes) for _ in range(4 * threads)]))
    return frames / (time.perf_counter() - began), threads * frames / (time.process_time() - began_cpu)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    threads = os.cpu_count() or 1
    textures = Textures.procedural(64, 1)
    rates = {w: frames_per_s(w, textures, options.seconds, threads) for w in (64, 128, 256, 512)}
    print(f"{VERSION} on {threads} cores of {cpu_name()}, frames/s")
    print("   size  by the clock  by processor time")
    for width, (wall, processor) in rates.items():
        print(f"{width:4d} px{wall:14.0f}{processor:19.0f}")
    if options.json:
        facts = {"renderer": VERSION, "cpu": cpu_name(), "threads": threads, "seconds": options.seconds}
        names = ("by_the_clock", "by_processor_time")
        figures = {width: dict(zip(names, pair, strict=True)) for width, pair in rates.items()}
        options.json.write_text(json.dumps(facts | {"frames_per_s": figures}, indent=2))


if __name__ == "__main__":
    main()
