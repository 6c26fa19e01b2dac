"""Training pairs from a stored set: the same stream, but scenes are read instead of drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes import StillBoxConfig, chance
from flightdepth.stillbox.pairs import Flown
from flightdepth.stillbox.stored import StoredSet, unclipped
from flightdepth.stillbox.stream import CROP, PairStream, Picture

_ORDER = 4  # what a random stream is for, in the key's order of `PairStream`
STEP_TOLERANCE = 0.01
IN_RECIPE = "Write under [scenes] of the recipe: {} = {}."


@dataclass
class StoredPairs(PairStream):
    """Pairs of `stored`: scene number n of the stream is its n-th in an order that is shuffled anew each time round.

    Raises:
        BadInput: as of `refuse_unfit`.
    """

    stored: StoredSet = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_unfit(self.stored, self.config, self.picture)

    def _render(self, number: int) -> tuple[Flown, Rendered, Camera]:
        rng = chance.stream(self.seed, CROP, number)
        x = int(rng.integers(self.stored.width - self.picture.width + 1))
        y = int(rng.integers(self.stored.height - self.picture.height + 1))
        scene = self.stored.scene(self._place(number))
        rows, columns = slice(y, y + self.picture.height), slice(x, x + self.picture.width)
        images, depth_m = scene.images[:, rows, columns], scene.depth_m[:, rows, columns]
        cut = Rendered(np.ascontiguousarray(images), unclipped(depth_m))
        return scene, cut, self.stored.camera.cropped(x, y, self.picture.width, self.picture.height)

    def _place(self, number: int) -> int:
        """Which stored scene number `number` of the stream is."""
        again, place = divmod(number, len(self.stored))
        return int(chance.stream(self.seed, _ORDER, again).permutation(len(self.stored))[place])


def refuse_unfit(stored: StoredSet, config: StillBoxConfig, picture: Picture) -> None:
    """Refuse a set that a stage with such scenes and pictures can't learn from.

    Raises:
        BadInput: its pictures, lens or speed are not those that are asked for, a scene has one frame, or what is asked
            for only scenes that are drawn have: many lenses, scenes in the open.
    """
    fov_deg, least_px, may_turn = config.horizontal_fov_deg, picture.height, config.orientation_noise_rad
    own_fov_deg, name = stored.horizontal_fov_deg, f"set {stored.folder}"
    with_own = IN_RECIPE.format("horizontal_fov_deg", own_fov_deg)
    for what, fits, expected, got, mend in (
        ("", stored.entries, "a scene to learn from", "none", ""),
        ("", all(len(facts["imgs"]) > 1 for _, facts in stored.entries), "2 frames a scene", "1", ""),
        (", width", stored.width == picture.full_width, f"{picture.full_width} px", f"{stored.width} px", ""),
        (", field of view", fov_deg == own_fov_deg, fov_deg, own_fov_deg, with_own),
        ("", not picture.fov_deg, "a stage of one field of view", picture.fov_deg, ""),
        ("", not config.open_share, "a stage of closed rooms", config.open_share, ""),
        (", height", stored.height >= least_px, f"at least {least_px} px", f"{stored.height} px", ""),
        ("", may_turn or not stored.turns, "a camera that does not turn", "orientations that differ", ""),
    ):
        if not fits:
            raise BadInput(name + what, expected=str(expected), got=str(got), mend=mend)
    for step_m in stored.steps_m:  # targets go by the number of steps
        if abs(step_m - config.step_m) > STEP_TOLERANCE * config.step_m:
            mend = IN_RECIPE.format("speed_m_s", f"{step_m / config.time_step_s:g}")
            expected = f"{config.step_m:.3f} m everywhere"
            raise BadInput(f"{name}, step", expected=expected, got=f"{step_m:.3f} m", mend=mend)
