"""The knobs of the outdoor generator, and the flight through its scenes. A set is (config, seed)."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from flightdepth.scenes.config import Range
from flightdepth.scenes.scene import Floats

OUTDOOR_VERSION = "1"


class OutdoorConfig(BaseModel):
    """A drone over fields, houses and trees: it flies forward, then sideways, and looks ahead all the time.

    Ranges are drawn from uniformly, once a scene.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    frames: int = Field(default=300, ge=1, description="frames per scene")
    rate_hz: float = Field(default=30.0, gt=0, description="frames a second")
    speed_m_s: Range = Field(default=(4.0, 6.0), description="speed of each leg")
    turn_over_s: float = Field(
        default=1.5, gt=0, description="time from the one leg's velocity to the other's"
    )
    height_m: Range = Field(default=(6.0, 12.0), description="camera above the plain")
    pitch_down: Range = Field(default=(0.05, 0.18), description="slope of the optical axis, downwards")
    clearance_m: float = Field(default=3.0, ge=0, description="least room between the path and any surface")
    mounds: tuple[int, int] = Field(default=(4, 7), description="rises in the ground, 1 to 2.5 m high")
    houses: tuple[int, int] = Field(default=(7, 11), description="fewest and most houses")
    near_trees: tuple[int, int] = Field(
        default=(5, 8), description="6 to 18 m ahead of some point of the path"
    )
    trees: tuple[int, int] = Field(default=(28, 42), description="farther than that, up to 200 m")
    woods: tuple[int, int] = Field(default=(5, 9), description="groups of a dozen trees, 60 to 220 m away")
    bushes: tuple[int, int] = Field(default=(60, 100), description="bushes and rocks")
    hills: tuple[int, int] = Field(
        default=(12, 17), description="hills 150 to 450 m away, all round the view"
    )

    @model_validator(mode="after")
    def _ordered(self) -> OutdoorConfig:
        names = ("speed_m_s", "height_m", "pitch_down", "mounds", "houses", "near_trees", "trees")
        for name in (*names, "woods", "bushes", "hills"):
            low, high = getattr(self, name)
            if not 0 <= low <= high:
                raise ValueError(f"{name}: expected 0 <= low <= high, got {low}, {high}")
        if self.height_m[0] < self.clearance_m + HIGHEST_MOUND_M:
            raise ValueError(
                f"height_m: expected at least clearance + mounds = "
                f"{self.clearance_m + HIGHEST_MOUND_M} m, got {self.height_m[0]} m"
            )
        return self

    @property
    def duration_s(self) -> float:
        """From the first frame to the end of the last."""
        return self.frames / self.rate_hz


HIGHEST_MOUND_M = 2.5


class Flight(BaseModel):
    """One way through a scene. World axes are OpenCV's: x right, y down, z ahead; the plain is y = 0."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    forward_m_s: float
    sideways_m_s: float = Field(description="to the right; negative to the left")
    height_m: float
    pitch_down: float = Field(description="slope of the optical axis, downwards")
    change_s: float = Field(description="middle of the change from forward to sideways")
    turn_over_s: float

    def velocity(self, time_s: Floats) -> Floats:
        """World velocity in m/s at each time, [F] to [F, 3]."""
        u = self._share(time_s)
        side = u * u * (3 - 2 * u)
        return np.stack([side * self.sideways_m_s, np.zeros_like(u), (1 - side) * self.forward_m_s], axis=-1)

    def position(self, time_s: Floats) -> Floats:
        """World position in metres at each time, [F] to [F, 3]: the integral of `velocity`, in closed form."""
        u = self._share(time_s)
        after_s = np.maximum(time_s - self.change_s - self.turn_over_s / 2, 0.0)
        side_s = self.turn_over_s * (u * u * u - 0.5 * u * u * u * u) + after_s
        height = np.full_like(side_s, -self.height_m)
        return np.stack([side_s * self.sideways_m_s, height, (time_s - side_s) * self.forward_m_s], axis=-1)

    @property
    def world_from_camera(self) -> Floats:
        """Orientation, the same at all times, shape (3, 3)."""
        length = np.sqrt(1 + self.pitch_down * self.pitch_down)
        sine, cosine = self.pitch_down / length, 1 / length
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])

    def _share(self, time_s: Floats) -> Floats:
        """How far the change from forward to sideways is done, 0..1."""
        started_s = self.change_s - self.turn_over_s / 2
        return np.asarray(np.clip((time_s - started_s) / self.turn_over_s, 0.0, 1.0))


def draw_flight(rng: np.random.Generator, config: OutdoorConfig) -> Flight:
    """A flight whose legs take half of the scene's time each."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    return Flight(
        forward_m_s=rng.uniform(*config.speed_m_s),
        sideways_m_s=side * rng.uniform(*config.speed_m_s),
        height_m=rng.uniform(*config.height_m),
        pitch_down=rng.uniform(*config.pitch_down),
        change_s=config.duration_s / 2,
        turn_over_s=config.turn_over_s,
    )
