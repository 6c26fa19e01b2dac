"""Frames per second of Blender's Cycles at 4 samples, for benchmarks/render.py: `cycles_frames_per_s(width)`."""

from __future__ import annotations

import time

from flightdepth.camera import Camera
from flightdepth.renderers.blender import Blender
from flightdepth.renderers.blender_process import find_blender
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene

TEXTURE_COUNT = 20
SCENES = 1  # of ten frames, after one that warms up


def cycles_frames_per_s(width: int, threads: int | None = None) -> tuple[float, float] | None:
    """Frames a second by the wall clock, and frames a second of one core's processor time; None without Blender.

    Whole scenes of ten frames, meshes and textures included, at 4 samples a pixel and 128 segments a sphere, on
    every core by default.
    """
    if find_blender() is None:
        return None
    camera, config, textures = (
        Camera.from_fov(width, width, 90),
        StillBoxConfig(),
        Textures.procedural(TEXTURE_COUNT, 1),
    )
    with Blender(threads=threads) as blender:

        def one(number: int) -> int:
            return len(blender.render(draw_scene(config, TEXTURE_COUNT, 5, number), textures, camera).images)

        one(0)
        began, began_cpu = time.perf_counter(), blender.processor_s + time.process_time()
        frames = sum(one(1 + number) for number in range(SCENES))
        wall_s = time.perf_counter() - began
        return frames / wall_s, frames / (blender.processor_s + time.process_time() - began_cpu)


if __name__ == "__main__":
    for edge in (64, 128, 256, 512):
        print(edge, cycles_frames_per_s(edge))
