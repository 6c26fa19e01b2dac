"""Training pairs from a stored set: the same stream, but scenes are read instead of drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes import chance
from flightdepth.stillbox.encoding import DEPTH_CLIP_M
from flightdepth.stillbox.pairs import Flown
from flightdepth.stillbox.stored import StoredSet
from flightdepth.stillbox.stream import PairStream

_CROP, _ORDER = 3, 4  # what a random stream is for
STEP_TOLERANCE = 0.01


@dataclass
class StoredPairs(PairStream):
    """Pairs of `stored`: scene number n of the stream is its n-th in an order that is shuffled anew each time round.

    Raises:
        BadInput: the set's pictures, lens or speed are not those that the stream is asked for, or it is asked for
            what only scenes that are drawn have: many lenses, scenes in the open.
    """

    stored: StoredSet = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.stored.entries:
            raise BadInput(f"set {self.stored.folder}", expected="a scene to learn from", got="none")
        wanted = {
            "width": (f"{self.picture.full_width} px", f"{self.stored.width} px"),
            "field of view": (self.config.horizontal_fov_deg, self.stored.horizontal_fov_deg),
        }
        for name, (expected, got) in wanted.items():
            if expected != got:
                raise BadInput(f"set {self.stored.folder}, {name}", expected=str(expected), got=str(got))
        drawn = {"one field of view": self.picture.fov_deg, "closed rooms": self.config.open_share}
        for expected, asked in drawn.items():
            if asked:
                raise BadInput(f"set {self.stored.folder}", expected=f"a stage of {expected}", got=str(asked))
        if self.stored.height < self.picture.height:
            got_px = f"{self.stored.height} px"
            expected_px = f"at least {self.picture.height} px"
            raise BadInput(f"set {self.stored.folder}, height", expected=expected_px, got=got_px)
        if self.stored.turns and not self.config.orientation_noise_rad:
            raise BadInput(
                f"set {self.stored.folder}",
                expected="a camera that does not turn",
                got="orientations that differ",
            )
        for step_m in self.stored.steps_m:  # targets go by the number of steps
            if abs(step_m - self.config.step_m) > STEP_TOLERANCE * self.config.step_m:
                expected_m = f"{self.config.step_m:.3f} m everywhere"
                raise BadInput(f"set {self.stored.folder}, step", expected=expected_m, got=f"{step_m:.3f} m")

    def _render(self, number: int) -> tuple[Flown, Rendered, Camera]:
        rng = chance.stream(self.seed, _CROP, number)
        x = int(rng.integers(self.stored.width - self.picture.width + 1))
        y = int(rng.integers(self.stored.height - self.picture.height + 1))
        scene = self.stored.scene(self._place(number))
        rows, columns = slice(y, y + self.picture.height), slice(x, x + self.picture.width)
        depth_m = scene.depth_m[:, rows, columns]
        cut = Rendered(
            np.ascontiguousarray(scene.images[:, rows, columns]),
            np.where(depth_m < DEPTH_CLIP_M[1], depth_m, np.float32(np.inf)),  # or farther, such as a sky
        )
        return scene, cut, self.stored.camera.cropped(x, y, self.picture.width, self.picture.height)

    def _place(self, number: int) -> int:
        """Which stored scene number `number` of the stream is."""
        again, place = divmod(number, len(self.stored))
        return int(chance.stream(self.seed, _ORDER, again).permutation(len(self.stored))[place])
