"""Turns told beside a near foreground, held against the truth: python benchmarks/foreground_turns.py [--scenes N].

Rendered pairs outdoors, 0.1 s apart at 5 m/s, 80 degrees wide: a wall stands so many metres before the camera over a
share of the picture, far land beside it. Each pair also turns about the vertical, with the parallax or against it.
Told is what `flight/rotation.py` says, from the points that `flight/steadiness.py` follows.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.rotation import Flow, likeliest_rotation
from flightdepth.flight.steadiness import (
    FEWEST_FOLLOWED,
    MAX_DEROTATED_RAD,
    MIN_FOLLOWED,
    NOISE_PX,
    follow,
    small_camera,
    small_grey,
)
from flightdepth.motion import Vector
from flightdepth.renderers.raycast import render
from flightdepth.scenes.outdoor import draw_outdoor
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import VARIANTS, Surface, outdoor_textures
from flightdepth.scenes.scene import Scene, Shape
from flightdepth.stillbox.photometric import through_jpeg

CAMERA = Camera.from_fov(320, 180, 80.0)
CONFIG = OutdoorConfig(frames=2, turn_over_s=0.01, height_m=(6.0, 9.0))
SEED = 77
NOISE_LEVELS, JPEG_QUALITY = 4.0, 50
MOVED_M = 0.5
NEAR_M = (1.5, 2.5, 4.0, 8.0, 16.0, 50.0)  # 50: as good as no wall
SHARES = (0.4, 0.8)  # of the picture's width that the wall covers
HEADINGS = {"sideways": (1.0, 0.0, 0.0), "slanting": (0.7071, 0.0, 0.7071), "ahead": (0.0, 0.0, 1.0)}
TURNS_RAD = (0.0, 0.0075, -0.0075, 0.02, -0.02, 0.06, -0.06)
FAR_OFF_SHARE, FAR_OFF_RAD = 0.2, 0.004  # of the turn, and at least


@dataclass(frozen=True)
class Case:
    """A pair: what stands how near, which way it flew, and how it turned (rad, to the right)."""

    near_m: float
    share: float
    heading: str
    turn_rad: float


def walled(scene: Scene, near_m: float, share: float, texture: int) -> Scene:
    """With a brick wall across the left `share` of the first picture, `near_m` ahead."""
    if near_m >= 50:
        return scene
    across = near_m * CAMERA.width / CAMERA.fx  # what the picture shows there
    edge = (share - 0.5) * across
    half = np.array([2 * across, across, 0.25])
    centre = np.array([edge - half[0], 0.0, near_m + 0.25])
    pose = np.column_stack(
        [scene.world_from_camera[0] * half, scene.camera_position[0] + scene.world_from_camera[0] @ centre]
    )
    return scene.with_object(Shape.CUBE, pose, texture=texture, colour=np.full(3, 0.9), repeats=4.0)


def pairs(number: int) -> Iterator[tuple[Case, Flow | None]]:
    """Of one scene: each case, and the points followed; None where `flight/steadiness.py` takes too few for any."""
    small, textures = small_camera(CAMERA), outdoor_textures(0)
    bare = draw_outdoor(CONFIG, SEED, number)
    rng = np.random.default_rng(number)
    start, looks = bare.camera_position[0], bare.world_from_camera[0]
    wall = int(VARIANTS * list(Surface)[number % len(Surface)] + number % VARIANTS)
    flown = [(name, turn_rad) for name in HEADINGS for turn_rad in TURNS_RAD]
    positions = [start, *(start + looks @ np.array(HEADINGS[name]) * MOVED_M for name, _ in flown)]
    turns = [looks, *(looks @ cv2.Rodrigues(np.array([0.0, turn, 0.0]))[0] for _, turn in flown)]
    for near_m in NEAR_M:
        for share in SHARES if near_m < 50 else SHARES[:1]:
            scene = walled(bare, near_m, share, wall)
            scene = replace(scene, camera_position=np.array(positions), world_from_camera=np.array(turns))
            images = render(scene, textures, CAMERA).images
            first, *others = (small_grey(filmed(image, rng), small) for image in images)
            for (name, turn_rad), grey in zip(flown, others, strict=True):
                before, after, found = follow(first, grey)
                enough = len(before) >= max(FEWEST_FOLLOWED, MIN_FOLLOWED * found)
                flow = Flow.between(before, after, small) if enough else None
                yield Case(near_m, share, name, turn_rad), flow


def filmed(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """A picture with a sensor's noise, through JPEG."""
    noisy = np.clip(image + rng.normal(0, NOISE_LEVELS, image.shape), 0, 255).astype(np.uint8)
    return through_jpeg(noisy, JPEG_QUALITY)


def told(flow: Flow) -> Vector:
    """The rotation vector told, (3,)."""
    return likeliest_rotation(flow, NOISE_PX / small_camera(CAMERA).fx)


def is_wrong(case: Case, turn: Vector) -> bool:
    """Whether a rotation told is off by a fifth, and by more than a steady camera's noise."""
    off_rad = float(np.linalg.norm(turn - np.array([0.0, case.turn_rad, 0.0])))
    return off_rad > max(FAR_OFF_RAD, FAR_OFF_SHARE * abs(case.turn_rad))


def with_moving(flow: Flow, rng: np.random.Generator) -> Flow:
    """A fifth of the points, side by side, moves by itself, by some 4 px of the small pictures."""
    motions, fifth = flow.motions.copy(), len(flow.points) // 5
    motions[np.argsort(flow.points @ rng.normal(size=2))[:fifth]] += (
        rng.normal(size=2) * 4 / small_camera(CAMERA).fx
    )
    return Flow(flow.points, motions)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--moving", action="store_true", help="a fifth of the points moves by itself")
    given, rng = parser.parse_args(), np.random.default_rng(SEED)
    seen = [
        (case, flow) for number in range(given.scenes) for case, flow in pairs(number) if flow is not None
    ]
    rows = [(case, told(with_moving(flow, rng) if given.moving else flow)) for case, flow in seen]
    print("pairs, off by a fifth %, median off mrad; steady ones refused %, too fast ones let pass %")
    for near_m, share in {(case.near_m, case.share): None for case, _ in rows}:
        here = [row for row in rows if (row[0].near_m, row[0].share) == (near_m, share)]
        print(f"{near_m:6.1f} m {share:4.1f}", line(here))
    for heading in HEADINGS:
        print(f"{heading:13}", line([row for row in rows if row[0].heading == heading]))
    print(f"{'all':13}", line(rows))


def line(rows: list[tuple[Case, Vector]]) -> str:
    """Figures of some pairs."""
    wrong = np.mean([is_wrong(case, turn) for case, turn in rows])
    off_rad = np.median([np.linalg.norm(turn - np.array([0.0, case.turn_rad, 0.0])) for case, turn in rows])
    fast = {
        slow: [np.linalg.norm(turn) > MAX_DEROTATED_RAD for case, turn in rows if is_slow(case) == slow]
        for slow in (True, False)
    }
    refused, passed = np.mean(fast[True]), 1 - np.mean(fast[False])
    return f"{len(rows):5d}{100 * wrong:6.0f}{1e3 * off_rad:7.1f}{100 * refused:7.1f}{100 * passed:7.1f}"


def is_slow(case: Case) -> bool:
    """Whether a pair can be used."""
    return abs(case.turn_rad) <= MAX_DEROTATED_RAD


if __name__ == "__main__":
    main()
