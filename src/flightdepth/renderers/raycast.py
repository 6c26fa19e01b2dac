"""The ray caster: exact z-depth at pixel centres, antialiased colour, analytic shapes, one thread per frame.

A frame takes three passes: trace what each pixel's centre sees, shade those hits, then look again with 2x2 rays
where a pixel stands beside an edge (of an object, a face, a cast shadow or a fold). Each pass works on many rays
side by side: rows of pixels, a tile's pixels on one face, the rays through a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.machine import memory_bytes
from flightdepth.renderers.antialiasing import AROUND, is_fold, mark_edges, supersample
from flightdepth.renderers.bundles import BUNDLE, LANES
from flightdepth.renderers.compiling import announce_compiling, compiled
from flightdepth.renderers.shading import Blockers, Colours
from flightdepth.renderers.shadows import Lists
from flightdepth.renderers.surfaces import encoded
from flightdepth.renderers.tiles import NOBODY, TILE, shade_tile
from flightdepth.renderers.tracing import PARTS, Labels, trace_picture
from flightdepth.renderers.view import Records, World, place_things, prepare_cameras, prepare_world
from flightdepth.scenes.scene import MOST_LAMPS, MOST_OBJECTS, Floats, Ints, Scene
from flightdepth.scenes.textures import MEMORY_SHARE, Textures

VERSION = "raycast-2"
DONE_BYTES = 3 + 4  # a pixel, of each frame that is returned
WORKED_BYTES = 8 + 4 + 12 + 4  # a pixel, of the frame that is worked on, without its lamps


@dataclass(frozen=True)
class Rendered:
    """Frames of one scene: images uint8 RGB [F, H, W, 3], depth_m float32 z-depth [F, H, W] (sky: infinite)."""

    images: NDArray[np.uint8]
    depth_m: NDArray[np.float32]


def check_textures(scene: Scene, textures: Textures) -> None:
    """Refuse a scene that wears a texture that `textures` does not hold."""
    if scene.materials.texture.max(initial=-1) >= len(textures):
        raise BadInput(
            "textures of the scene",
            expected=f"at least {scene.materials.texture.max() + 1}",
            got=str(len(textures)),
            mend="Draw the scene with the number of textures that it is rendered with.",
        )


def check_memory(camera: Camera, frames: int) -> None:
    """Refuse pictures of `camera`, of so many frames at once, that this machine has not the memory for."""
    needed, most = _bytes(camera, frames), MEMORY_SHARE * memory_bytes()
    if needed > most:
        raise BadInput(
            "pictures of a scene",
            expected=f"at most {most / 1e9:.1f} GB of memory",
            got=f"{needed / 1e9:.1f} GB, for {frames} of {camera.width}x{camera.height} px",
            mend="Smaller pictures, or fewer frames.",
        )


def scenes_in_memory(camera: Camera, frames: int) -> float:
    """How many scenes of so many frames, pictures of `camera`, this machine has the memory for at a time."""
    return MEMORY_SHARE * memory_bytes() / _bytes(camera, frames)


def _bytes(camera: Camera, frames: int) -> int:
    return camera.width * camera.height * (frames * DONE_BYTES + WORKED_BYTES)


def render(
    scene: Scene,
    textures: Textures,
    camera: Camera,
    *,
    frames: Sequence[int] | None = None,
    executor: Executor | None = None,
) -> Rendered:
    """Render frames of a scene (all by default) with an ideal pinhole camera.

    A crop of a larger picture is the picture of `camera.cropped(...)`, byte for byte. With an executor of
    threads the frames are rendered side by side; the result is the same.

    Raises:
        BadInput: the scene wears a texture that `textures` does not hold, or has too many lamps or objects, or its
            pictures do not fit into memory.
    """
    check_textures(scene, textures)
    counts = {"lamps": (len(scene.lamp_position), MOST_LAMPS), "objects": (len(scene.shape), MOST_OBJECTS)}
    for what, (count, most) in counts.items():
        if count > most:
            raise BadInput(f"{what} of the scene", expected=f"at most {most}", got=str(count))
    numbers = range(scene.frames) if frames is None else frames
    check_memory(camera, len(numbers))
    announce_compiling(_render_frames)
    world, cameras = prepare_world(scene), prepare_cameras(scene, camera, numbers)
    images = np.empty((len(numbers), camera.height, camera.width, 3), np.uint8)
    depth_m = np.empty((len(numbers), camera.height, camera.width), np.float32)

    def some(first: int, last: int) -> None:
        things = world.things.copy()  # the threads write into it what depends on the camera
        _render_frames(
            cameras[first:last], things, world.materials, world.lamps, textures.texels,
            images[first:last], depth_m[first:last], *_memory(world, camera),
        )  # fmt: skip

    if executor is None:
        some(0, len(numbers))
    else:
        for _ in executor.map(some, range(len(numbers)), range(1, len(numbers) + 1)):
            pass
    return Rendered(images, depth_m)


def _rays(pixels: int, focal: float, middle: float) -> Floats:
    """x (or y) of the rays (x, y, 1) a quarter pixel before, through and behind each pixel's centre, [3, W + 2]."""
    centres = np.arange(pixels + 2) - 1 + np.array([[-0.25], [0.0], [0.25]])
    return np.asarray((centres - middle) / focal)


def _memory(world: World, camera: Camera) -> tuple[Any, ...]:
    """Rays of the pixels, and where a frame is worked on: depth, label, colour, dark lamps and blockers of each
    pixel and of a border of one pixel, the objects' order, lists of blockers, the sort of a tile, bundles of rays.
    """
    size, lamps, things = (camera.height + 2, camera.width + 2), len(world.lamps), len(world.things)
    return (
        _rays(camera.width, camera.fx, camera.cx),
        _rays(camera.height, camera.fy, camera.cy),
        np.empty(size, np.float64),
        np.empty(size, np.int32),
        np.empty((*size, 3), np.float32),
        np.empty(size, np.int32),
        np.empty((*size, lamps), np.int16),
        np.empty(size[1], np.bool_),
        np.empty(things - 1, np.int64),
        np.empty((lamps, things), np.int16),
        np.full(PARTS * (things + 1), NOBODY, np.int64),
        np.empty(LANES, np.int64),
        np.empty(LANES, np.int64),
        np.empty((lamps, LANES), np.int16),
        np.zeros(1, BUNDLE),
        np.zeros(1, BUNDLE),
        np.zeros(1, AROUND),
    )


@compiled
def _render_frames(
    cameras: Records, things: Records, materials: Records, lamps: Records, texels: NDArray[np.uint8],
    images: NDArray[np.uint8], depth_m: NDArray[np.float32],
    across: Floats, down: Floats, depth: Floats, label: Labels, colour: Colours, dark: Labels, blockers: Blockers,
    edge: NDArray[np.bool_], near_to_far: Ints, lists: Lists, heads: Ints, chain: Ints, kinds: Ints,
    found: Blockers, bundles: Records, quads: Records, around: Records,
) -> None:  # fmt: skip
    """Fill images [F, H, W, 3] and depth_m [F, H, W]; a border of one pixel is traced too, for the edges across it."""
    rows, columns = depth.shape
    for frame in range(len(cameras)):
        one = cameras[frame : frame + 1]
        place_things(one, things, near_to_far)
        trace_picture(one, things, near_to_far, across, down, bundles, depth, label)
        for top in range(0, rows, TILE):
            for left in range(0, columns, TILE):
                shade_tile(
                    one, things, materials, lamps, lists, texels, across, down, depth, label,
                    colour, dark, blockers, heads, chain, kinds, bundles, found, top, left,
                )  # fmt: skip
        for i in range(1, rows - 1):
            mark_edges(label, dark, i, edge)
            for j in range(1, columns - 1):
                r, g, b = colour[i, j, 0], colour[i, j, 1], colour[i, j, 2]
                if edge[j] or is_fold(things, depth, label, i, j):
                    r, g, b = supersample(
                        one, things, materials, lamps, lists, texels, across, down, depth, label,
                        colour, dark, blockers, around, quads, bundles, found, i, j,
                    )  # fmt: skip
                depth_m[frame, i - 1, j - 1] = depth[i, j]
                pixel = images[frame, i - 1, j - 1]
                pixel[0], pixel[1], pixel[2] = encoded(r), encoded(g), encoded(b)
