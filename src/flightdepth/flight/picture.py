"""One decoded picture, as a video file or a folder of pictures gives it to `Video`."""

from __future__ import annotations

from typing import Any, NamedTuple

from flightdepth.flight.display_matrix import Turn


class Picture(NamedTuple):
    """A decoded picture of PyAV, its time since the first one, and what makes it stand upright.

    after_damage  others between it and the one before were damaged, and perhaps the one before too
    name          of its own file; empty in a video
    """

    stamp_ns: int
    decoded: Any
    turn: Turn
    after_damage: bool = False
    name: str = ""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, upright."""
        width, height = self.decoded.width, self.decoded.height
        return (height, width) if self.turn.quarter_turns % 2 else (width, height)
