"""The knobs of the outdoor generator, and the flight through its scenes. A set is (config, seed)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from flightdepth.scenes import chance
from flightdepth.scenes.config import Counts, Range
from flightdepth.scenes.scene import MOST_OBJECTS, Floats

OUTDOOR_VERSION = "1"
HIGHEST_MOUND_M = 2.5
FARTHEST_M = 300.0  # from there on the plain's end comes into view, and sky below it
# Objects of the ray caster that one of each may be built of, and the ground and its fields.
PIECES = {"mounds": 1, "hills": 1, "houses": 5, "near_trees": 16, "trees": 10, "woods": 12 * 4, "bushes": 3}
GROUND_PIECES = 100


class OutdoorConfig(BaseModel):
    """A drone over fields, houses and trees: two straight legs with a soft change between; it looks ahead all the time.

    Ranges are drawn from uniformly, once a scene.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    frames: int = Field(default=300, ge=1, description="frames per scene")
    rate_hz: float = Field(default=30.0, gt=0, description="frames a second")
    horizontal_fov_deg: float = Field(
        default=90.0, gt=0, lt=180, description="between the left and right edge"
    )
    orientation_noise_rad: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="N0: each frame is turned by this angle about a fresh random axis",
    )
    legs: Literal["forward-sideways", "any"] = Field(
        default="forward-sideways",
        description="forward, then to the left or right, level; or any headings, climbing or sinking",
    )
    climb_m_s: float = Field(default=2.0, ge=0, description="fastest climb or descent where legs are any")
    speed_m_s: Range = Field(default=(4.0, 6.0), description="speed of each leg, over the ground")
    turn_over_s: float = Field(
        default=1.5, gt=0, description="time from the one leg's velocity to the other's"
    )
    height_m: Range = Field(default=(6.0, 12.0), description="camera above the plain")
    pitch_down: Range = Field(default=(0.05, 0.18), description="slope of the optical axis, downwards")
    clearance_m: float = Field(
        default=3.0,
        ge=0,
        description="least room between the path and any surface; up to a third less beside eaves, crowns and bushes",
    )
    mounds: Counts = Field(default=(4, 7), description="rises in the ground, 0.9 to 2.5 m high")
    houses: Counts = Field(default=(7, 11), description="fewest and most houses")
    near_trees: Counts = Field(default=(5, 8), description="6 to 18 m ahead of some point of the path")
    trees: Counts = Field(default=(28, 42), description="farther than that, up to 200 m")
    woods: Counts = Field(default=(5, 9), description="groups of a dozen trees, 60 to 220 m away")
    bushes: Counts = Field(default=(60, 100), description="bushes and rocks")
    hills: Counts = Field(default=(12, 17), description="hills 260 to 620 m away, all round the view")

    @model_validator(mode="after")
    def _ordered(self) -> OutdoorConfig:
        if self.height_m[0] < self.clearance_m + HIGHEST_MOUND_M:
            raise ValueError(
                f"height_m: expected at least clearance + mounds = "
                f"{self.clearance_m + HIGHEST_MOUND_M} m, got {self.height_m[0]} m"
            )
        if self.farthest_m > FARTHEST_M:
            raise ValueError(
                f"speed_m_s: expected flights of at most {FARTHEST_M:g} m, where the plain has no end in sight, "
                f"got {self.farthest_m:.0f} m; fewer frames, a higher rate_hz or a lower speed mend it"
            )
        pieces = GROUND_PIECES + sum(each * getattr(self, name)[1] for name, each in PIECES.items())
        if pieces > MOST_OBJECTS:
            raise ValueError(
                f"{', '.join(PIECES)}: expected things of at most {MOST_OBJECTS} pieces, got up to {pieces}"
            )
        if self.legs == "any" and self.turn_over_s > self.duration_s:
            raise ValueError(
                f"turn_over_s: expected at most the scene's {self.duration_s:.2f} s, got {self.turn_over_s} s"
            )
        return self

    @property
    def time_step_s(self) -> float:
        """Time between two frames."""
        return 1.0 / self.rate_hz

    @property
    def farthest_m(self) -> float:
        """Longest way over the ground from the first frame to the last."""
        return self.speed_m_s[1] * (self.frames - 1) / self.rate_hz

    @property
    def duration_s(self) -> float:
        """From the first frame to the end of the last."""
        return self.frames / self.rate_hz


Velocity = tuple[float, float, float]


class Flight(BaseModel):
    """One way through a scene. World axes are OpenCV's: x right, y down, z ahead; the plain is y = 0."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    first_m_s: Velocity = Field(description="velocity of the first leg: right, down, ahead")
    second_m_s: Velocity = Field(description="velocity of the second leg")
    height_m: float = Field(description="at the start")
    pitch_down: float = Field(description="slope of the optical axis, downwards")
    change_s: float = Field(description="middle of the change from the first leg to the second")
    turn_over_s: float

    def velocity(self, time_s: Floats) -> Floats:
        """World velocity in m/s at each time, [F] to [F, 3]."""
        u = self._share(time_s)[:, None]
        done = u * u * (3 - 2 * u)
        return np.asarray((1 - done) * np.array(self.first_m_s) + done * np.array(self.second_m_s))

    def position(self, time_s: Floats) -> Floats:
        """World position in metres at each time, [F] to [F, 3]: the integral of `velocity`, in closed form."""
        u = self._share(time_s)
        after_s = np.maximum(time_s - self.change_s - self.turn_over_s / 2, 0.0)
        second_s = self.turn_over_s * (u * u * u - 0.5 * u * u * u * u) + after_s
        first_s = time_s - second_s
        flown = second_s[:, None] * np.array(self.second_m_s) + first_s[:, None] * np.array(self.first_m_s)
        # -0.0 adds nothing, not even a sign.
        return np.asarray(flown + np.array([-0.0, -self.height_m, -0.0]))

    @property
    def world_from_camera(self) -> Floats:
        """Orientation without noise, the same at all times, shape (3, 3)."""
        length = np.sqrt(1 + self.pitch_down * self.pitch_down)
        sine, cosine = self.pitch_down / length, 1 / length
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])

    def _share(self, time_s: Floats) -> Floats:
        """How far the change from the first leg to the second is done, 0..1."""
        started_s = self.change_s - self.turn_over_s / 2
        return np.asarray(np.clip((time_s - started_s) / self.turn_over_s, 0.0, 1.0))


def draw_flight(rng: np.random.Generator, config: OutdoorConfig) -> Flight:
    """A flight whose legs take half of the scene's time each."""
    first, second, height_m = (_forward_sideways if config.legs == "forward-sideways" else _any_way)(
        rng, config
    )
    return Flight(
        first_m_s=first,
        second_m_s=second,
        height_m=height_m,
        pitch_down=rng.uniform(*config.pitch_down),
        change_s=config.duration_s / 2,
        turn_over_s=config.turn_over_s,
    )


def _forward_sideways(rng: np.random.Generator, config: OutdoorConfig) -> tuple[Velocity, Velocity, float]:
    """Velocities of the legs and the height at the start: ahead, then to either side, level."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    ahead, sideways = rng.uniform(*config.speed_m_s), side * rng.uniform(*config.speed_m_s)
    # The side's sign on a zero keeps the bits of the flights that were drawn before.
    return (0.0 * side, 0.0, ahead), (sideways, 0.0, 0.0), rng.uniform(*config.height_m)


def _any_way(rng: np.random.Generator, config: OutdoorConfig) -> tuple[Velocity, Velocity, float]:
    """The same with any heading, climbing or sinking towards a height of the range."""
    start_m = height_m = rng.uniform(*config.height_m)
    leg_s, most = config.duration_s / 2, config.climb_m_s
    legs: list[Velocity] = []
    for _ in range(2):
        right, ahead = rng.uniform(*config.speed_m_s) * chance.unit_vector(rng, 2)
        climb = min(max((rng.uniform(*config.height_m) - height_m) / leg_s, -most), most)
        legs.append((float(right), -climb, float(ahead)))
        height_m += climb * leg_s
    return legs[0], legs[1], start_m
