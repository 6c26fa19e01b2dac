"""The multi-range estimator: the block diagram of the paper's figure 8, one method a block."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import ClassVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.records import VelocityFrame
from flightdepth.flight.steadiness import MAX_DEROTATED_RAD, MAX_REPORTED_RAD, MAX_TURN_RAD
from flightdepth.levels import Image, rounded
from flightdepth.ranges.choice import PairChoice, Seer
from flightdepth.ranges.disagreement import FlownBars
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.fusion import Fusion, within_reach
from flightdepth.ranges.memory_limit import MemoryLimit
from flightdepth.ranges.network import DepthNetwork, Map
from flightdepth.ranges.pairs import Frame, FrameBuffer, Pair, baselines
from flightdepth.ranges.plan import Planner
from flightdepth.ranges.repeats import Repeats
from flightdepth.ranges.reprojection import Reprojection
from flightdepth.ranges.result import RangedDepth
from flightdepth.ranges.seen import Seen
from flightdepth.ranges.seen_turns import SeenTurns
from flightdepth.ranges.temporal import HeldStill, TemporalAverage
from flightdepth.ranges.timeline import checked_stamp
from flightdepth.ranges.view import View
from flightdepth.ranges.wavering import Wavering
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.grid import check_image, check_mask

MAX_RANGES = 4
LONGEST_BUFFER_S = 3600.0
NOT_RIGID = (
    "turned too far, or what is seen moves by itself:"
    " no rotation of a few degrees and no direction near the one told explain the pictures"
)
FALLEN_BACK = "frames without a direction of motion: depth by {}, rough, its confidence is no chance"
VIGNETTING = "pictures are darker towards their corners; depth is of pictures that are evened out"
UNSURE = 0.1  # of the speed, worth a note
SPEED_UNSURE = (
    "frames whose speed is unsure by more than a tenth of it, as the log or depth that wavers says;"
    " their error bars hold it"
)
NON_ROTATING = "camera-frame velocity without attitude: the camera is taken not to turn"


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

    VIEW: ClassVar[type[View]] = View  # which brings maps to the source's pixels

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
        _check_settings(fusion, buffer_s, turns)
        self._network, self._fusion, self._derotate = network, fusion, derotate
        self.shown = None if mask is None else check_mask(mask, camera)  # [H, W], what is not masked
        self._trajectory, self._repeats, self._bars = Trajectory(), Repeats(), FlownBars()
        self._turns = SeenTurns()
        self._wavering = Wavering(self._trajectory, self._turns)
        self._ranges, self._memory = ranges, MemoryLimit(MAX_RANGES + 1)  # one for a scout
        self._buffer, self._span_ns = FrameBuffer(buffer_s), round(buffer_s * 1e9)
        self._look_through(camera)
        planner = partial(
            Planner, ranges=ranges, memory_s=buffer_s, saturation=fusion == "saturation", turns=turns
        )
        self._choice = PairChoice(
            network,
            camera,
            self._view.tracker,
            self._turns,
            planner=planner,
            derotate=derotate,
            fallback=fallback,
        )
        self._last_ns: int | None = None
        self._frames_given = 0
        self._newest: Seen | None = None

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
        return self._view.to_source(map_hw)

    def max_turn_rad(self, stamp_ns: int) -> float:
        """Rotation within a tenth of a second above which a frame of that time does harm.

        More where its attitude is told: then only the log's error is left to be seen in the pictures. As much where the
        pictures showed how the camera turned until now: then only how that changes is.
        """
        if not self._derotate:
            return MAX_TURN_RAD
        expected = self._trajectory.knows_attitude_at(stamp_ns) or self._turns.goes_on(stamp_ns)
        return MAX_REPORTED_RAD if expected else MAX_DEROTATED_RAD

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
        before = self._view.camera
        if camera == before:
            return
        if (camera.width, camera.height) != (before.width, before.height):
            got = f"{camera.width}x{camera.height}"
            raise BadInput("camera", expected=f"{before.width}x{before.height}, as before", got=got)
        self._look_through(camera)
        self._choice.look_through(camera, self._view.tracker)
        self.forget_frames()

    def _look_through(self, camera: Camera) -> None:
        self._view = self.VIEW(self._network, camera, self.shown)
        grid = self._view.grid
        self._reprojection = Reprojection(grid.camera, grid.valid.shape)
        self._held_still = HeldStill(TemporalAverage(self._reprojection), self._trajectory, self._turns)

    def forget_frames(self) -> None:
        """Pair what comes with none of the frames so far: some of them may be damaged."""
        self._buffer.clear()
        self._held_still.forget()
        self._wavering.forget()
        self._turns.forget()
        self._newest = None

    def add_frame(self, stamp_ns: int, image: Image, *, unusable: str | None = None) -> RangedDepth:
        """Depth of `image` [H, W, 3] uint8 RGB.

        `unusable` says why the caller wants no depth from this frame ("turning 0.9 rad/s"). It is not kept.
        Earlier frames are kept where the camera's attitude is known, since they can be turned into the new
        orientation; otherwise they are dropped, since pairs across the turn would break the network's
        assumption that the camera does not turn.
        """
        started, stamp_ns = time.perf_counter(), checked_stamp(stamp_ns)
        check_image("image", image, self._view.camera)  # first: a refused picture may come again, mended
        seen = self._shown_by(stamp_ns, image, unusable)
        if isinstance(seen, str):
            result = RangedDepth.unknown(image.shape[0], image.shape[1], seen, 0.0)
        else:
            result = seen.result(self._frames_given, self._notes(seen))
        return replace(result, latency_ms=(time.perf_counter() - started) * 1e3)

    def _shown_by(self, stamp_ns: int, image: Image, unusable: str | None) -> Seen | str:
        """What a picture shows, or the one that it repeats; a string says why there is nothing."""
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            self._trajectory.dropped["frame not after the one before"] += 1
            return f"dropped: stamp {stamp_ns} is not after {self._last_ns}"
        self._last_ns = stamp_ns
        self._frames_given += 1
        if unusable is not None:
            if not self._trajectory.knows_attitude:
                self.forget_frames()
            return unusable
        picture = self._view.prepared(image)
        self._repeats.add(stamp_ns, self._view.scene_of(rounded(picture)))
        taken = Frame(self._frames_given, self._repeats.taken_ns(stamp_ns), picture)
        self._forget_before(taken.stamp_ns - self._span_ns)
        if self._is_frozen(taken, stamp_ns):
            return f"{self._repeats.told(stamp_ns)} in flight"
        if self._newest is None or self._newest.current.stamp_ns != taken.stamp_ns:
            seen = self._seen(taken)
            if isinstance(seen, str):
                return seen
            self._newest = seen
        return self._newest

    def _forget_before(self, stamp_ns: int) -> None:
        self._buffer.expire(stamp_ns)
        self._trajectory.forget(stamp_ns)
        self._turns.expire(stamp_ns)

    def _is_frozen(self, current: Frame, now_ns: int) -> bool:
        """Whether the camera moved while it showed this picture; then that holds until it shows another."""
        repeats = self._repeats
        if repeats.repeated and not repeats.frozen and not repeats.is_usual(now_ns - repeats.shown_ns):
            shown = replace(current, stamp_ns=repeats.shown_ns)
            since = baselines(self._trajectory, (shown,), now_ns, self._view.max_turn_rad)
            repeats.frozen = bool(since.usable[0])
        return repeats.frozen

    def _seen(self, taken: Frame) -> Seen | str:
        """The blocks in turn: pairs, network, fusion, what to look at next; a string says why there is nothing."""
        view, current = self._view, self._view.evened(taken)
        untold = not self._trajectory.knows_attitude_at(current.stamp_ns)
        chosen = self._pairs(current, untold=untold)
        if self._network.card.knows_direction:  # others err more in pictures that are evened out
            view.vignetting.watch(taken, self._buffer.frames)
        self._buffer.add(taken)
        if isinstance(chosen, str):
            return chosen
        pairs, seer = chosen
        if self._derotate:
            pairs = view.derotation.of(pairs, current)
        if not pairs:
            return NOT_RIGID
        orientation = self._turns.add(current.stamp_ns, pairs) if self._derotate and untold else None
        pairs = self._wavering.widened(current.stamp_ns, pairs)
        predict = partial(view.predict, current=current, network=seer.network)
        pairs, prediction = self._memory.predicted(pairs, seer.network, predict)
        prediction = self._bars.widened(current.stamp_ns, prediction, seer.card)
        fused = view.fuse(pairs, prediction, seer.card, fusion=self._fusion)
        seer.planner.learn(current.stamp_ns, fused, view.grid.valid)
        if self._fusion == "saturation":
            if not seer.is_fallback:  # depths of two networks are not averaged
                directs = seer.card.knows_direction
                fused = self._held_still.add(current.stamp_ns, fused, pairs[0], sees_direction=directs)
                self._wavering.learn(current.stamp_ns, fused, pairs[0], self._reprojection)
            fused = within_reach(fused)
        return Seen(view, current, pairs, prediction, fused, seer, self._choice.doubt, orientation)

    def _pairs(self, current: Frame, *, untold: bool) -> tuple[tuple[Pair, ...], Seer] | str:
        """Numeric integration and the frame pairs picker, and who sees the pairs; a string says why there is none.

        `untold`: no log tells the attitude.
        """
        lines = baselines(self._trajectory, self._buffer.frames, current.stamp_ns, self._view.max_turn_rad)
        if lines.reason is None and untold:
            lines = self._turns.expected(lines, current.stamp_ns, self._view.max_turn_rad)
        if lines.reason is not None:
            return lines.reason
        lines = self._view.exposed(lines, current)
        return self._choice.of(lines, current, ranges=self.ranges, most=self._memory.most_pairs)

    def _notes(self, seen: Seen) -> tuple[str, ...]:
        non_rotating = (NON_ROTATING,) if self._trajectory.non_rotating else ()
        told = (FALLEN_BACK.format(seen.seer.card.name),) if seen.seer.is_fallback else ()
        darker = (VIGNETTING,) if self._view.vignetting.strength else ()
        unsure = any(pair.length_sigma_m > UNSURE * pair.length_m for pair in seen.pairs)
        doubted = (SPEED_UNSURE,) if unsure and seen.fused.sigma_m is not None else ()
        return non_rotating + self._memory.notes + told + darker + doubted


def check_ranges(ranges: int) -> None:
    """Refuse a number of ranges that the paper's system does not have."""
    if not (isinstance(ranges, int | np.integer) and 1 <= ranges <= MAX_RANGES):
        raise BadInput("ranges", expected=f"1 to {MAX_RANGES}", got=str(ranges))


def _check_settings(fusion: Fusion, buffer_s: float, turns: int) -> None:
    if not (isinstance(turns, int | np.integer) and turns >= 1):
        raise BadInput("turns", expected="1, 2, ...", got=str(turns))
    if fusion not in get_args(Fusion):
        raise BadInput("fusion", expected="saturation or paper", got=repr(fusion))
    if not buffer_s > 0:
        raise BadInput("buffer", expected="more than 0 seconds", got=str(buffer_s))
    if buffer_s > LONGEST_BUFFER_S:
        raise BadInput("buffer", expected=f"at most {LONGEST_BUFFER_S:g} seconds", got=str(buffer_s))
