"""The knobs of the Still Box generator. A dataset is (config, seed)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from flightdepth.camera import Camera
from flightdepth.scenes.scene import MOST_LAMPS, MOST_OBJECTS

SET_VERSION = "2"


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not 0 <= low <= high:
        raise ValueError(f"expected 0 <= low <= high, got {low}, {high}")
    return ends


Range = Annotated[tuple[float, float], AfterValidator(_rising)]
Counts = Annotated[tuple[int, int], AfterValidator(_rising)]


class StillBoxConfig(BaseModel):
    """How scenes are drawn; the defaults follow the original set (texture ratio 0.5, 1 m/s, 0.1 s, 90 degrees)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    frames: int = Field(default=10, ge=1, description="frames per scene")
    speed_m_s: float = Field(default=1.0, gt=0, description="constant speed of the camera")
    time_step_s: float = Field(default=0.1, gt=0, description="time between two frames")
    horizontal_fov_deg: float = Field(
        default=90.0, gt=0, lt=180, description="between the left and right edge"
    )
    orientation_noise_rad: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="N0: each frame is turned by this angle about a fresh random axis; the paper's noisy scenes: 0.001",
    )
    meshes: Counts = Field(default=(8, 26), description="fewest and most objects")
    texture_ratio: float = Field(default=0.5, ge=0, le=1, description="share of textured objects and walls")
    room_half_m: Range = Field(default=(24.0, 74.0), description="half the room's edge, per axis")
    distance_m: Range = Field(default=(3.6, 44.0), description="camera to object centre, log-uniform")
    angular_size: Range = Field(default=(0.09, 0.5), description="object radius over its distance")
    objects_ahead_of: Literal["start", "path"] = Field(
        default="start",
        description="the camera that objects are placed before: the first frame's, or any frame's (for long flights)",
    )
    clearance_m: float = Field(default=1.2, ge=0, description="least room between the path and any surface")
    open_share: float = Field(default=0.0, ge=0, le=1, description="share of scenes in the open, under a sky")
    lamps: Counts = Field(default=(1, 3), description="fewest and most lamps")

    @model_validator(mode="after")
    def _ordered(self) -> StillBoxConfig:
        if self.distance_m[0] <= 0:
            raise ValueError(f"distance_m: expected more than 0, got {self.distance_m[0]}")
        if self.angular_size[1] <= 0:
            raise ValueError(f"angular_size: expected more than 0, got {self.angular_size[1]}")
        # The ground of a scene in the open is an object more.
        for name, (_, many), most in (
            ("meshes", self.meshes, MOST_OBJECTS - 1),
            ("lamps", self.lamps, MOST_LAMPS),
        ):
            if many > most:
                raise ValueError(f"{name}: expected at most {most}, got {many}")
        least_m = self.path_length_m / 2 + self.clearance_m
        if self.room_half_m[0] < least_m:
            raise ValueError(
                f"room_half_m: expected at least half the path + clearance = {least_m:.2f} m, "
                f"got {self.room_half_m[0]} m; larger rooms, fewer frames, a lower speed or a shorter time step mend it"
            )
        return self

    @property
    def step_m(self) -> float:
        """Displacement between two frames, metres."""
        return self.speed_m_s * self.time_step_s

    @property
    def path_length_m(self) -> float:
        """Displacement from the first frame to the last, metres."""
        return self.step_m * (self.frames - 1)

    def focal_px(self, width: int) -> float:
        """Focal length of a picture `width` pixels wide."""
        return Camera.from_fov(width, width, self.horizontal_fov_deg).fx
