"""Blender's Cycles as a reference for the ray caster, and as a renderer of whole sets: another program, the same Scene.

Depth goes through the pixel's centre as in `raycast`; shapes are fine meshes. Direct light with hard shadows, an
ambient share and a highlight with the same height and width. See docs/stillbox-blender.md for what differs.
"""

from __future__ import annotations

import atexit
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.renderers.blender_data import (
    SENSOR_MM,
    lens,
    mesh_names,
    scene_arrays,
    texture_atlas,
    write_atlas,
)
from flightdepth.renderers.blender_process import BlenderProcess, Program, needed_blender
from flightdepth.renderers.exr import read_exr
from flightdepth.renderers.meshes import Mesh, cube_face, primitive
from flightdepth.renderers.raycast import Rendered, check_textures
from flightdepth.scenes.scene import Scene, Shape
from flightdepth.scenes.textures import Textures

SAMPLES = 4  # a pixel
FINE, COARSE = 512, 128  # segments round a sphere: for comparisons, for pictures
SKY_M = 1e9  # Blender writes 1e10 where a ray meets nothing
FRAME_TIMEOUT_S = 600.0

_SHARED: dict[int, Blender] = {}  # the one process that all threads use, by its samples a pixel
_SHARING = threading.Lock()  # held to look at it or to change it


class Blender:
    """One process of Blender that renders many scenes; threads may share it, one scene is rendered at a time.

    samples     rays a pixel
    segments    of a sphere or a torus round its axis: chords lie within 5 / segments^2 of its radius
    threads     of Cycles, None for every core
    """

    def __init__(
        self,
        *,
        samples: int = SAMPLES,
        segments: int = COARSE,
        threads: int | None = None,
        program: Program | None = None,
        timeout_s: float = FRAME_TIMEOUT_S,
    ) -> None:
        self._samples, self._segments, self._threads, self._timeout_s = samples, segments, threads, timeout_s
        self._lock = threading.Lock()
        self._home = tempfile.TemporaryDirectory(prefix="flightdepth-blender-")
        self._folder = Path(self._home.name)
        try:
            self._process = BlenderProcess(program or needed_blender(), self._folder)
        except BaseException:
            self._home.cleanup()
            raise

    @property
    def name(self) -> str:
        """Which Blender, and how it was found."""
        program = self._process.program
        return f"Blender {self._process.version} ({program.path}, by {program.found_by})"

    @property
    def processor_s(self) -> float:
        """Processor time that Blender had used at its last frame."""
        return self._process.processor_s

    def render(
        self, scene: Scene, textures: Textures, camera: Camera, *, frames: Sequence[int] | None = None
    ) -> Rendered:
        """Render frames of a scene (all by default) with an ideal pinhole camera, as `raycast.render` does.

        Raises:
            BadInput: the scene wears a texture that `textures` does not hold.
            FlightDepthError: Blender failed, ended or took too long.
        """
        check_textures(scene, textures)
        numbers = list(range(scene.frames) if frames is None else frames)
        images = np.empty((len(numbers), camera.height, camera.width, 3), np.uint8)
        depth_m = np.empty((len(numbers), camera.height, camera.width), np.float32)
        with self._lock, tempfile.TemporaryDirectory(dir=self._folder) as name:
            request = self._request(scene, textures, camera, numbers, Path(name))
            try:
                for place in self._process.ask(request, len(numbers), self._timeout_s):
                    path = Path(request["frames"].format(place))
                    images[place], depth_m[place] = read_frame(path)
                    path.unlink()
            except BaseException:
                self._process.close()  # its next answers would be late ones to this request
                raise
        return Rendered(images, depth_m)

    def close(self) -> None:
        """End the process and remove its files."""
        self._process.close()
        self._home.cleanup()

    def __enter__(self) -> Blender:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _request(
        self, scene: Scene, textures: Textures, camera: Camera, frames: list[int], folder: Path
    ) -> dict[str, Any]:
        """Write the scene as files; what the script is told of them."""
        atlas = texture_atlas(scene.materials, textures)
        write_atlas(folder / "atlas.tif", atlas)
        np.savez(folder / "scene.npz", allow_pickle=False, **scene_arrays(scene, frames, atlas))
        objects = mesh_names(scene)
        meshes = {
            name: str(self._mesh_file(name, Shape(int(shape)), float(radius), folder))
            for name, shape, radius in zip(objects, scene.shape, scene.torus_radius, strict=True)
        }
        if not scene.is_open:
            walls = [f"wall-{part}" for part in range(6)]
            meshes |= {name: str(self._wall_file(part)) for part, name in enumerate(walls)}
            objects = objects + walls
        return {
            "scene": str(folder / "scene.npz"),
            "atlas": str(folder / "atlas.tif"),
            "objects": objects,
            "meshes": meshes,
            "frames": str(folder / "{:06d}.exr"),
            "width": camera.width,
            "height": camera.height,
            "lens": lens(camera),
            "sensor_mm": SENSOR_MM,
            "samples": self._samples,
            "threads": self._threads,
        }

    def _mesh_file(self, name: str, shape: Shape, radius: float, folder: Path) -> Path:
        """A torus is the scene's own, other shapes serve every scene."""
        path = (folder if shape is Shape.TORUS else self._folder) / f"{name}.npz"
        if not path.exists():
            write_mesh(path, primitive(shape, radius, self._segments))
        return path

    def _wall_file(self, part: int) -> Path:
        path = self._folder / f"wall-{part}.npz"
        if not path.exists():
            write_mesh(path, cube_face(part))
        return path


def render(
    scene: Scene,
    textures: Textures,
    camera: Camera,
    *,
    frames: Sequence[int] | None = None,
    samples: int = SAMPLES,
) -> Rendered:
    """As `Blender.render`, by a process that later calls share, until one fails or Python ends."""
    blender = _shared(samples)
    try:
        return blender.render(scene, textures, camera, frames=frames)
    except BaseException:
        with _SHARING:
            if _SHARED.get(samples) is blender:  # else another thread has begun a new one
                del _SHARED[samples]
        raise


def _shared(samples: int) -> Blender:
    with _SHARING:
        if samples not in _SHARED:
            blender = Blender(samples=samples)
            atexit.register(blender.close)
            _SHARED[samples] = blender
        return _SHARED[samples]


def read_frame(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Image uint8 RGB [H, W, 3] and z-depth [H, W] in metres of the file that Blender wrote; sky: infinite."""
    channels = {name.split(".", 1)[-1]: values for name, values in read_exr(path).items()}
    linear = np.stack([channels[f"Combined.{colour}"] for colour in "RGB"], -1)
    depth_m = next(values for name, values in channels.items() if name.startswith("Depth."))
    image = np.rint(255 * np.clip(linear, 0, 1) ** (1 / 2.2)).astype(np.uint8)  # as `surfaces.encoded`
    return image, np.where(depth_m < SKY_M, depth_m, np.float32(np.inf))


def write_mesh(path: Path, mesh: Mesh) -> None:
    """As arrays without pickles."""
    np.savez(path, vertices=mesh.vertices, triangles=mesh.triangles, uv=mesh.uv)
