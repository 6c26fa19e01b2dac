"""A camera's path in the words of the original metadata, and back.

There, space is [right, up, forward] of the first frame; here it is x right, y down, z forward. `speed` is in m/s,
`orientation` holds a quaternion wxyz for each frame, world from camera, and is empty where the camera does not
turn. The authors' loaders take frame i to stand at i * time_step * speed. Only a path that is not straight and
even needs more: `position`, metres, [right, up, forward] for each frame, which they do not read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flightdepth.motion import quaternion_from_rotation, rotation_from_quaternion
from flightdepth.scenes.scene import Floats, Scene

MIRRORED = np.array([1.0, -1.0, 1.0])  # x right, y down, z forward <-> right, up, forward
# A mirror turns the axis of a rotation to minus its image: (x, y, z) -> (-x, y, -z).
MIRRORED_QUATERNION = np.array([1.0, -1.0, 1.0, -1.0])
SAME_M = 1e-9  # two paths as near as this are one


def described_path(scene: Scene, time_step_s: float) -> dict[str, Any]:
    """`length`, `speed`, `time_step`, `orientation` and, where it is needed, `position` of a scene."""
    first_from_world = scene.world_from_camera[0].T
    position = (scene.camera_position - scene.camera_position[0]) @ first_from_world.T
    turns = first_from_world @ scene.world_from_camera
    mean_step = position[-1] / max(scene.frames - 1, 1)
    facts = {
        "length": scene.frames,
        "speed": (mean_step / time_step_s * MIRRORED).tolist(),
        "time_step": time_step_s,
        "orientation": [] if np.allclose(turns, np.eye(3), rtol=0, atol=1e-12) else _orientation(turns),
    }
    even = np.arange(scene.frames)[:, None] * mean_step
    if np.abs(position - even).max() > SAME_M:
        facts["position"] = (position * MIRRORED).tolist()
    return facts


def path_from(facts: Mapping[str, Any]) -> tuple[Floats, Floats]:
    """camera_position [F, 3] metres and world_from_camera [F, 3, 3]; the world has the first frame's axes."""
    frames = len(facts["imgs"])
    if "position" in facts:
        position = np.array(facts["position"], dtype=np.float64)
    else:
        step = np.array(facts["speed"], dtype=np.float64) * facts["time_step"]
        position = np.arange(frames)[:, None] * step
    known = np.array(facts.get("orientation") or [[1.0, 0.0, 0.0, 0.0]], dtype=np.float64)
    turns = np.array([rotation_from_quaternion(each) for each in known * MIRRORED_QUATERNION])
    return position * MIRRORED, np.repeat(turns, frames // len(turns), axis=0)  # one for all, or one each


def _orientation(turns: Floats) -> list[list[float]]:
    return [(quaternion_from_rotation(turn) * MIRRORED_QUATERNION).tolist() for turn in turns]
