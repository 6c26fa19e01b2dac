"""What stands in a network's place in the study: optical flow, one fixed shift, one constant depth."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from flightdepth.camera import Camera
from flightdepth.evaluation.baseline_methods import PeerMethod
from flightdepth.flight.records import VelocityFrame
from flightdepth.levels import Image
from flightdepth.motion import Vector
from flightdepth.ranges import DepthNetwork, RangedDepth
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.fusion import fuse
from flightdepth.ranges.pairs import Frame, baselines
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

# Displacement at which DIS flow is taken to reach 100 m, through 128 px. Of 0.3 (as DepthNet), 0.75 and 1.5 m the one
# that served the peer best; so with the output that its displacements are chosen for.
FLOW_D0_M, FLOW_BEST_BETA = 0.75, 0.2


def flow_card(focal_px: float) -> NetworkCard:
    """The range of DIS flow: 100 m at FLOW_D0_M through 128 px; it needs the direction."""
    return NetworkCard(
        name="DIS flow",
        architecture="MotionNet",
        base_width=1,
        activation="none",
        nominal_shift=3,
        D0_m=FLOW_D0_M * 128 / focal_px,
        depth_min_m=0.0,
        depth_max_m=100.0,
        best_beta=FLOW_BEST_BETA,
        focal_px=focal_px,
        width=round(2 * focal_px),
        height=round(2 * focal_px),
        samples=0,
    )


class FlowNetwork:
    """DIS flow and triangulation where a network would be: the estimator picks its pairs and fuses its maps."""

    def __init__(self, focal_px: float) -> None:
        self.card = flow_card(focal_px)
        self._peer = PeerMethod((self.card,))

    def grid(self, camera: Camera, /) -> NetworkGrid:
        """The grid for one source camera."""
        return NetworkGrid(camera, self.card.focal_px)

    def predict(
        self,
        previous_n: Sequence[Image],
        current: Image,
        displacements_n3: Vector,
        camera: Camera,
        valid: Flags | None = None,
        /,
    ) -> Prediction:
        """See `DepthNetwork`; where flow tells nothing depth is the peer's guess, as a network's is its own."""
        pairs = zip(previous_n, displacements_n3, strict=True)
        found = [self._peer.answer(previous, current, moved, camera).depth_m for previous, moved in pairs]
        depth_m = np.stack(found)
        reach_m = self.card.alpha * np.linalg.norm(displacements_n3, axis=1).astype(np.float32)
        beta = np.clip(depth_m / reach_m[:, None, None], 0, 1).astype(np.float32)
        return Prediction(
            beta, depth_m, None, np.ones(depth_m.shape[1:], np.bool_) if valid is None else valid
        )


class FixedShift:
    """The paper without its section IV: each frame with the one `shift` frames before, whatever it shows."""

    def __init__(self, network: DepthNetwork, camera: Camera, shift: int) -> None:
        self._network, self._grid = network, network.grid(camera)
        self._card = network.card.at_focal(self._grid.camera.fx)
        self._trajectory = Trajectory()
        self._frames: deque[Frame] = deque(maxlen=shift)
        self._shift, self._given = shift, 0

    def add_velocity(self, stamp_ns: int, velocity: ArrayLike, *, frame: VelocityFrame = "world") -> None:
        """As the estimator's."""
        self._trajectory.add_velocity(stamp_ns, velocity, frame=frame, sigma=None)

    def add_frame(self, stamp_ns: int, image: Image) -> RangedDepth:
        """As the estimator's."""
        frames = tuple(self._frames)
        self._given += 1
        self._frames.append(Frame(self._given, stamp_ns, self._grid.image(image)))
        if len(frames) < self._shift:
            return RangedDepth.unknown(image.shape[0], image.shape[1], "too few frames", 0.0)
        moved = baselines(self._trajectory, frames[:1], stamp_ns, np.pi).displacement_m[:1]
        camera, length_m = self._grid.camera, np.linalg.norm(moved, axis=1)
        found = self._network.predict([frames[0].image], self._frames[-1].image, moved, camera)
        fused = fuse(found.beta, length_m, self._card, fusion="paper")
        for map_hw in (fused.depth_m, fused.confidence, fused.farther_than_m, fused.nearer_than_m):
            self._grid.to_source(map_hw)  # for the time that it takes: the truth has the network's size
        return RangedDepth(
            depth_m=fused.depth_m,
            confidence=fused.confidence,
            sigma_m=None,
            range_depths_m=found.depth_m,
            shifts=np.array([self._shift]),
            displacements_m=length_m,
            centroids_m=np.array([np.nan]),
            farther_than_m=fused.farther_than_m,
            nearer_than_m=fused.nearer_than_m,
            latency_ms=0.0,
        )


def least_relative_m(truth_m: Maps) -> float:
    """The one depth with the least mean |error| / truth over all known pixels: the median weighed by 1 / truth."""
    known = np.sort(truth_m[np.isfinite(truth_m) & (truth_m > 0)].astype(np.float64))
    if not known.size:
        return float("nan")
    weight = np.cumsum(1 / known)
    return float(known[np.searchsorted(weight, weight[-1] / 2)])
