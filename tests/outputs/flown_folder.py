"""A flight folder by hand: a camera that flies north past a wall of known distance and looks at it all the time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from output_samples import HEIGHT, SOURCE, WIDTH, known, unknown

from flightdepth.camera import Camera
from flightdepth.flight.records import Frame
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler
from flightdepth.outputs import FlightFolder, FlightWriter, Preview
from flightdepth.outputs.poses import FramePose

WALL_M = 20.0  # north of the first camera
STEP_M = 0.5
FRAMES = 12
LOOKING_NORTH = quaternion_from_rotation(NED_FROM_CAMERA)
LOOKING_EAST = quaternion_from_rotation(rotation_from_euler(0, 0, np.pi / 2) @ NED_FROM_CAMERA)
RED = (200, 40, 40)


def pose(index: int, north_m: float, *, segment: int = 0, attitude: str = "log") -> FramePose:
    known_attitude = LOOKING_NORTH if attitude != "unknown" else np.full(4, np.nan)
    return FramePose(
        index, index * 100_000_000, segment, np.array([north_m, 0.0, 0.0]), known_attitude, attitude
    )


def picture(index: int, camera: Camera | None = None) -> Frame:
    image = np.full((HEIGHT, WIDTH, 3), RED, np.uint8)
    return Frame(index, index * 100_000_000, image, camera=camera)


def write_flown(
    target: Path,
    frames: int = FRAMES,
    *,
    posed: bool = True,
    poses: list[FramePose] | None = None,
    cameras: dict[int, Camera] | None = None,
    camera: Camera = SOURCE.camera,
    ranges: int = 0,
    share: np.ndarray | float | None = None,
    **options: object,
) -> FlightFolder:
    """The wall, right in each frame; the first frame has no depth. `poses` in place of those of one segment.

    The preview shows so many `ranges`. `share` of the depth, [H, W] or one for all, is its error bar.
    """
    settings = SOURCE.settings | {"ranges": ranges, "preview_ranges": ranges > 0}
    source = SOURCE.model_copy(update={"camera": camera, "settings": settings})
    to_source = (lambda map_hw: map_hw) if ranges else None
    preview = Preview(WIDTH, HEIGHT, range_panels=ranges, to_source=to_source)
    if poses is None:
        poses = [pose(i, STEP_M * i) for i in range(frames)]
    with FlightWriter(target, source, preview, **options) as writer:
        for i in range(frames):
            result = known(WALL_M - STEP_M * i) if i else unknown("first frame")
            if i and share is not None:
                result = replace(result, sigma_m=(share * result.depth_m).astype(np.float32))
            writer.add(picture(i, (cameras or {}).get(i)), result, poses[i] if posed else None)
    return FlightFolder(target)
