"""Turns taken out that were none, and true ones told wrong: python benchmarks/false_turns.py [--scenes N].

Pairs of rendered flights that did not turn: filmed at 640x360, through H.264, seen at the sizes of `motion-tiny` and
`motion`, over four displacements each, those kept of which half of the picture moves by 0.8 to 12 px. The rays of
their tracks are then turned about random axes. The direction is told as a log would, half a degree off.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.motion import Vector
from flightdepth.ranges.remainder import FEWEST_POINTS, remainder
from flightdepth.ranges.tracks import Corners
from flightdepth.renderers.raycast import render
from flightdepth.scenes import Scene, StillBoxConfig, Textures, chance, draw_scene
from flightdepth.scenes.outdoor import draw_outdoor
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox.h264 import through_h264
from flightdepth.stillbox.motion_noise import tilted
from flightdepth.stillbox.testset import test_textures

WIDTH, HEIGHT, SEEN_WIDTHS = 640, 360, (224, 448)
LENSES_DEG = (75.0, 30.0)
RATE_FACTOR = 19.0
SEED = 701
FRAMES_BACK = {"rooms": (12, 6, 3, 1), "outdoors": (16, 8, 4, 2)}
MOVED_PX = 0.8, 12.0
TILT_DEG = 0.5
TURNS_DEG = (0.0, 0.05, 0.1, 0.25, 1.0)
WRONG_SIGMAS = 2.0  # about any axis


@dataclass(frozen=True)
class Tracks:
    """Rays [N, 3] of a pair that did not turn, its displacement (3,) and camera."""

    now: Vector
    before: Vector
    displacement: Vector
    camera: Camera


def drawn(kind: str, number: int) -> tuple[Scene, Textures, int]:
    """A flight, its textures, and the frame that is current: ahead or aside outdoors, any way in rooms."""
    if kind == "rooms":
        textures = test_textures(SEED)
        return draw_scene(StillBoxConfig(frames=20), len(textures), SEED, number), textures, 12 + number % 8
    config = OutdoorConfig(frames=180, legs="any" if number % 2 else "forward-sideways")
    scene = draw_outdoor(config, SEED, number)
    return scene, outdoor_textures(SEED), 150 if number % 4 > 1 else 40


def tracked(kind: str, lens_deg: float, number: int) -> Iterator[Tracks]:
    """The pairs of one flight, at both sizes."""
    scene, textures, current = drawn(kind, number)
    camera = Camera.from_fov(WIDTH, HEIGHT, lens_deg)
    frames = [*(current - back for back in FRAMES_BACK[kind]), current]
    seen = render(scene, textures, camera, frames=frames)
    depth_m, film = float(np.median(seen.depth_m[-1])), through_h264(list(seen.images), RATE_FACTOR)
    moved = scene.camera_position[current] - scene.camera_position[frames[:-1]]
    for width in SEEN_WIDTHS:
        small = camera.resized(width, width * HEIGHT // WIDTH)
        size = small.width, small.height
        *earlier, last = (
            np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8) for picture in film
        )
        corners = Corners(last, small)
        for picture, displacement in zip(earlier, moved @ scene.world_from_camera[current], strict=True):
            now, before = corners.rays(picture)
            moved_px = small.fx * float(np.linalg.norm(displacement)) / depth_m
            if len(now) >= FEWEST_POINTS and MOVED_PX[0] < moved_px < MOVED_PX[1]:
                yield Tracks(now, before, displacement, small)


def judged(tracks: Tracks, turn_deg: float, number: int) -> tuple[bool, bool, float, Vector]:
    """Whether a turn is said, whether it is wrong by more than it says, degrees left, errors (3,) in deviations."""
    rng = np.random.default_rng(number)
    turn = chance.unit_vector(rng) * np.radians(turn_deg)
    before = tracks.before @ cv2.Rodrigues(turn)[0]
    told = tilted(tracks.displacement, chance.unit_vector(rng), TILT_DEG)
    found = remainder(tracks.now, before / before[:, 2:], told, tracks.camera)
    assert found is not None, "as many points as it asks for were kept"
    error = found.rotation - turn
    sigmas = error / np.sqrt(np.diag(found.covariance)[:3])
    left = error if found.turns else turn
    return (
        found.turns,
        bool(np.abs(sigmas).max() > WRONG_SIGMAS),
        float(np.degrees(np.linalg.norm(left))),
        sigmas,
    )


def report(kind: str, lens_deg: float, scenes: int) -> None:
    """Print a line for each turn."""
    pairs = [tracks for number in range(scenes) for tracks in tracked(kind, lens_deg, number)]
    for turn_deg in TURNS_DEG:
        each = [judged(tracks, turn_deg, number) for number, tracks in enumerate(pairs)]
        said, wrong, left_deg, sigmas = (np.array(values) for values in zip(*each, strict=True))
        spread = np.sqrt(np.mean(sigmas**2, axis=0))
        print(
            f"{kind:10}{lens_deg:4.0f}{len(pairs):6d}{turn_deg:7.2f}{said.mean():9.1%}{(said & wrong).mean():9.1%}"
            + "".join(f"{np.percentile(left_deg, share):8.3f}" for share in (50, 90, 98))
            + "".join(f"{axis:7.2f}" for axis in spread)
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=48)
    scenes = parser.parse_args().scenes
    cv2.setNumThreads(1)
    print("lens, pairs, degrees turned by: said to turn, and wrong by two deviations; left 50, 90, 98 %;")
    print("errors of x, y, z in deviations (root mean square)")
    for lens_deg in LENSES_DEG:
        for kind in FRAMES_BACK:
            report(kind, lens_deg, scenes)


if __name__ == "__main__":
    main()
