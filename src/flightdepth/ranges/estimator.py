"""The multi-range estimator: the block diagram of the paper's figure 8, one method a block."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.records import VelocityFrame
from flightdepth.flight.steadiness import MAX_DEROTATED_RAD, MAX_REPORTED_RAD, MAX_TURN_RAD
from flightdepth.levels import AnyImage, Image, rounded
from flightdepth.ranges.choice import PairChoice, Seer
from flightdepth.ranges.derotation import Derotation
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.exposure import ExposedFrames
from flightdepth.ranges.fusion import Fused, Fusion, fuse, within_reach
from flightdepth.ranges.memory_limit import MemoryLimit
from flightdepth.ranges.motion_error import widened
from flightdepth.ranges.network import AtSource, DepthNetwork, Map
from flightdepth.ranges.pairs import Frame, FrameBuffer, Pair, baselines
from flightdepth.ranges.plan import Planner
from flightdepth.ranges.repeats import Repeats
from flightdepth.ranges.result import RangedDepth
from flightdepth.ranges.temporal import TemporalAverage, step_between
from flightdepth.ranges.timeline import checked_stamp
from flightdepth.ranges.tracks import Tracker
from flightdepth.ranges.turning import in_view, is_visible, turned
from flightdepth.ranges.vignetting import Vignetting
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.contract import OUTPUT_STRIDE
from flightdepth.runtimes.grid import check_image, check_mask
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

MAX_RANGES = 4
LONGEST_BUFFER_S = 3600.0
NOT_RIGID = (
    "turned too far, or what is seen moves by itself:"
    " no rotation of a few degrees and no direction near the one told explain the pictures"
)
FALLEN_BACK = "frames without a direction of motion: depth by {}, rough, its confidence is no chance"
VIGNETTING = "pictures are darker towards their corners; depth is of pictures that are evened out"
NON_ROTATING = "camera-frame velocity without attitude: the camera is taken not to turn"


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the pairs of a picture, `current`, showed; it serves again while that picture is shown again."""

    current: Frame
    pairs: tuple[Pair, ...]
    prediction: Prediction
    fused: Fused
    seer: Seer
    doubt: str | None

    @property
    def stamp_ns(self) -> int:
        """When the picture was taken."""
        return self.current.stamp_ns


class MultiRangeEstimator:
    """Frames and motion in, depth out; one estimator a flight, not for use from several threads at once.

    Each frame is paired with `ranges` (1..4) earlier ones of the last `buffer_s` seconds, chosen so that the
    network sees each cluster of the last depth at its best output; the n depths are fused.

    Motion may be given ahead of the frames, and should be when it is known: then displacements are exact at
    the frame times. In real time the last velocity holds for half a second; after that depth is unknown.
    The attitude must be the camera's (of the gimbal, not of the body): where it is known at both frames,
    the earlier picture is turned into the current orientation before the network sees it. Give none for
    pictures that are already stabilised. What small rotation no log reports is seen in each pair's pictures
    and taken out, and so is an error of the direction, unless `derotate` is False; a pair that this does not make right
    is not used. Up to 65,536 velocities, attitudes and poses each are kept, of which frames need the last seconds;
    beyond that the oldest go, and `dropped` counts them. Where the pictures deny the log's
    direction altogether, they are followed, and a note says so.

    With one range and `turns` of 2, successive frames look at the near and at the far cluster in turn: each depth
    knows less, two in a row know as much as of two ranges. For who joins them himself (live.obstacle_memory).

    `fallback` opens a network that needs no direction, for frames whose displacement has a length alone; it is called
    when the first of them comes. All other frames have the same depth as without it.

    `mask`, uint8 or bool [H, W] of the camera's size, is 0 where pictures show no scene but what moves with the camera
    (parts of the drone, burned-in text): nothing is told of it, and no motion is taken from it.
    """

    def __init__(
        self,
        network: DepthNetwork,
        camera: Camera,
        *,
        ranges: int = 2,
        fusion: Fusion = "saturation",
        buffer_s: float = 4.0,
        derotate: bool = True,
        turns: int = 1,
        fallback: Callable[[], DepthNetwork] | None = None,
        mask: NDArray[np.uint8] | Flags | None = None,
    ) -> None:
        check_ranges(ranges)
        if not (isinstance(turns, int | np.integer) and turns >= 1):
            raise BadInput("turns", expected="1, 2, ...", got=str(turns))
        if fusion not in get_args(Fusion):
            raise BadInput("fusion", expected="saturation or paper", got=repr(fusion))
        if not buffer_s > 0:
            raise BadInput("buffer", expected="more than 0 seconds", got=str(buffer_s))
        if buffer_s > LONGEST_BUFFER_S:
            raise BadInput("buffer", expected=f"at most {LONGEST_BUFFER_S:g} seconds", got=str(buffer_s))
        self._network, self._fusion, self._derotate = network, fusion, derotate
        self.shown = None if mask is None else check_mask(mask, camera)  # [H, W], what is not masked
        self._look_through(camera)
        self._trajectory, self._repeats = Trajectory(), Repeats()
        self._ranges, self._memory = ranges, MemoryLimit(MAX_RANGES + 1)  # one for a scout
        self._buffer = FrameBuffer(buffer_s)
        planner = partial(
            Planner,
            ranges=ranges,
            memory_s=buffer_s,
            saturation=self._fusion == "saturation",
            turns=turns,
        )
        self._choice = PairChoice(
            network, camera, self._tracker, planner=planner, derotate=derotate, fallback=fallback
        )
        self._span_ns = round(buffer_s * 1e9)
        self._last_ns: int | None = None
        self._frames_given = 0
        self._newest: _Seen | None = None

    @property
    def ranges(self) -> int:
        """Pairs a frame, as far as there is memory; may be set between two frames, to suit what the machine can do."""
        return min(self._ranges, self._memory.most_pairs)

    @ranges.setter
    def ranges(self, ranges: int) -> None:
        check_ranges(ranges)
        self._ranges = ranges

    def to_source(self, map_hw: Map) -> Map | None:
        """One of a result's `range_depths_m` at the source's pixels; None where the lens has been zoomed since."""
        return self._grid.to_source(map_hw) if map_hw.shape == self._grid.valid.shape else None

    def max_turn_rad(self, stamp_ns: int) -> float:
        """Rotation within a tenth of a second above which a frame of that time does harm.

        More where its attitude is told: then only the log's error is left to be seen in the pictures.
        """
        if not self._derotate:
            return MAX_TURN_RAD
        return MAX_REPORTED_RAD if self._trajectory.knows_attitude_at(stamp_ns) else MAX_DEROTATED_RAD

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

    def add_position(self, stamp_ns: int, position: ArrayLike) -> None:
        """The camera's position (3,) in metres, north, east, down of any origin; replaces velocities as poses do."""
        self._trajectory.add_position(stamp_ns, position)

    def add_pose(self, stamp_ns: int, world_from_camera: ArrayLike) -> None:
        """The camera's pose (4, 4); once one is given, poses replace velocities and attitudes.

        Nothing is paired across a jump that no drone can fly (a loop closure, a GPS reset); `dropped` counts it.
        """
        self._trajectory.add_pose(stamp_ns, world_from_camera)

    def see_through(self, camera: Camera) -> None:
        """Take the next pictures for those of `camera`, of the same size: the lens zoomed, or its crop changed.

        Earlier pictures are dropped where it is another camera than before, so the next one has no depth.
        """
        if camera == self._camera:
            return
        size = self._camera.width, self._camera.height
        if (camera.width, camera.height) != size:
            got = f"{camera.width}x{camera.height}"
            raise BadInput("camera", expected=f"{size[0]}x{size[1]}, as before", got=got)
        self._look_through(camera)
        self._choice.look_through(camera, self._tracker)
        self.forget_frames()

    def _look_through(self, camera: Camera) -> None:
        """All that hangs on the lens; each pair is tracked once for all who ask what its pictures show."""
        self._camera, self._grid = camera, self._network.grid(camera)
        self._shown: Flags | None = None  # at the output size
        if self.shown is not None:
            self._grid = self._grid.masked(self.shown)
            self._shown = self._grid.valid
        # Beyond a quarter of the view too little of the earlier picture is left.
        self._max_turn_rad = math.radians(camera.horizontal_fov_deg) / 4
        ideal = self._grid.camera
        self._average = TemporalAverage(ideal, self._grid.valid.shape)
        self._averaged_ns: int | None = None  # stamp of the last depth that the average holds
        self._tracker = Tracker(ideal, self._shown)
        self._derotation = Derotation(ideal, self._tracker)
        self._vignetting = Vignetting(ideal, self._shown)

    def forget_frames(self) -> None:
        """Pair what comes with none of the frames so far: some of them may be damaged, or of another flight."""
        self._buffer.clear()
        self._averaged_ns, self._newest = None, None

    def add_frame(self, stamp_ns: int, image: Image, *, unusable: str | None = None) -> RangedDepth:
        """Depth of `image` [H, W, 3] uint8 RGB.

        `unusable` says why the caller wants no depth from this frame ("turning 0.9 rad/s"). It is not kept.
        Earlier frames are kept where the camera's attitude is known, since they can be turned into the new
        orientation; otherwise they are dropped, since pairs across the turn would break the network's
        assumption that the camera does not turn.
        """
        started, stamp_ns = time.perf_counter(), checked_stamp(stamp_ns)
        check_image("image", image, self._camera)  # first: a refused picture may come again, mended
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            self._trajectory.dropped["frame not after the one before"] += 1
            return self._unknown(f"dropped: stamp {stamp_ns} is not after {self._last_ns}", started)
        self._last_ns = stamp_ns
        self._frames_given += 1
        if unusable is not None:
            if not self._trajectory.knows_attitude:
                self.forget_frames()
            return self._unknown(unusable, started)
        prepared = self._grid.image(image)
        # A picture that fits the grid comes back as it is; the caller may write its next frame into it.
        picture = prepared.copy() if prepared is image else prepared
        self._repeats.add(stamp_ns, self._scene_of(rounded(picture)))
        taken = Frame(self._frames_given, self._repeats.taken_ns(stamp_ns), picture)
        self._forget_before(taken.stamp_ns - self._span_ns)
        if self._is_frozen(taken, stamp_ns):
            return self._unknown(f"{self._repeats.told(stamp_ns)} in flight", started)
        if self._newest is None or self._newest.stamp_ns != taken.stamp_ns:
            seen = self._seen(taken)
            if isinstance(seen, str):
                return self._unknown(seen, started)
            self._newest = seen
        return self._result(self._newest, started)

    def _seen(self, taken: Frame) -> _Seen | str:
        """What a picture's pairs show; a string says why there is nothing."""
        current = replace(taken, image=self._vignetting.evened(taken.image))
        chosen = self._pairs(current)
        if self._network.card.knows_direction:  # others err more in pictures that are evened out
            self._vignetting.watch(taken, self._buffer.frames)
        self._buffer.add(taken)
        if isinstance(chosen, str):
            return chosen
        pairs, seer = chosen
        if self._derotate:
            pairs = self._derotation.of(pairs, current)
        if not pairs:
            return NOT_RIGID
        predict = partial(self._predict, current=current, network=seer.network)
        pairs, prediction = self._memory.predicted(pairs, seer.network, predict)
        fused = self._fuse(pairs, prediction, seer.card)
        seer.planner.learn(current.stamp_ns, fused, self._grid.valid)
        if not seer.is_fallback:  # depths of two networks are not averaged
            fused = self._held_still(current.stamp_ns, pairs, fused)
        if self._fusion == "saturation":
            fused = within_reach(fused)
        return _Seen(current, pairs, prediction, fused, seer, self._choice.doubt)

    def _forget_before(self, stamp_ns: int) -> None:
        self._buffer.expire(stamp_ns)
        self._trajectory.forget(stamp_ns)

    def _scene_of(self, picture: Image) -> Image:
        """A prepared picture, black where it is masked: a clock that is burned in ticks on in a frozen one."""
        if self._shown is None:
            return picture
        shown = self._shown.repeat(OUTPUT_STRIDE, axis=0).repeat(OUTPUT_STRIDE, axis=1)
        return np.where(shown[..., None], picture, np.uint8(0))

    def _at_source(self, depth_m: Map, image: AnyImage) -> AtSource:
        """Depth [h, w] of the network at the source's size, and what brings other maps there."""
        return self._grid.along_edges(depth_m, image)

    def _pairs(self, current: Frame) -> tuple[tuple[Pair, ...], Seer] | str:
        """Numeric integration and the frame pairs picker, and who sees the pairs; a string says why there is none."""
        lines = baselines(self._trajectory, self._buffer.frames, current.stamp_ns, self._max_turn_rad)
        if lines.reason is not None:
            return lines.reason
        exposed = ExposedFrames(
            lines, current.image, self._grid.camera, self._shown, evened=self._vignetting.evened
        )
        lines = replace(lines, frames=exposed)
        return self._choice.of(lines, current, ranges=self.ranges, most=self._memory.most_pairs)

    def _is_frozen(self, current: Frame, now_ns: int) -> bool:
        """Whether the camera moved while it showed this picture; then that holds until it shows another."""
        repeats = self._repeats
        if repeats.repeated and not repeats.frozen and not repeats.is_usual(now_ns - repeats.shown_ns):
            shown = replace(current, stamp_ns=repeats.shown_ns)
            since = baselines(self._trajectory, (shown,), now_ns, self._max_turn_rad)
            repeats.frozen = bool(since.usable[0])
        return repeats.frozen

    def _predict(self, pairs: tuple[Pair, ...], current: Frame, network: DepthNetwork) -> Prediction:
        """One batch through the network; earlier frames first turned into the current orientation."""
        camera = self._grid.camera
        previous = [
            turned(pair.previous.image, pair.current_from_previous, camera)
            if is_visible(pair.turn_rad, camera)
            else pair.previous.image
            for pair in pairs
        ]
        displacements_n3 = np.stack([pair.displacement_m for pair in pairs])
        if self._shown is None:
            return widened(network.predict(previous, current.image, displacements_n3, camera), pairs, camera)
        found = network.predict(previous, current.image, displacements_n3, camera, self._shown)
        return widened(found, pairs, camera).where(self._shown)

    def _fuse(self, pairs: tuple[Pair, ...], prediction: Prediction, card: NetworkCard) -> Fused:
        camera, seen = self._grid.camera, None
        if any(is_visible(pair.turn_rad, camera) for pair in pairs):
            valid = self._grid.valid
            seen = np.stack([in_view(pair.current_from_previous, camera, valid) for pair in pairs])
        lengths_m = np.array([pair.length_m for pair in pairs])
        sigma_m = prediction.sigma_m
        return fuse(prediction.beta, lengths_m, card, fusion=self._fusion, sigma_m=sigma_m, seen=seen)

    def _held_still(self, stamp_ns: int, pairs: tuple[Pair, ...], fused: Fused) -> Fused:
        """Averaged with the frames before, as far as the motion since the last depth is known."""
        if self._fusion == "paper":
            return fused
        step = None
        if self._averaged_ns is not None:
            directed = pairs[0].directed
            unit = None if directed else pairs[0].displacement_m / pairs[0].length_m
            if directed or self._network.card.knows_direction:
                step = step_between(self._trajectory, (self._averaged_ns, stamp_ns), unit)
        self._averaged_ns = stamp_ns
        return self._average.add(fused, step)

    def _result(self, seen: _Seen, started: float) -> RangedDepth:
        """At the source's pixels, in arrays that are the caller's."""
        pairs, fused, seer = seen.pairs, seen.fused, seen.seer
        at_source = self._at_source(fused.depth_m, seen.current.image)
        confidence = at_source(fused.confidence)
        np.copyto(confidence, np.float32(0), where=np.isnan(confidence))
        return RangedDepth(
            depth_m=at_source.depth_m,
            confidence=confidence,
            sigma_m=None if fused.sigma_m is None else at_source(fused.sigma_m),
            range_depths_m=seen.prediction.depth_m.copy(),
            shifts=np.array([self._frames_given - pair.previous.index for pair in pairs]),
            displacements_m=np.array([pair.length_m for pair in pairs]),
            centroids_m=np.array([pair.depth_m for pair in pairs]),
            farther_than_m=_bound(fused.farther_than_m, at_source),
            nearer_than_m=_bound(fused.nearer_than_m, at_source),
            latency_ms=_since_ms(started),
            notes=self._notes(seer),
            doubt=seen.doubt,
            moved_m=self._moved(pairs, seer.card),
            network=seer.card.name,
        )

    def _notes(self, seer: Seer) -> tuple[str, ...]:
        non_rotating = (NON_ROTATING,) if self._trajectory.non_rotating else ()
        told = (FALLEN_BACK.format(seer.card.name),) if seer.is_fallback else ()
        darker = (VIGNETTING,) if self._vignetting.strength else ()
        return non_rotating + self._memory.notes + told + darker

    def _moved(self, pairs: tuple[Pair, ...], card: NetworkCard) -> NDArray[np.float64] | None:
        told = card.knows_direction or all(pair.directed for pair in pairs)
        return np.stack([pair.displacement_m for pair in pairs]) if told else None

    def _unknown(self, reason: str, started: float) -> RangedDepth:
        return RangedDepth.unknown(self._camera.height, self._camera.width, reason, _since_ms(started))


def _bound(bound_m: Map, at_source: AtSource) -> Map:
    """A bound at the source's size; it is one value over wide areas, and known only where depth is not."""
    if not np.isfinite(bound_m).any():
        return np.full_like(at_source.depth_m, np.nan)
    bound = at_source.marks(bound_m)
    np.copyto(bound, np.float32(np.nan), where=np.isfinite(at_source.depth_m))
    return bound


def check_ranges(ranges: int) -> None:
    """Refuse a number of ranges that the paper's system does not have."""
    if not (isinstance(ranges, int | np.integer) and 1 <= ranges <= MAX_RANGES):
        raise BadInput("ranges", expected=f"1 to {MAX_RANGES}", got=str(ranges))


def _since_ms(started: float) -> float:
    return (time.perf_counter() - started) * 1e3
