"""The fixed test sets: 300 scenes a resolution, procedural textures only, one nominal pair a scene."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import Scene, StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.scenes.scene import Floats
from flightdepth.stillbox.pairs import Depth, Image, PairRule
from flightdepth.stillbox.sets import ANY_FLIGHT, SceneSet
from flightdepth.stillbox.stream import Picture

Drawn = tuple[Scene, Textures, Camera, tuple[int, int]]

SCENES = 300
SEED = 1702_0_2017  # of the test scenes; training seeds are small numbers
TEXTURE_SEED, TEXTURES = 7, 96


@lru_cache(maxsize=2)
def test_textures(seed: int = TEXTURE_SEED) -> Textures:
    """The textures of every fixed test set, or as many of another seed; kept, 100 MB a seed."""
    return Textures.procedural(TEXTURES, seed)


@dataclass(frozen=True)
class TestPair:
    """One nominal pair; depth_m float32 [H, W] of `current`, not clipped; displacement [3] metres."""

    __test__ = False  # not a test case, whatever its name

    previous: Image
    current: Image
    depth_m: Depth
    displacement: Floats
    focal_px: float


@dataclass(frozen=True)
class TestSet:
    """A fixed test set; `textures` other than None replaces the fixed ones (a set of your own, then)."""

    __test__ = False

    picture: Picture
    rule: PairRule
    scenes: int = SCENES
    seed: int = SEED
    textures: Textures | None = None
    config: StillBoxConfig = field(default_factory=StillBoxConfig)

    def __len__(self) -> int:
        return self.scenes

    def __iter__(self) -> Iterator[TestPair]:
        with ThreadPoolExecutor(2) as executor:
            yield from executor.map(self.pair, range(self.scenes))

    def pair(self, number: int) -> TestPair:
        """The pair of scene `number`: frames in the middle of the scene, the nominal shift apart."""
        return _seen(*self.drawn(number))

    def drawn(self, number: int) -> Drawn:
        """What the pair of scene `number` is rendered from: scene, textures, camera, numbers of its two frames."""
        textures = test_textures() if self.textures is None else self.textures
        shift = self.rule.nominal_shift
        config = self.config.model_copy(update={"frames": max(self.config.frames, shift + 1)})
        scene = draw_scene(config, len(textures), self.seed, number)
        previous = (config.frames - shift) // 2
        x = (self.picture.full_width - self.picture.width) // 2
        y = (self.picture.full_width - self.picture.height) // 2
        camera = self.picture.camera(self.config.horizontal_fov_deg, x, y)
        return scene, textures, camera, (previous, previous + shift)


@dataclass(frozen=True)
class OutdoorTestSet:
    """Pairs of frames 0.1 s apart (0.4 to 0.6 m) of drone flights outdoors, any heading, under a sky."""

    __test__ = False

    width: int
    scenes: int
    seed: int = SEED
    config: OutdoorConfig = ANY_FLIGHT

    def __len__(self) -> int:
        return self.scenes

    def __iter__(self) -> Iterator[TestPair]:
        with ThreadPoolExecutor(2) as executor:
            yield from executor.map(self.pair, range(self.scenes))

    def pair(self, number: int) -> TestPair:
        """The pair of flight `number`, in the middle of its first or second leg in turns."""
        drawn = SceneSet(self.config, self.width, self.width, self.seed)
        frames = (15, 16) if number % 2 else (45, 46)
        scene = drawn.scene(number, 0)
        return _seen(scene, outdoor_textures(self.seed), drawn.camera, frames)


def _seen(scene: Scene, textures: Textures, camera: Camera, frames: tuple[int, int]) -> TestPair:
    """Two frames of a scene, (previous, current)."""
    rendered = render(scene, textures, camera, frames=frames)
    moved = scene.displacement(*frames)
    return TestPair(rendered.images[0], rendered.images[1], rendered.depth_m[1], moved, camera.fx)
