"""From a decoded picture to depth: motion into the estimator, pictures that cannot be used kept out of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.camera_file import read_camera
from flightdepth.flight.cameras import NO_CAMERA, by_calibration, by_hfov, by_table, camera_of_size
from flightdepth.flight.lenses import Lens as KnownLens
from flightdepth.flight.lenses import find_lens
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.records import NS_PER_S, give
from flightdepth.flight.steadiness import PAIR_NS, Steadiness, verdict
from flightdepth.live.motion_store import MotionStore
from flightdepth.ranges.estimator import MultiRangeEstimator, check_ranges
from flightdepth.ranges.repeats import Repeats
from flightdepth.ranges.result import RangedDepth
from flightdepth.runtimes.network import Network, lightest_network

Image = NDArray[np.uint8]

# A repeated picture is left out; so many ns of repeats are a frozen picture, and everybody shall know.
FROZEN_NS = 3 * NS_PER_S // 10
BACK_NS = NS_PER_S  # pictures whose times go back by more begin anew: those before had a time from the future
LOOKED_AT = 4  # every so-many-th pixel tells whether a picture changed


@dataclass(frozen=True)
class Lens:
    """What the user said of the camera: a calibration, the horizontal field of view, or a lens of the table.

    source  a line for people: where that comes from
    """

    camera: Camera | None = None
    hfov_deg: float | None = None
    known: KnownLens | None = None
    source: str = ""

    @classmethod
    def given(cls, camera: Path | None, hfov_deg: float | None) -> Lens:
        """From the command line: one of the two."""
        if camera is None and hfov_deg is not None:
            return cls(hfov_deg=hfov_deg, source=by_hfov(hfov_deg))
        if camera is None or hfov_deg is not None:
            got = "neither" if camera is None else "both"
            raise BadInput("--camera and --hfov", expected="one of them", got=got, mend=NO_CAMERA)
        if not camera.is_file() and camera.suffix == "":
            lens = find_lens(camera.name)
            return cls(known=lens, source=by_table(lens))
        return cls(read_camera(camera), source=by_calibration(camera))

    def at(self, width: int, height: int) -> Camera:
        """The camera of pictures of this size."""
        if self.camera is not None:
            return camera_of_size(self.camera, width, height)
        if self.known is not None:
            return self.known.seen(width, height)
        assert self.hfov_deg is not None
        return Camera.from_fov(width, height, self.hfov_deg)

    def nominal(self, width: int, height: int) -> Camera:
        """The calibration as it is, else a camera of this size with the lens's field of view, whatever its shape is."""
        if self.known is not None:
            return Camera.from_fov(width, height, self.known.horizontal_fov_deg, model=self.known.model)
        return self.camera or self.at(width, height)


@dataclass(frozen=True, eq=False)
class Staged:
    """Depth of one picture, its camera, and whether it had to wait until the network was compiled for its size."""

    depth: RangedDepth
    image: Image
    camera: Camera
    compiled: bool


class NoCalibration(BadInput):
    """Pictures of a size that what the user said of the camera, or its mask, does not hold for."""


class DepthStage:
    """One estimator, made anew when the pictures' size changes or their times go back. `counts` says what was left out.

    `fixed`: the camera is screwed to the drone, so its attitude is known well and pictures turn all the time;
    else, or while nobody tells it, pictures that turn are told from themselves. `turns`: see MultiRangeEstimator.
    `zoom`: the camera of the picture at a time (live clock, ns), where a log tells that the lens zooms.
    """

    def __init__(
        self,
        network: Network,
        lens: Lens,
        store: MotionStore,
        *,
        ranges: int,
        fixed: bool,
        turns: int = 1,
        zoom: Callable[[int], Camera] | None = None,
        mask: PictureMask | None = None,
    ) -> None:
        check_ranges(ranges)
        self.counts: Counter[str] = Counter()
        # Of telemetry: by estimators that are gone, and by the present one; both in one, for other threads.
        self._left_out: tuple[Counter[str], Callable[[], Mapping[str, int]]] = Counter(), dict
        self._network, self._lens, self._store, self._fixed = network, lens, store, fixed
        self._ranges = self._most = ranges
        self._turns, self._zoom, self._mask = turns, zoom, mask
        self._camera: Camera | None = None
        self._repeats = Repeats()
        self._newest_ns = 0

    @property
    def ranges(self) -> int:
        """n in use; set it between two pictures."""
        return self._ranges

    @ranges.setter
    def ranges(self, ranges: int) -> None:
        self._ranges = ranges
        if self._camera is not None:
            self._estimator.ranges = ranges

    @property
    def faster(self) -> str:
        """What takes less time; not fewer ranges, which fall to one by themselves."""
        ways = ["smaller pictures from the camera"]
        if self._network.card.knows_direction and self._network.aligned:
            ways.append("--no-align")
        if (lightest := lightest_network(self._network.card)) is not None:
            ways.append(f"--network {lightest}")
        return " or ".join(ways)

    @property
    def telemetry_dropped(self) -> Counter[str]:
        """Samples that the estimators left out, by reason; any thread may ask."""
        before, now = self._left_out
        return before + Counter(now())

    def is_prepared(self, width: int, height: int) -> bool:
        """Whether pictures of this size need not wait until the network is compiled for them."""
        return self._camera is not None and (self._camera.width, self._camera.height) == (width, height)

    def take(self, stamp_ns: int, image: Image) -> Staged | None:
        """Depth of a picture uint8 RGB [H, W, 3]; None where it is left out, which is counted."""
        if stamp_ns < self._newest_ns - BACK_NS:
            self.counts["steps back of the pictures' times"] += 1
            self._camera, self._repeats = None, Repeats()
        elif stamp_ns <= self._newest_ns:
            self.counts["not later than the one before"] += 1
            return None
        height, width = image.shape[:2]
        compiled = not self.is_prepared(width, height)
        if compiled:
            self.prepare(width, height)
        assert self._camera is not None
        self._newest_ns = stamp_ns
        if self._zoom is not None:
            self._camera = camera_of_size(self._zoom(stamp_ns), width, height)
            self._estimator.see_through(self._camera)
            self._steadiness.see_through(self._camera)
        self._repeats.add(stamp_ns, image[::LOOKED_AT, ::LOOKED_AT].copy())
        repeated = self._repeats.repeated
        if repeated and stamp_ns - self._repeats.shown_ns < FROZEN_NS:
            self.counts["the same picture again"] += 1
            return None
        self._feed_motion()
        unusable = self._repeats.told(stamp_ns) if repeated else self._turning(stamp_ns, image)
        depth = self._estimator.add_frame(stamp_ns, image, unusable=unusable)
        return Staged(depth, image, self._camera, compiled)

    def prepare(self, width: int, height: int) -> None:
        """Make ready for pictures of this size; takes the network's time to compile, seconds on a small machine."""
        try:
            camera = self._lens.at(width, height)
            shown = None if self._mask is None else self._mask.at(width, height).shown
        except BadInput as error:
            raise NoCalibration(str(error)) from error
        grid = self._network.grid(camera)
        self._network.warm_up(grid.camera, self._most + 1)  # one more for a scout
        estimator = MultiRangeEstimator(
            self._network, camera, ranges=self._ranges, turns=self._turns, mask=shown
        )
        self._left_out = self.telemetry_dropped, lambda: estimator.dropped
        self._steadiness = Steadiness(camera, shown=shown)
        self._estimator = estimator
        self._camera = camera

    def _feed_motion(self) -> None:
        for sample in self._store.take_new():
            give(sample, self._estimator)

    def _turning(self, stamp_ns: int, image: Image) -> str | None:
        """Why this picture turns too fast for depth, None where it does not."""
        limit_rad = self._estimator.max_turn_rad(stamp_ns)
        turn_rad = self._store.turn_rad(stamp_ns, PAIR_NS) if self._fixed else None
        if turn_rad is None:  # a gimbal's pictures, or nobody tells the drone's attitude
            return self._steadiness.add(stamp_ns, image, limit_rad).unusable
        return verdict(turn_rad, PAIR_NS / NS_PER_S, "the autopilot", limit_rad).unusable
