"""The multi-range estimator: the block diagram of the paper's figure 8, one method a block."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.ranges.direction import SeenDirections
from flightdepth.ranges.displacement import Trajectory, VelocityFrame
from flightdepth.ranges.fusion import Fused, Fusion, fuse
from flightdepth.ranges.network import DepthNetwork, Image, Map
from flightdepth.ranges.pairs import Frame, FrameBuffer, Pair, baselines, pick, seen_from
from flightdepth.ranges.plan import Planner
from flightdepth.ranges.result import RangedDepth
from flightdepth.ranges.turning import in_view, is_visible, turned
from flightdepth.runtimes.prediction import Prediction

MAX_RANGES = 4
NO_DIRECTION = "direction of motion unknown: no log tells it, and too few tracked points do"
NON_ROTATING = "camera-frame velocity without attitude: the camera is taken not to turn"


class MultiRangeEstimator:
    """Frames and motion in, depth out; one estimator a flight, not for use from several threads at once.

    Each frame is paired with `ranges` (1..4) earlier ones of the last `buffer_s` seconds, chosen so that the
    network sees each cluster of the last depth at its best output; the n depths are fused.

    Motion may be given ahead of the frames, and should be when it is known: then displacements are exact at
    the frame times. In real time the last velocity holds for half a second; after that depth is unknown.
    The attitude must be the camera's (of the gimbal, not of the body): where it is known at both frames,
    the earlier picture is turned into the current orientation before the network sees it. Give none for
    pictures that are already stabilised.
    """

    def __init__(
        self,
        network: DepthNetwork,
        camera: Camera,
        *,
        ranges: int = 2,
        fusion: str = "saturation",
        buffer_s: float = 4.0,
    ) -> None:
        if not 1 <= ranges <= MAX_RANGES:
            raise BadInput("ranges", expected=f"1 to {MAX_RANGES}", got=str(ranges))
        if fusion not in {kind.value for kind in Fusion}:
            raise BadInput("fusion", expected="saturation or paper", got=repr(fusion))
        if not (np.isfinite(buffer_s) and buffer_s > 0):
            raise BadInput("buffer", expected="more than 0 seconds", got=str(buffer_s))
        self._network, self._camera, self._fusion = network, camera, Fusion(fusion)
        self._grid = network.grid(camera)
        self._card = network.card.at_focal(self._grid.camera.fx)
        self._trajectory = Trajectory()
        self._directions = SeenDirections(self._grid.camera)
        self._buffer = FrameBuffer(buffer_s)
        self._planner = Planner(
            self._card,
            ranges,
            sides=min(camera.width / camera.fx, camera.height / camera.fy),
            memory_s=buffer_s,
            saturation=self._fusion is Fusion.SATURATION,
        )
        # Beyond a quarter of the view too little of the earlier picture is left.
        self._max_turn_rad = math.radians(camera.horizontal_fov_deg) / 4
        self._span_ns = round(buffer_s * 1e9)
        self._last_ns: int | None = None
        self._frames_given = 0

    @property
    def dropped(self) -> Mapping[str, int]:
        """What was given and not used, counted by cause."""
        return Counter(self._trajectory.dropped)

    def add_velocity(
        self,
        stamp_ns: int,
        velocity: ArrayLike,
        *,
        frame: VelocityFrame = "world",
        sigma: float | None = None,
    ) -> None:
        """Velocity (3,) in m/s, world (NED) or camera frame; `sigma`: deviation per axis, m/s."""
        self._trajectory.add_velocity(stamp_ns, velocity, frame=frame, sigma=sigma)

    def add_attitude(self, stamp_ns: int, world_from_camera: ArrayLike) -> None:
        """The camera's orientation as a quaternion (w, x, y, z)."""
        self._trajectory.add_attitude(stamp_ns, world_from_camera)

    def add_pose(self, stamp_ns: int, world_from_camera: ArrayLike) -> None:
        """The camera's pose (4, 4); once one is given, poses replace velocities and attitudes."""
        self._trajectory.add_pose(stamp_ns, world_from_camera)

    def add_frame(self, stamp_ns: int, image: Image, *, unusable: str | None = None) -> RangedDepth:
        """Depth of `image` [H, W, 3] uint8 RGB.

        `unusable` says why the caller wants no depth from this frame ("turning 0.9 rad/s"). It is not kept.
        Earlier frames are kept where the camera's attitude is known, since they can be turned into the new
        orientation; otherwise they are dropped, since pairs across the turn would break the network's
        assumption that the camera does not turn.
        """
        started = time.perf_counter()
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            self._trajectory.dropped["frame not after the one before"] += 1
            return self._unknown(f"dropped: stamp {stamp_ns} is not after {self._last_ns}", started)
        self._last_ns = stamp_ns
        self._frames_given += 1
        if unusable is not None:
            return self._skip(unusable, started)
        prepared = self._grid.image(image)
        # A picture that fits the grid comes back as it is; the caller may write its next frame into it.
        current = Frame(self._frames_given, stamp_ns, prepared.copy() if prepared is image else prepared)
        pairs = self._pairs(current)
        self._buffer.add(current)
        if isinstance(pairs, str):
            return self._unknown(pairs, started)
        prediction = self._predict(pairs, current)
        fused = self._fuse(pairs, prediction)
        self._planner.learn(stamp_ns, fused, self._grid.valid)
        return self._result(pairs, prediction, fused, started)

    def _pairs(self, current: Frame) -> tuple[Pair, ...] | str:
        """Numeric integration and the frame pairs picker; a string says why there is no pair."""
        self._forget_before(current.stamp_ns - self._span_ns)
        frames = self._buffer.frames
        lines = baselines(self._trajectory, frames, current.stamp_ns, self._max_turn_rad)
        if lines.reason is not None:
            return lines.reason
        wanted_m, depths_m = self._planner.wanted(current.stamp_ns, lines.length_m[lines.usable])
        pairs = pick(lines, frames, current.index, wanted_m, depths_m)
        if not self._network.card.knows_direction or all(pair.directed for pair in pairs):
            return pairs
        return self._directions.of(seen_from(lines, frames, pairs), current) or NO_DIRECTION

    def _predict(self, pairs: tuple[Pair, ...], current: Frame) -> Prediction:
        """One batch through the network; earlier frames first turned into the current orientation."""
        camera = self._grid.camera
        previous = [
            turned(pair.previous.image, pair.current_from_previous, camera)
            if is_visible(pair.turn_rad, camera)
            else pair.previous.image
            for pair in pairs
        ]
        displacements_n3 = np.stack([pair.displacement_m for pair in pairs])
        return self._network.predict(previous, current.image, displacements_n3, camera)

    def _fuse(self, pairs: tuple[Pair, ...], prediction: Prediction) -> Fused:
        camera, shape = self._grid.camera, prediction.valid.shape
        seen = None
        if any(is_visible(pair.turn_rad, camera) for pair in pairs):
            seen = np.stack([in_view(pair.current_from_previous, camera, shape) for pair in pairs])
        lengths_m = np.array([pair.length_m for pair in pairs])
        return fuse(
            prediction.beta,
            lengths_m,
            self._card,
            fusion=self._fusion,
            sigma_m=prediction.sigma_m,
            seen=seen,
        )

    def _result(
        self, pairs: tuple[Pair, ...], prediction: Prediction, fused: Fused, started: float
    ) -> RangedDepth:
        depth_m = self._grid.to_source(fused.depth_m)
        known = np.isfinite(depth_m)
        confidence = self._grid.to_source(fused.confidence)
        np.copyto(confidence, np.float32(0), where=~known)
        return RangedDepth(
            depth_m=depth_m,
            confidence=confidence,
            sigma_m=None if fused.sigma_m is None else self._grid.to_source(fused.sigma_m),
            range_depths_m=prediction.depth_m,
            shifts=np.array([pair.shift for pair in pairs]),
            displacements_m=np.array([pair.length_m for pair in pairs]),
            centroids_m=np.array([pair.depth_m for pair in pairs]),
            farther_than_m=self._bound(fused.farther_than_m, known),
            nearer_than_m=self._bound(fused.nearer_than_m, known),
            latency_ms=_since_ms(started),
            notes=(NON_ROTATING,) if self._trajectory.non_rotating else (),
        )

    def _bound(self, bound_m: Map, known: NDArray[np.bool_]) -> Map:
        """A bound at the source's size, where depth is not `known`; it is one value over wide areas."""
        if not np.isfinite(bound_m).any():
            return np.full(known.shape, np.nan, dtype=np.float32)
        bound_m = self._grid.to_source(bound_m, "nearest")
        np.copyto(bound_m, np.float32(np.nan), where=known)
        return bound_m

    def _skip(self, reason: str, started: float) -> RangedDepth:
        if not self._trajectory.knows_attitude:
            self._buffer.clear()
        return self._unknown(reason, started)

    def _unknown(self, reason: str, started: float) -> RangedDepth:
        return RangedDepth.unknown(self._camera.height, self._camera.width, reason, _since_ms(started))

    def _forget_before(self, stamp_ns: int) -> None:
        self._buffer.expire(stamp_ns)
        self._trajectory.forget(stamp_ns)


def _since_ms(started: float) -> float:
    return (time.perf_counter() - started) * 1e3
