"""What pictures are taken through, and all that hangs on it: the network's grid, the mask, who follows corners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, Image
from flightdepth.ranges.derotation import Derotation
from flightdepth.ranges.exposure import ExposedFrames
from flightdepth.ranges.fusion import Fused, Fusion, fuse
from flightdepth.ranges.motion_error import widened
from flightdepth.ranges.network import AtSource, DepthNetwork, Map
from flightdepth.ranges.pairs import Baselines, Frame, Pair
from flightdepth.ranges.tracks import Tracker
from flightdepth.ranges.turning import in_view, is_visible, turned
from flightdepth.ranges.vignetting import Vignetting
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.contract import OUTPUT_STRIDE
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard


class View:
    """A camera's pictures on a network's grid. Each pair is tracked once for all who ask what its pictures show.

    camera        of the pictures that are given
    grid          of the network for it; `grid.camera` is the ideal one of prepared pictures
    shown         [h, w] which outputs show the scene, None where nothing is masked
    max_turn_rad  beyond it too little of an earlier picture is left
    """

    def __init__(self, network: DepthNetwork, camera: Camera, mask: Flags | None) -> None:
        """`mask` [H, W] of the camera's size: what shows the scene."""
        self.camera, self.grid = camera, network.grid(camera)
        self.shown: Flags | None = None
        if mask is not None:
            self.grid = self.grid.masked(mask)
            self.shown = self.grid.valid
        self.max_turn_rad = math.radians(camera.horizontal_fov_deg) / 4
        ideal = self.grid.camera
        self.tracker = Tracker(ideal, self.shown)
        self.derotation = Derotation(ideal, self.tracker)
        self.vignetting = Vignetting(ideal, self.shown)

    def prepared(self, image: Image) -> AnyImage:
        """A picture [H, W, 3] on the grid, in memory of its own: the caller may write its next frame into `image`."""
        picture = self.grid.image(image)
        return picture.copy() if picture is image else picture

    def scene_of(self, picture: Image) -> Image:
        """A prepared picture, black where it is masked: a clock that is burned in ticks on in a frozen one."""
        if self.shown is None:
            return picture
        shown = self.shown.repeat(OUTPUT_STRIDE, axis=0).repeat(OUTPUT_STRIDE, axis=1)
        return np.where(shown[..., None], picture, np.uint8(0))

    def evened(self, frame: Frame) -> Frame:
        """The frame without what the lens darkens."""
        return replace(frame, image=self.vignetting.evened(frame.image))

    def exposed(self, lines: Baselines, current: Frame) -> Baselines:
        """`lines` whose frames are evened out and as bright as the current one."""
        evened, ideal = self.vignetting.evened, self.grid.camera
        return replace(lines, frames=ExposedFrames(lines, current.image, ideal, self.shown, evened=evened))

    def predict(self, pairs: Sequence[Pair], current: Frame, network: DepthNetwork) -> Prediction:
        """One batch through the network; earlier frames first turned into the current orientation."""
        ideal = self.grid.camera
        previous = [
            turned(pair.previous.image, pair.current_from_previous, ideal, pair.bend)
            if pair.bend is not None or is_visible(pair.turn_rad, ideal)
            else pair.previous.image
            for pair in pairs
        ]
        displacements_n3 = np.stack([pair.displacement_m for pair in pairs])
        if self.shown is None:
            return widened(network.predict(previous, current.image, displacements_n3, ideal), pairs, ideal)
        found = network.predict(previous, current.image, displacements_n3, ideal, self.shown)
        return widened(found, pairs, ideal).where(self.shown)

    def fuse(
        self, pairs: Sequence[Pair], prediction: Prediction, card: NetworkCard, *, fusion: Fusion
    ) -> Fused:
        """The depths of all pairs as one, without what an earlier picture did not show before its turn."""
        ideal, seen = self.grid.camera, None
        if any(is_visible(pair.turn_rad, ideal) for pair in pairs):
            valid = self.grid.valid
            seen = np.stack([in_view(pair.current_from_previous, ideal, valid) for pair in pairs])
        lengths_m = np.array([pair.length_m for pair in pairs])
        sigma_m = prediction.sigma_m
        return fuse(prediction.beta, lengths_m, card, fusion=fusion, sigma_m=sigma_m, seen=seen)

    def at_source(self, depth_m: Map, image: AnyImage) -> AtSource:
        """Depth [h, w] along the edges of its prepared picture, [H, W], and what brings other maps there."""
        return self.grid.along_edges(depth_m, image)

    def to_source(self, map_hw: Map) -> Map | None:
        """A map [h, w] at [H, W]; None where it is of another grid."""
        return self.grid.to_source(map_hw) if map_hw.shape == self.grid.valid.shape else None
