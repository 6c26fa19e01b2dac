"""Whether something stands still in the pictures of a live camera that turns: a sink, so on a thread of its own."""

from __future__ import annotations

from flightdepth.camera import Camera
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.still_parts import StillParts
from flightdepth.live.status import LiveResult
from flightdepth.motion import rotation_from_quaternion

APART_NS = 10 * NS_PER_S  # between two judgements, which take some milliseconds
TELLS = (
    "something stands still while the camera turns: {:.1%} of the picture, as landing gear and burned-in text do;"
    " it may be told to be free: give a --mask"
)


class StillWatch:
    """Give `take` every result; `doubt` says what stands still, and may be asked by any thread."""

    def __init__(self, mask: PictureMask | None = None) -> None:
        self.doubt: str | None = None
        self._mask = mask
        self._camera: Camera | None = None
        self._next_ns = 0

    def take(self, result: LiveResult) -> None:
        """One picture, and how its camera turned where that is known: told, or seen."""
        camera, attitude, seen = result.camera, result.motion.world_from_camera, result.depth.orientation
        if attitude is None and seen is None:
            return
        if camera != self._camera:  # of another size, or zoomed: nothing is known of it yet
            shown = None if self._mask is None else self._mask.at(camera.width, camera.height).shown
            self._camera, self._parts, self.doubt = camera, StillParts(camera, shown), None
        if attitude is not None:
            self._parts.add(result.image, rotation_from_quaternion(attitude))
        elif seen is not None:
            self._parts.add(result.image, seen.rotation, seen.axes(result.stamp_ns))
        if result.stamp_ns < self._next_ns:
            return
        self._next_ns = result.stamp_ns + APART_NS
        part = self._parts.found()
        self.doubt = None if part is None else TELLS.format(part.share)
