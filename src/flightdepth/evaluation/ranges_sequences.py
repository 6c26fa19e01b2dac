"""The study's sequences: straight flights through Still Box rooms, with their true depth."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.evaluation.metrics import pooled
from flightdepth.files import file_in_progress
from flightdepth.levels import Image
from flightdepth.machine import usable_cores
from flightdepth.motion import Vector
from flightdepth.renderers.raycast import VERSION, render
from flightdepth.runtimes.arrays import Maps
from flightdepth.scenes import StillBoxConfig, Textures, chance
from flightdepth.scenes.config import SET_VERSION
from flightdepth.stillbox.sets import SceneSet, changed

SEED = 51  # of the study; the test sets and training have others
WIDTH = 256
SPEED_M_S, STEP_S = 1.0, 0.033  # 1 m/s at 30 Hz, as in the paper
CLEARANCE_M = 2.0
NS_PER_S = 1_000_000_000


@dataclass(frozen=True, eq=False)
class Sequence:
    """One flight; the camera's axes are those without noise.

    images      uint8 RGB [F, H, W, 3]
    truth_m     [F, h, w] z-depth in metres, averaged over 4x4 pixels as networks see it, not clipped
    velocity    [F, 3] m/s
    stamps_ns   [F]
    """

    number: int
    camera: Camera
    images: Image
    truth_m: Maps
    velocity: Vector
    stamps_ns: NDArray[np.int64]


@dataclass(frozen=True)
class Sequences:
    """Sequence `number` follows from these alone; the same scene has the same path at any noise."""

    frames: int
    width: int = WIDTH

    def render(self, number: int, noise_rad: float, textures: Textures) -> Sequence:
        """All frames, on every core that this process may use."""
        drawn = SceneSet(self.config(noise_rad), self.width, self.width, SEED)
        scene = drawn.scene(number, len(textures))
        with ThreadPoolExecutor(usable_cores()) as executor:
            rendered = render(scene, textures, drawn.camera, executor=executor)
        shape = (self.width // 4, self.width // 4)
        truth_m = np.stack([pooled(depth_m, shape) for depth_m in rendered.depth_m])
        return self.sequence(number, noise_rad, rendered.images, truth_m)

    @property
    def facts(self) -> dict[str, Any]:
        """What the pictures follow from, but for noise and number."""
        return {
            "frames": self.frames,
            "width": self.width,
            "seed": SEED,
            "set_version": SET_VERSION,
            "renderer": VERSION,
            "config": self.config(0.0).model_dump(mode="json"),
        }

    @property
    def focal_px(self) -> float:
        """Of the pictures."""
        return self.config(0.0).focal_px(self.width)

    def sequence(self, number: int, noise_rad: float, images: Image, truth_m: Maps) -> Sequence:
        """The sequence of which these are the pictures and depths."""
        drawn = SceneSet(self.config(noise_rad), self.width, self.width, SEED)
        stamps = np.arange(self.frames, dtype=np.int64) * round(STEP_S * NS_PER_S)
        # The world has the axes of the first camera without noise, and nothing turns on purpose.
        return Sequence(number, drawn.camera, images, truth_m, drawn.velocity(number), stamps)

    def config(self, noise_rad: float) -> StillBoxConfig:
        """How the scenes are drawn."""
        return changed(
            StillBoxConfig(),
            {
                "frames": self.frames,
                "speed_m_s": SPEED_M_S,
                "time_step_s": STEP_S,
                "clearance_m": CLEARANCE_M,
                "objects_ahead_of": "path",
                "orientation_noise_rad": noise_rad,
            },
        )


class KeptSequences:
    """Sequences on the disk: each is rendered once, whatever asks for it later.

    `textures` are made when the first is rendered; `digest` is theirs, empty for those of the fixed test sets.
    """

    def __init__(
        self, folder: Path, sequences: Sequences, textures: Callable[[], Textures], digest: str
    ) -> None:
        self._folder, self._sequences, self._textures, self._digest = folder, sequences, textures, digest

    def path(self, number: int, noise_rad: float) -> Path:
        """The file of a sequence; its name changes with all that its pictures follow from."""
        facts = self._sequences.facts | {"noise_rad": noise_rad, "textures": self._digest}
        digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]
        return self._folder / f"{number:03d}_{digest}.npz"

    def get(self, number: int, noise_rad: float) -> Sequence:
        """From the disk, or rendered and then kept."""
        path = self.path(number, noise_rad)
        if not path.exists():
            rendered = self._sequences.render(number, noise_rad, self._textures())
            self._folder.mkdir(parents=True, exist_ok=True)
            with file_in_progress(path) as file:
                np.savez(file, images=rendered.images, truth_m=rendered.truth_m)
        with np.load(path) as kept:
            return self._sequences.sequence(number, noise_rad, kept["images"], kept["truth_m"])


def log_of(sequence: Sequence, rate_hz: float, noise_m_s: float, bias: float) -> list[tuple[int, Vector]]:
    """Velocity samples (stamp_ns, m/s in the camera's axes) of a log that errs so; the same at each call."""
    end_ns = int(sequence.stamps_ns[-1])
    stamps = np.arange(0, end_ns + 1, round(NS_PER_S / rate_hz), dtype=np.int64)
    exact = [np.interp(stamps, sequence.stamps_ns, axis) for axis in sequence.velocity.T]
    velocity = np.stack(exact, axis=1) * (1 + bias)
    noise = chance.stream(SEED, sequence.number, 3).standard_normal(velocity.shape)
    return list(zip(stamps.tolist(), velocity + noise_m_s * noise, strict=True))
