"""The ray caster beside Blender's Cycles: the same scenes, two programs that share no code."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import Image
from flightdepth.renderers import raycast
from flightdepth.renderers.blender import Blender
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.scenes import Scene, Textures

JUMP = 0.01  # relative bend of inverse depth that makes an edge
OFF = 0.01  # relative difference of a pixel that counts as off
MEDIAN_LIMIT, OFF_LIMIT = 1e-6, 2e-4  # what the two renderers should keep
# Outdoors the ground is the top of spheres of up to 130 m, met at a flat angle: chords of Blender's mesh show. The
# median falls to a quarter with twice the segments (docs/stillbox-blender.md).
OUTDOOR_MEDIAN_LIMIT = 1e-3
GAIN = 4  # of the difference in the picture


@dataclass(frozen=True)
class Frame:
    """One frame by both renderers: uint8 RGB [H, W, 3] and z-depth [H, W] in metres, infinite in the sky."""

    scene: int
    ours: Image
    theirs: Image
    our_depth_m: Maps
    their_depth_m: Maps

    @property
    def edges(self) -> Flags:
        """Where either depth has an edge nearby, [H, W]."""
        return edges(self.our_depth_m) | edges(self.their_depth_m)

    @property
    def seen(self) -> Flags:
        """Where not both see sky, [H, W]."""
        return np.isfinite(self.our_depth_m) | np.isfinite(self.their_depth_m)

    @property
    def relative(self) -> NDArray[np.float64]:
        """|theirs / ours - 1|, [H, W]; 0 where both see sky, infinite where one does."""
        ours, theirs = self.our_depth_m.astype(np.float64), self.their_depth_m.astype(np.float64)
        both, neither = np.isfinite(ours) & np.isfinite(theirs), np.isinf(ours) & np.isinf(theirs)
        difference = np.divide(theirs, ours, out=np.ones_like(ours), where=both) - 1
        return np.asarray(np.where(both | neither, np.abs(difference), np.inf))


def edges(depth_m: Maps) -> Flags:
    """Pixels in whose 3x3 neighbourhood inverse depth bends by more than JUMP of itself, [H, W].

    Inverse depth is linear in pixels on every plane, however slanted, so that steps bend it and slopes do not.
    """
    inverse = 1 / depth_m.astype(np.float64)
    found = np.zeros(depth_m.shape, np.uint8)
    for axis in (0, 1):
        w = np.moveaxis(inverse, axis, 0)
        if len(w) > 2:
            bend = np.abs(w[2:] - 2 * w[1:-1] + w[:-2])
            limit = JUMP * np.maximum(np.maximum(w[2:], w[1:-1]), w[:-2])
            np.moveaxis(found, axis, 0)[1:-1] |= bend > limit
    return np.asarray(cv2.dilate(found, np.ones((3, 3), np.uint8)) > 0)


def both_ways(
    scenes: Iterable[tuple[int, Scene]], textures: Textures, camera: Camera, blender: Blender
) -> Iterator[Frame]:
    """The middle frame of every (number, scene)."""
    for number, scene in scenes:
        middle = [scene.frames // 2]
        ours = raycast.render(scene, textures, camera, frames=middle)
        theirs = blender.render(scene, textures, camera, frames=middle)
        yield Frame(number, ours.images[0], theirs.images[0], ours.depth_m[0], theirs.depth_m[0])


def figures(frames: list[Frame], median_limit: float = MEDIAN_LIMIT) -> dict[str, Any]:
    """All numbers. Shares are of pixels, those off by more than OFF without the sky; colours are bytes, 0..255."""
    relative, edge = np.stack([f.relative for f in frames]), np.stack([f.edges for f in frames])
    colour = np.stack([np.abs(f.ours.astype(np.int16) - f.theirs) for f in frames]).mean(axis=-1)
    seen = np.stack([f.seen for f in frames])
    inside, beside = relative[~edge & seen], relative[edge & seen]
    depth = {
        "median": median(inside),
        "off_share": share(inside > OFF),
        "edge_share": share(edge),
        "edge_off_share": share(beside > OFF),
        "sky_in_one_share": share(np.isinf(relative)),
    }
    return {
        "pixels": relative.size,
        "limits": {"median": median_limit, "off_share": OFF_LIMIT},
        "depth": depth,
        "within_limits": share(inside > median_limit) < 0.5 and share(inside > OFF) < OFF_LIMIT,
        "colour": {
            "mean_difference": float(colour.mean()),
            "mean_difference_off_edges": None if edge.all() else float(colour[~edge].mean()),
            "mean_ours": float(np.mean([f.ours.mean() for f in frames])),
            "mean_theirs": float(np.mean([f.theirs.mean() for f in frames])),
        },
        "scenes": [scene_figures(frame) for frame in frames],
    }


def scene_figures(frame: Frame) -> dict[str, Any]:
    """The same for one scene, to find the worst."""
    relative, edge = frame.relative, frame.edges
    inside = relative[~edge & frame.seen]
    return {
        "scene": frame.scene,
        "median": median(inside),
        "off_pixels": int((inside > OFF).sum()),
        "edge_pixels": int(edge.sum()),
        "edge_off_pixels": int((relative[edge] > OFF).sum()),
        "colour_mean_difference": float(np.abs(frame.ours.astype(np.int16) - frame.theirs).mean()),
    }


def median(values: NDArray[np.float64]) -> float | None:
    """None for nothing and for infinity, which JSON has not."""
    middle = float(np.median(values)) if values.size else np.inf
    return middle if np.isfinite(middle) else None


def share(chosen: Flags) -> float:
    """0..1; 0 of nothing."""
    return float(chosen.mean()) if chosen.size else 0.0


def picture(frames: list[Frame]) -> Image:
    """A row per frame: ray caster, Cycles, their difference GAIN times as strong; RGB."""
    rows = []
    for frame in frames:
        difference = np.abs(frame.ours.astype(np.int16) - frame.theirs) * GAIN
        rows.append(np.hstack([frame.ours, frame.theirs, difference.clip(0, 255).astype(np.uint8)]))
    return np.vstack(rows)
