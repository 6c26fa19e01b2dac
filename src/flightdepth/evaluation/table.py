"""The paper's table of results: its rows, what others report for them, and what was measured here."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import torch
from rich.table import Table

from flightdepth import architectures
from flightdepth.camera import Camera
from flightdepth.evaluation.metrics import PERCENTILES
from flightdepth.evaluation.network_tables import number
from flightdepth.runtimes.network import Network
from flightdepth.scenes import Textures
from flightdepth.stillbox import PairRule, Picture, TestPair, TestSet
from flightdepth.stillbox.stream import CHUNK
from flightdepth.training.loop import pool_scenes, stream_seed
from flightdepth.training.run_folder import Trained
from flightdepth.weights.card import NetworkCard

UNTRAINED = "untrained"
NAME_WIDTH = 24  # of "DepthNet 64-128-256-512"
PAIRS_A_SIZE = 240_000  # of each size of the recipes, but for what 512 px go on with alone
RECIPES = ("table-depthnet", "table-depthnet-64-512", "table-depthnet-512", "table-flownets")
# Depth at PERCENTILES of five scenes of 256 px that were published with the original set: a set outside their span is
# nearer or farther.
ORIGINAL_M = (
    (4.7, 7.8, 16, 20, 55),
    (2.7, 4.3, 9.4, 24, 41),
    (2.7, 4.7, 47, 56, 70),
    (5.5, 9.4, 42, 59, 67),
    (5.5, 6.7, 11, 65, 81),
)


@dataclass(frozen=True)
class Published:
    """Errors in metres of the paper's table II."""

    l1_train_m: float
    l1_test_m: float
    rmse_train_m: float
    rmse_test_m: float


UNPUBLISHED = Published(math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Row:
    """A network and the widths that it was trained at, one after the other.

    source  RECIPE/STAGE whose end it is, or the name of a shipped network
    """

    title: str
    network: str
    chain: tuple[int, ...]
    source: str
    paper: Published | None = None

    @property
    def later_m(self) -> float | None:
        """Test L1 that the authors report later, where they do."""
        return LATER_L1_M.get(self.chain) if self.network == "DepthNet" and self.paper else None


CHAIN = (64, 128, 256, 512)
PAPER = {
    ("FlowNetS", (64,)): Published(1.69, 4.16, 4.25, 7.97),
    ("DepthNet", (64,)): Published(2.26, 4.49, 5.55, 8.44),
    ("FlowNetS", CHAIN): Published(0.658, 2.44, 1.99, 4.77),
    ("DepthNet", (64, 128)): Published(1.20, 3.07, 3.43, 6.30),
    ("DepthNet", (64, 128, 256)): Published(0.876, 2.44, 2.69, 4.99),
    ("DepthNet", CHAIN): Published(1.09, 2.48, 2.86, 4.90),
    ("DepthNet", (64, 512)): Published(1.02, 2.57, 2.81, 5.13),
    ("DepthNet", (512,)): Published(1.74, 4.59, 4.91, 8.62),
}
LATER_L1_M = {CHAIN[:1]: 4.65, CHAIN[:2]: 3.08, CHAIN[:3]: 2.29, CHAIN: 1.97}
OWN_RECIPES = {(64, 512): "table-depthnet-64-512", (512,): "table-depthnet-512"}  # not the chain's


def paper_row(network: str, chain: tuple[int, ...]) -> Row:
    """A row of the paper's table."""
    recipe = OWN_RECIPES.get(chain, f"table-{network.lower()}")
    title = f"{network} {'-'.join(map(str, chain))}"
    return Row(title, network, chain, f"{recipe}/{chain[-1]}", PAPER[network, chain])


def equal_compute_row(chain: tuple[int, ...]) -> Row:
    """DepthNet trained on, until it has cost as much as the whole chain."""
    title = f"DepthNet {'-'.join(map(str, chain))}, compute of the chain"
    return Row(title, "DepthNet", chain, f"{OWN_RECIPES[chain]}/512-more")


ROWS = (*(paper_row(*key) for key in PAPER), *(equal_compute_row(chain) for chain in OWN_RECIPES))


def shipped_row(card: NetworkCard) -> Row:
    """A shipped network, beside what others report for its chain of widths, if it is theirs."""
    chain = tuple(width for width, _ in groupby(round(2 * stage.focal_px) for stage in card.stages))
    published = (card.architecture, card.base_width) in (("DepthNet", 32), ("FlowNetS", 64))
    paper = PAPER.get((card.architecture, chain)) if published else None
    return Row(f"{card.name}, shipped", card.architecture, chain, card.name, paper)


def parameters(architecture: str, *base_width: int, **parts: int) -> int:
    """Trained numbers of a network; without a width, of the published one. `parts`: those that a MotionNet may have."""
    with torch.device("meta"):  # weights without numbers
        network = getattr(architectures, architecture)(*base_width, **parts)
    return sum(parameter.numel() for parameter in network.parameters())


def whole_set(card: NetworkCard, scenes: int) -> TestSet:
    """The fixed test set in whole pictures, also of a network that was trained on crops, as the paper has it."""
    width = round(2 * card.focal_px)
    rule = PairRule(card.nominal_shift, card.depth_min_m, card.depth_max_m)
    return TestSet(Picture(width, width, width), rule, scenes)


@dataclass(frozen=True)
class LastScenes:
    """Nominal pairs of the last scenes that a stage learnt from, made as those of the test set."""

    scenes: TestSet
    numbers: range

    @classmethod
    def of(cls, trained: Trained, card: NetworkCard, textures: Textures, scenes: int) -> LastScenes:
        """`scenes` of them at most; `textures` are those of the run."""
        recipe, stage = trained.recipe, trained.progress.stage
        parts, workers = trained.progress.parts or recipe.accumulate, trained.progress.workers
        last = max(trained.progress.sample // (parts * max(workers, 1)) - 1, 0)
        drawn = last // (CHUNK * recipe.pairs_per_scene) * CHUNK + pool_scenes(workers)
        width = round(2 * card.focal_px)
        config = recipe.scenes_in(recipe.stages[stage])
        whole = TestSet(
            Picture(width, width, width), recipe.rule, scenes, stream_seed(recipe, stage), textures, config
        )
        return cls(whole, range(max(0, drawn - scenes), drawn))

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[TestPair]:
        return map(self.scenes.pair, self.numbers)


def median_ms(network: Network, calls: int) -> float:
    """Median milliseconds of one pair at the network's own focal length, 90 degrees of view; inputs included."""
    width = round(2 * network.card.focal_px)
    pictures = np.random.default_rng(0).integers(0, 256, (2, width, width, 3), dtype=np.uint8)
    camera, moved = Camera.from_fov(width, width, 90), np.array([[network.card.D0_m, 0, 0]])
    taken = []
    for _ in range(calls + 2):  # the first two compile
        began = time.perf_counter()
        network.predict([pictures[0]], pictures[1], moved, camera)
        taken.append((time.perf_counter() - began) * 1e3)
    return statistics.median(taken[2:])


def inside_original(percentiles_m: Mapping[str, float]) -> bool:
    """Whether a set is as deep as the original's scenes are, so that metres can be compared."""
    spans = zip(PERCENTILES, zip(*ORIGINAL_M, strict=True), strict=True)
    return all(min(span) <= percentiles_m[str(share)] <= max(span) for share, span in spans)


def tables(rows: Sequence[tuple[Row, Mapping[str, Any] | None]]) -> list[Table]:
    """L1, RMSE and cost: three tables of the same rows, each fit for a narrow terminal."""
    return [l1_table(rows), rmse_table(rows), cost_table(rows)]


def l1_table(rows: Sequence[tuple[Row, Mapping[str, Any] | None]]) -> Table:
    """L1 in metres."""
    table = headed(
        "L1 in metres", "train", "paper", "test", "paper", "later", "test/train", "constant", "classical"
    )
    for row, found in rows:
        paper = row.paper or UNPUBLISHED
        train, test, *peers = error_columns(found, "l1_m")
        ratio = test / train if test and train else None
        add(table, row, found, [train, paper.l1_train_m, test, paper.l1_test_m, row.later_m, ratio, *peers])
    return table


def rmse_table(rows: Sequence[tuple[Row, Mapping[str, Any] | None]]) -> Table:
    """RMSE in metres."""
    table = headed("RMSE in metres", "train", "paper", "test", "paper", "constant", "classical")
    for row, found in rows:
        paper = row.paper or UNPUBLISHED
        train, test, *peers = error_columns(found, "rmse_m")
        add(table, row, found, [train, paper.rmse_train_m, test, paper.rmse_test_m, *peers])
    return table


def cost_table(rows: Sequence[tuple[Row, Mapping[str, Any] | None]]) -> Table:
    """Parameters, pairs seen, width of the test pictures, time."""
    table = headed("What it costs", "parameters M", "pairs seen", "px", "ms a pair")
    for row, found in rows:
        size = found["parameters"] if found else parameters(row.network)
        pairs, ms = (f"{found['samples']:,}", found["median_ms"]) if found else (UNTRAINED, None)
        width = found["width_px"] if found else row.chain[-1]
        table.add_row(row.title, number(size / 1e6, 1), pairs, str(width), number(ms, 1))
    return table


def headed(title: str, *columns: str) -> Table:
    """An empty table."""
    table = Table(title=title, box=None)
    table.add_column("network", min_width=NAME_WIDTH)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=column != "test/train")
    return table


def add(table: Table, row: Row, found: Mapping[str, Any] | None, metres: Sequence[float | None]) -> None:
    """A row of figures, the first that of training scenes; one that was not trained says so."""
    said = [number(value, 2) for value in metres]
    table.add_row(row.title, *([UNTRAINED, *said[1:]] if found is None else said))


def error_columns(found: Mapping[str, Any] | None, metric: str) -> list[float | None]:
    """Of the network on training and on test scenes, of the best constant and the classical peer on the latter, metres.

    None where there is none.
    """
    columns = (("train", "network"), ("test", "network"), ("test", "constant"), ("test", "classical"))
    return [((found or {}).get(part) or {}).get(who, {}).get(metric) for part, who in columns]
