"""Which pairs a frame is seen in, in which direction, and which network sees them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.ranges.direction import SeenDirections
from flightdepth.ranges.fallback import OnGridOf
from flightdepth.ranges.log_check import LogCheck
from flightdepth.ranges.network import DepthNetwork
from flightdepth.ranges.pairs import Baselines, Frame, Pair, pick, seen_from
from flightdepth.ranges.plan import Planner
from flightdepth.ranges.seen_turns import SeenTurns
from flightdepth.ranges.tracks import Tracker
from flightdepth.weights.card import NetworkCard

NO_DIRECTION = "direction of motion unknown: no log tells it, and too few tracked points do"
DENIED = (
    "the pictures deny the log's direction of motion, and are followed: it is {:.0f} degrees off;"
    " are its velocities in the axes that it says, is it of this clock (of a log, `run --telemetry-offset auto` seeks"
    " it), and are its attitudes the camera's, mounted as it says?"
)


@dataclass(frozen=True, eq=False)
class Seer:
    """A network, its card at the focal length of the pictures, and what it wants to look at next."""

    network: DepthNetwork
    card: NetworkCard
    planner: Planner
    is_fallback: bool = False


class PairChoice:
    """A flight's choice: pairs for the network, else for one that needs no direction, which `fallback` opens.

    Where the log tells no direction, or one that the pictures deny, theirs is taken; a log is only asked whether it is
    right where `derotate` corrects it by the pictures as well.
    """

    def __init__(
        self,
        network: DepthNetwork,
        camera: Camera,
        tracker: Tracker,
        turns: SeenTurns,
        *,
        planner: Callable[..., Planner],
        derotate: bool,
        fallback: Callable[[], DepthNetwork] | None,
    ) -> None:
        """`tracker` follows the corners of `camera`'s pictures, whose `turns` are known as far as they were seen.

        `planner` makes one of a card and its `sides`.
        """
        self._turns = turns
        self._new_planner, self._derotate, self._open_fallback = planner, derotate, fallback
        self._see(camera, tracker)
        card = network.card.at_focal(tracker.camera.fx)
        self._first = Seer(network, card, planner(card, sides=self._sides))
        self._fallback: Seer | None = None
        self._denied = False  # the log's direction, by the pictures of the last frame

    def look_through(self, camera: Camera, tracker: Tracker) -> None:
        """The pictures are `camera`'s from now on."""
        self._see(camera, tracker)
        card = self._first.network.card.at_focal(tracker.camera.fx)
        self._first = replace(self._first, card=card)
        for seer in (self._first, self._fallback):
            if seer is not None:
                seer.planner.look_through(seer.card, self._sides)

    def _see(self, camera: Camera, tracker: Tracker) -> None:
        self._sides = min(camera.width / camera.fx, camera.height / camera.fy)
        self._directions = SeenDirections(tracker.camera, tracker, self._turns)
        self._log_check = LogCheck(tracker.camera, tracker)

    @property
    def doubt(self) -> str | None:
        """What the pictures of the last frame say against the log's direction, None where they do not."""
        return DENIED.format(math.degrees(self._log_check.off_rad)) if self._denied else None

    def of(
        self, lines: Baselines, current: Frame, *, ranges: int, most: int
    ) -> tuple[tuple[Pair, ...], Seer] | str:
        """Pairs for `ranges` ranges, with scouts `most` at most, and who sees them; a string: why there are none."""
        if pairs := self._picked(lines, current, self._first, ranges, most):
            return pairs, self._first
        if self._open_fallback is None:
            return NO_DIRECTION
        self._fallback = self._fallback or self._opened(self._open_fallback())
        return self._picked(lines, current, self._fallback, ranges, most), self._fallback

    def _opened(self, fallback: DepthNetwork) -> Seer:
        network, card = OnGridOf(fallback), fallback.card
        if card.knows_direction:
            raise BadInput("fallback", expected="a network that needs no direction", got=card.name)
        return Seer(network, card, self._new_planner(card, sides=self._sides), is_fallback=True)

    def _picked(
        self, lines: Baselines, current: Frame, seer: Seer, ranges: int, most: int
    ) -> tuple[Pair, ...]:
        """The pairs that `seer` wants, of directions that the log or the pictures tell; none where it needs one."""
        asks, known = seer.card.knows_direction, lines.usable & lines.directed
        if asks and known.any():
            lines = replace(lines, usable=known)  # others are of the world's axes, which the camera's are not
        seer.planner.ranges = ranges
        wanted_m, depths_m = seer.planner.wanted(current.stamp_ns, lines.length_m[lines.usable])
        pairs = pick(lines, wanted_m[:most], depths_m[:most])
        told = all(pair.directed for pair in pairs)
        if not seer.is_fallback:
            asked = self._derotate and told
            self._denied = asked and self._log_check.denies(lambda: seen_from(lines, pairs)[0][0][0], current)
        if (self._denied or not told) and (asks or self._derotate):
            pairs = self._directions.of(seen_from(lines, pairs), current)
        return tuple(pair for pair in pairs if pair.directed or pair.seen or not asks)
