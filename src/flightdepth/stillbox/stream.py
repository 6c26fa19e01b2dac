"""Training pairs without end, rendered while they are used.

A pool of scenes moves along the dataset's scene numbers: `CHUNK` scenes leave and `CHUNK` new ones come each
time their share of pairs has been drawn. Which scenes stand in the pool, and which pair sample i is, follows
from (seed, i) alone, so a stream resumed at i goes on exactly as if it had never stopped.
"""

from __future__ import annotations

import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import Rendered, render
from flightdepth.scenes import StillBoxConfig, Textures, chance, draw_scene
from flightdepth.stillbox.h264 import filmed
from flightdepth.stillbox.motion_noise import MotionNoise
from flightdepth.stillbox.pairs import Batch, Flown, Pair, PairRule, make_pair, turned
from flightdepth.stillbox.photometric import LARGEST_PX, Photometric

CHUNK = 8
POOL_SCENES = 192
# What a random stream is for. Sample i's and scene n's crop, (seed, _SAMPLE, i) and (seed, CROP, n), are streams of
# scenes 2 and 3, too (`chance.stream`); they stay, since another order of the key would change all training.
_SAMPLE, CROP = 2, 3


@dataclass(frozen=True)
class Picture:
    """A crop of width x height from a square picture of `full_width` pixels: the focal length is the full one's.

    `fov_deg` None takes the scenes' field of view; a range is for a stream whose lens changes from scene to scene.
    """

    width: int
    height: int
    full_width: int
    fov_deg: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.width <= self.full_width and 0 < self.height <= self.full_width):
            raise BadInput(
                "picture size",
                expected=f"at most {self.full_width} x {self.full_width}",
                got=f"{self.width} x {self.height}",
            )

    def camera(self, horizontal_fov_deg: float, x: int, y: int) -> Camera:
        """Camera of the crop whose top-left pixel is (x, y)."""
        full = Camera.from_fov(self.full_width, self.full_width, horizontal_fov_deg)
        return full.cropped(x, y, self.width, self.height)

    def draw_camera(self, rng: np.random.Generator, config: StillBoxConfig) -> Camera:
        """Camera of a random crop, through a random lens where the picture allows several."""
        x = int(rng.integers(self.full_width - self.width + 1))
        y = int(rng.integers(self.full_width - self.height + 1))
        fov = config.horizontal_fov_deg if self.fov_deg is None else float(rng.uniform(*self.fov_deg))
        return self.camera(fov, x, y)

    def config_for(self, camera: Camera, config: StillBoxConfig) -> StillBoxConfig:
        """`config` for the lens that `camera` is a crop of: objects stand before it, and look as large through it."""
        half = self.full_width / 2 / camera.fx
        wider = half / math.tan(math.radians(config.horizontal_fov_deg) / 2)
        smallest, largest = config.angular_size
        return config.model_copy(
            update={
                "horizontal_fov_deg": 2 * math.degrees(math.atan(half)),
                "angular_size": (smallest * wider, largest * wider),
            }
        )


@dataclass
class PairStream:
    """Pairs of a dataset (config, seed). `pairs_per_scene` is a mean; the pool holds `pool_scenes` scenes.

    All pairs are seen in a mirror and turned by quarters by chance; `upright` leaves scenes in the open unturned.
    `objects_for_lens` draws each scene for its own lens (`Picture.config_for`), not for the config's.
    Scenes are rendered by all threads when their turn comes, and the pairs after them, so that nothing competes with a
    CPU that trains.
    """

    config: StillBoxConfig
    textures: Textures
    picture: Picture
    rule: PairRule
    seed: int
    photometric_share: float = 0.0
    h264_share: float = 0.0
    noise: MotionNoise | None = None
    upright: bool = False
    objects_for_lens: bool = False
    pool_scenes: int = POOL_SCENES
    pairs_per_scene: int = 40
    threads: int = 2
    _scenes: dict[int, Future[tuple[Flown, Rendered, Camera]]] = field(
        default_factory=dict, init=False, repr=False
    )
    _pool: range = field(default=range(0), init=False, repr=False)

    def __post_init__(self) -> None:
        if self.pool_scenes < CHUNK or self.pool_scenes % CHUNK:
            raise BadInput("pool_scenes", expected=f"a multiple of {CHUNK}", got=str(self.pool_scenes))
        larger_px = max(self.picture.width, self.picture.height)
        if self.photometric_share and larger_px > LARGEST_PX:
            raise BadInput(
                "pictures with camera effects", expected=f"at most {LARGEST_PX} px", got=f"{larger_px} px"
            )
        self._executor = ThreadPoolExecutor(self.threads, thread_name_prefix="pairs")
        self._effects = Photometric() if self.photometric_share else None

    def __enter__(self) -> PairStream:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)

    def batch(self, start: int, size: int) -> Batch:
        """Samples start .. start + size - 1, made by all threads; rendering errors surface here."""
        drawn = [self._draw(index) for index in range(start, start + size)]
        share = -(-size // self.threads)
        shares = (drawn[first : first + share] for first in range(0, size, share))
        made = self._executor.map(lambda part: [self._make(*each) for each in part], shares)
        return Batch(tuple(chain.from_iterable(made)))

    def _draw(self, index: int) -> tuple[np.random.Generator, Flown, Rendered, Camera]:
        """The sample's randomness and its scene."""
        rng = chance.stream(self.seed, _SAMPLE, index)
        pool = self._pool_at(index)
        return rng, *self._scenes[pool[int(rng.integers(len(pool)))]].result()

    def _make(self, rng: np.random.Generator, scene: Flown, rendered: Rendered, camera: Camera) -> Pair:
        pair = make_pair(scene, rendered, camera, self.rule, self.rule.draw_frames(rng, scene.frames))
        square = self.picture.width == self.picture.height
        turns = int(rng.integers(4)) if square else 2 * int(rng.integers(2))
        turns = 0 if self.upright and scene.is_open else turns
        pair = turned(pair, quarter_turns=turns, mirror=bool(rng.integers(2)))
        pair = self.noise(rng, pair) if self.noise else pair
        if self._effects and (self.photometric_share == 1 or rng.random() < self.photometric_share):
            pair = self._effects(rng, pair)
        return filmed(rng, pair) if self.h264_share and rng.random() < self.h264_share else pair

    def _pool_at(self, index: int) -> range:
        """Scene numbers in the pool when sample `index` is drawn; renders what is missing, drops the rest."""
        first = index // (CHUNK * self.pairs_per_scene) * CHUNK
        pool = range(first, first + self.pool_scenes)
        if pool != self._pool:
            known = self._scenes
            self._scenes = {n: known.get(n) or self._executor.submit(self._render, n) for n in pool}
            self._pool = pool
        return pool

    def _render(self, number: int) -> tuple[Flown, Rendered, Camera]:
        camera = self.picture.draw_camera(chance.stream(self.seed, CROP, number), self.config)
        config = self.picture.config_for(camera, self.config) if self.objects_for_lens else self.config
        scene = draw_scene(config, len(self.textures), self.seed, number)
        return scene, render(scene, self.textures, camera), camera
