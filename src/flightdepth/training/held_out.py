"""Pairs that training never sees, for a test error while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

from torch.utils.tensorboard import SummaryWriter

from flightdepth.scenes import Textures
from flightdepth.stillbox import PairStream
from flightdepth.stillbox.sets import LAST_SEED
from flightdepth.stillbox.stored import StoredSet
from flightdepth.stillbox.stored_pairs import StoredPairs
from flightdepth.training.feed import Feed
from flightdepth.training.inputs import TensorBatch
from flightdepth.training.recipe import Recipe

SCENES, PAIRS = 16, 32  # of each stage
AT_ONCE = 8  # pairs that a network sees at a time
TEST_EVERY_S = 600.0  # and at a stage's end: less than 1 % of the time
SEED = LAST_SEED  # of their scenes: no stage's (`loop.stream_seed`)


@dataclass(frozen=True)
class HeldOut:
    """Such pairs for each stage of a recipe, its crops and lenses, without camera effects or wrong
    motion.

    Their scenes are drawn, in `textures`, from a seed of their own, or read from `sets`, by width, which hold none that
    training learns from. Made by `threads` threads.
    """

    recipe: Recipe
    textures: Textures
    sets: Mapping[int, StoredSet]
    threads: int

    def batches(self, number: int, *, workers: int, sweep_later: bool) -> list[TensorBatch]:
        """The `PAIRS` pairs of stage `number`, always the same; made by a process of their own where training's are.

        A process that has made pairs itself should not fork any more: OpenCV's threads would be missing in its workers.

        Raises:
            BadInput: a stored scene is missing or damaged.
        """
        stream = partial(self._stream, number)
        feed = Feed(self.recipe, stream, AT_ONCE, workers=min(workers, 1), sweep_later=sweep_later)
        with feed.batches(0) as made:
            return list(islice(made, PAIRS // AT_ONCE))

    def _stream(self, number: int, _: int) -> PairStream:
        stage = self.recipe.stages[number]
        picture = stage.picture
        opened = partial(StoredPairs, stored=self.sets[picture.full_width]) if self.sets else PairStream
        return opened(
            config=self.recipe.scenes_in(stage),
            textures=self.textures,
            picture=picture,
            # The answer to still pairs is known without looking.
            rule=replace(self.recipe.rule, still=False, wide_share=stage.wide_share),
            seed=SEED,
            upright=stage.upright,
            objects_for_lens=stage.objects_for_lens,
            pool_scenes=SCENES,
            threads=self.threads,
        )


class StageTest:
    """The test error of a stage as it goes on; `l1_m` is what was measured last, None before that."""

    def __init__(
        self,
        batches: Sequence[TensorBatch],
        error_m: Callable[[Sequence[TensorBatch]], float],
        board: SummaryWriter,
        clock: Callable[[], float],
    ) -> None:
        self.l1_m: float | None = None
        self._batches, self._error_m, self._board, self._clock = batches, error_m, board, clock
        self._measured_s = clock()

    def measure(self, seen: int, *, ended: bool) -> None:
        """After `seen` pairs, if it is time or the stage has ended: measure it, and draw it."""
        if not ended and self._clock() - self._measured_s < TEST_EVERY_S:
            return
        self.l1_m = self._error_m(self._batches)
        self._board.add_scalar("test/l1_m", self.l1_m, seen)
        self._measured_s = self._clock()
