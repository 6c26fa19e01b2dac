"""The ray caster: exact z-depth at pixel centres, antialiased colour, analytic shapes, one thread per frame.

A frame takes three passes: trace what each pixel's centre sees, shade those hits, then look again with 2x2 rays
where a pixel stands beside an edge (of an object, a face, a cast shadow or a fold).
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
from flightdepth.renderers.antialiasing import is_edge, supersample
from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.shading import Blockers, shade, sky_colour
from flightdepth.renderers.shadows import Lists, list_blockers
from flightdepth.renderers.surfaces import encoded
from flightdepth.renderers.tracing import PARTS, SKY, Labels, trace_picture
from flightdepth.renderers.view import Records, View, prepare_view, prepare_world
from flightdepth.scenes.scene import Floats, Ints, Scene
from flightdepth.scenes.textures import Textures

VERSION = "raycast-2"
TILE = 8  # pixels; the objects that may cast a shadow are listed per tile and surface


@dataclass(frozen=True)
class Rendered:
    """Frames of one scene: images uint8 RGB [F, H, W, 3], depth_m float32 z-depth [F, H, W] (sky: infinite)."""

    images: NDArray[np.uint8]
    depth_m: NDArray[np.float32]


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
        BadInput: the scene wears a texture that `textures` does not hold.
    """
    if scene.materials.texture.max(initial=-1) >= len(textures):
        raise BadInput(
            "textures of the scene",
            expected=f"at least {scene.materials.texture.max() + 1}",
            got=str(len(textures)),
            mend="Draw the scene with the number of textures that it is rendered with.",
        )
    numbers = range(scene.frames) if frames is None else frames
    world = prepare_world(scene)
    images = np.empty((len(numbers), camera.height, camera.width, 3), np.uint8)
    depth_m = np.empty((len(numbers), camera.height, camera.width), np.float32)

    def one(place: int) -> None:
        view = prepare_view(scene, world, camera, numbers[place])
        _render_frame(*view, textures.texels, *_memory(view, camera, images[place], depth_m[place]))

    for _ in (executor.map if executor else map)(one, range(len(numbers))):
        pass
    return Rendered(images, depth_m)


def _memory(
    view: View, camera: Camera, image: NDArray[np.uint8], depth_m: NDArray[np.float32]
) -> tuple[Any, ...]:
    """Where a frame is worked on: colour, depth, label and blockers of each pixel and of a border of one pixel,
    scratch for lists; then where the results go.
    """
    size, lamps = (camera.height + 2, camera.width + 2), len(view.lamps)
    return (
        np.empty((*size, 3), np.float32),
        np.empty(size, np.float64),
        np.empty(size, np.int32),
        np.empty((*size, lamps), np.int16),
        np.empty((lamps, len(view.things) + 5), np.int16),  # five pixels may name a blocker each
        np.empty(lamps, np.int16),
        image,
        depth_m,
    )


@compiled
def _render_frame(
    cameras: Records, things: Records, near_to_far: Ints, materials: Records, lamps: Records,
    texels: NDArray[np.uint8], colour: NDArray[np.float32], depth: Floats, label: Labels, blockers: Blockers,
    lists: Lists, found: NDArray[np.int16], image: NDArray[np.uint8], depth_m: NDArray[np.float32],
) -> None:  # fmt: skip
    """Fill image [H, W, 3] and depth_m [H, W]; a border of one pixel is worked on too, to see edges across it."""
    rows, columns = depth.shape
    trace_picture(cameras, things, near_to_far, depth, label)
    for top in range(0, rows, TILE):
        for left in range(0, columns, TILE):
            _shade_tile(
                cameras,
                things,
                materials,
                lamps,
                lists,
                texels,
                colour,
                depth,
                label,
                blockers,
                found,
                top,
                left,
            )
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            r, g, b = colour[i, j, 0], colour[i, j, 1], colour[i, j, 2]
            if is_edge(things, depth, label, blockers, i, j):
                r, g, b = supersample(
                    cameras, things, materials, lamps, lists,
                    texels, colour, depth, label, blockers, found, i, j,
                )  # fmt: skip
            depth_m[i - 1, j - 1] = depth[i, j]
            image[i - 1, j - 1, 0], image[i - 1, j - 1, 1], image[i - 1, j - 1, 2] = (
                encoded(r),
                encoded(g),
                encoded(b),
            )


@compiled
def _shade_tile(
    cameras: Records, things: Records, materials: Records, lamps: Records, lists: Lists,
    texels: NDArray[np.uint8], colour: NDArray[np.float32], depth: Floats, label: Labels, blockers: Blockers,
    found: NDArray[np.int16], top: int, left: int,
) -> None:  # fmt: skip
    """Shade the pixels of a tile, one thing after the other, so that each thing's blockers are listed once."""
    bottom, right = min(top + TILE, label.shape[0]), min(left + TILE, label.shape[1])
    done = -(2**31)  # things are taken in the order of their numbers
    while True:
        k = 2**31 - 1
        for i in range(top, bottom):
            for j in range(left, right):
                thing = label[i, j] // PARTS
                if done < thing < k:
                    k = thing
        if k == 2**31 - 1:
            return
        done = k
        if k != SKY:
            _list_for_tile(cameras, things, lamps, lists, depth, label, k, top, left, bottom, right)
        for i in range(top, bottom):
            for j in range(left, right):
                if label[i, j] // PARTS != k:
                    continue
                x, y = (j - 1 - cameras[0].cx) / cameras[0].fx, (i - 1 - cameras[0].cy) / cameras[0].fy
                if k == SKY:
                    r, g, b = sky_colour(cameras, x, y)
                    found[:] = -1
                else:
                    part = label[i, j] % PARTS
                    r, g, b = shade(
                        cameras, things, materials, lamps, lists, texels, k, part, x, y, depth[i, j], found
                    )
                colour[i, j, 0], colour[i, j, 1], colour[i, j, 2] = r, g, b
                for lamp in range(len(lamps)):
                    blockers[i, j, lamp] = found[lamp]


@compiled
def _list_for_tile(
    cameras: Records, things: Records, lamps: Records, lists: Lists, depth: Floats, label: Labels,
    k: int, top: int, left: int, bottom: int, right: int,
) -> None:  # fmt: skip
    """List what may shade those pixels of a tile that see thing k, by a box round them in camera space."""
    low_x, low_y, low_z, high_x, high_y, high_z = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for i in range(top, bottom):
        for j in range(left, right):
            if label[i, j] // PARTS == k:
                t = depth[i, j]
                x, y = (
                    t * (j - 1 - cameras[0].cx) / cameras[0].fx,
                    t * (i - 1 - cameras[0].cy) / cameras[0].fy,
                )
                low_x, high_x = min(low_x, x), max(high_x, x)
                low_y, high_y = min(low_y, y), max(high_y, y)
                low_z, high_z = min(low_z, t), max(high_z, t)
    x, y, z = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y), 0.5 * (low_z + high_z)
    dx, dy, dz = high_x - low_x, high_y - low_y, high_z - low_z
    c = cameras[0]
    list_blockers(
        things, lamps, k,
        c.position_0 + c.turn_00 * x + c.turn_01 * y + c.turn_02 * z,
        c.position_1 + c.turn_10 * x + c.turn_11 * y + c.turn_12 * z,
        c.position_2 + c.turn_20 * x + c.turn_21 * y + c.turn_22 * z,
        0.5 * np.sqrt(dx * dx + dy * dy + dz * dz) + 0.01, lists,
    )  # fmt: skip
