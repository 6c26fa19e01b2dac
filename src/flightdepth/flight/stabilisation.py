"""Electronic stabilisation: which files tell of it, and what it means for the camera.

A stabiliser in software draws each picture as a virtual camera would see it that turns smoothly: a part of the
sensor's picture, so the focal length in pixels is longer, by the crop, and it is that of the virtual camera which
holds. What is left of the shake is a warp within the picture (rolling shutter) and a wandering centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flightdepth.flight.gopro_settings import GoproSettings

MEANS = (
    "pictures are cropped and warped, so the field of view must be that of the cropped picture, "
    "and the attitude of a log is not that of the pictures"
)
# DJI drones that carry no 3-axis gimbal, and its action cameras: RockSteady is a setting that only the app tells.
DJI_WITHOUT_GIMBAL = ("fpv", "avata", "action", "neo")


@dataclass(frozen=True)
class Stabilisation:
    """Electronic stabilisation of one video: `name`, and whether the file says so or it is only usual."""

    name: str
    certain: bool

    @property
    def warning(self) -> str:
        """One line for the user."""
        if self.certain:
            return f"electronic stabilisation ({self.name}): {MEANS}"
        return f"{self.name} may have been on; the file does not tell. If so, {MEANS}"


def find_stabilisation(tags: Mapping[str, str], gopro: GoproSettings | None) -> Stabilisation | None:
    """What a video's tags (Video.tags) and a GoPro's settings tell; None where nothing hints at it."""
    if gopro is not None:
        if gopro.stabilised:
            return Stabilisation(f"GoPro {gopro.stabilisation}", certain=True)
        return (
            None if gopro.stabilised is False else Stabilisation("GoPro video stabilisation", certain=False)
        )
    if tags.get("com.apple.quicktime.make", tags.get("make", "")).lower() == "apple":
        return Stabilisation("the stabilisation of Apple's camera app", certain=False)
    if any(name.startswith("com.android.") for name in tags):
        return Stabilisation("the stabilisation of a telephone", certain=False)
    maker = " ".join(tags.get(name, "") for name in ("make", "model", "encoder", "handler_name")).lower()
    if "dji" in maker and any(model in maker for model in DJI_WITHOUT_GIMBAL):
        return Stabilisation("DJI RockSteady", certain=False)
    return None
