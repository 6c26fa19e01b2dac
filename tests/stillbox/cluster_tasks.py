"""Renderers that go wrong on a worker; in a module of their own, which is sent to the workers whole."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers import raycast
from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes import Scene, Textures

DIED = "FLIGHTDEPTH_TEST_DIED"  # a file that tells the first worker from the next


def dies_once(scene: Scene, textures: Textures, camera: Camera) -> Rendered:
    """The first worker is killed in the middle of its task."""
    died = Path(os.environ[DIED])
    if not died.exists():
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return raycast.render(scene, textures, camera)


def fails(scene: Scene, textures: Textures, camera: Camera) -> Rendered:
    """A bug."""
    raise ZeroDivisionError("no light\nat all")


def refuses(scene: Scene, textures: Textures, camera: Camera) -> Rendered:
    """A user's mistake that only the worker sees."""
    raise BadInput("blender", expected="version 4.5", got="2.79")
