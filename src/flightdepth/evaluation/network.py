"""A network, its peers and the truth on one test set, from one run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.metrics import PERCENTILES, PictureErrors, picture_errors, pooled, summary
from flightdepth.evaluation.pairs import Task, TruePair
from flightdepth.evaluation.peer import ClassicalPeer, best_constant_m, known_pixels
from flightdepth.evaluation.places import Indices, errors_by_place, places_of
from flightdepth.evaluation.provenance import network_facts, source_commit
from flightdepth.evaluation.sigma_scale import believed
from flightdepth.evaluation.spread import spread_summary
from flightdepth.files import without_nan
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.network import Network
from flightdepth.weights.card import NetworkCard


@dataclass(frozen=True)
class Answers:
    """Maps [h, w] in metres at D0 for one pair: the truth twice (see `Task`), the network's, the peer's, the spread.

    places  [h, w] index into `places.PLACES`
    """

    truth_m: Maps
    sampled_m: Maps
    network_m: Maps
    classical_m: Maps
    displacement: NDArray[np.float64]
    sigma_m: Maps | None
    places: Indices


def answers(network: Network, pairs: Iterable[TruePair]) -> Iterator[Answers]:
    """Ask the network and the classical peer for each pair."""
    peer = ClassicalPeer(network.card.depth_min_m, network.card.depth_max_m)
    for pair in pairs:
        task, network = Task.of(pair, network.card), network.at_focal(pair.focal_px)
        prediction = task.ask(network, pair)
        # At D0 the peer's range is the network's; with the displacement shortened to D0, so are its metres.
        classical_m = peer.depth(pair.previous, pair.current, task.nominal, task.camera)
        yield Answers(
            task.truth_m,
            task.sampled_m,
            prediction.depth_m[0],
            pooled(classical_m, task.truth_m.shape),
            np.asarray(pair.displacement, dtype=np.float64),
            None if prediction.sigma_m is None else prediction.sigma_m[0],
            places_of(task.apart, pair.current),
        )


def evaluate_network(
    network: Network, pairs: Iterable[TruePair], *, set_name: str, seed: int | None = None
) -> dict[str, Any]:
    """Errors of the network, of the best constant depth and of the classical peer, and the ratios of L1.

    The result can be written as JSON: None stands for what is not defined. `set_name` and `seed` say which
    test set it was. Below 1, a ratio says that the network is better.
    """
    rows = list(answers(network, pairs))
    truths = [row.truth_m for row in rows]
    constant_m = best_constant_m(truths)
    told = {
        "network": [row.network_m for row in rows],
        "constant": [np.full_like(truth, constant_m) for truth in truths],
        "classical": [row.classical_m for row in rows],
    }
    found = {
        who: [picture_errors(*pair) for pair in zip(maps, truths, strict=True)] for who, maps in told.items()
    }
    moved = [row.displacement for row in rows]
    summaries = {name: summary(pictures, moved) for name, pictures in found.items()}
    summaries["constant"]["depth_m"] = constant_m
    result = provenance(network, set_name, seed, len(rows))
    result["truth_percentiles_m"] = percentiles([row.sampled_m for row in rows])
    result |= {**summaries, "l1_ratios": l1_ratios(summaries)}
    result["places"] = errors_by_place([row.places for row in rows], truths, told)
    if spread := spread_of(rows, network.card):
        result["spread"] = spread
    return {key: without_nan(value) for key, value in result.items()}


def spread_of(rows: list[Answers], card: NetworkCard) -> dict[str, Any] | None:
    """How far the network's own error bar can be trusted, over all pixels with a truth; None where it gives none.

    `believed`: the share of those that flights would take for measured, and the share of these inside one sigma.
    """
    told = [(row.network_m, row.truth_m, row.sigma_m) for row in rows if row.sigma_m is not None]
    if not told:
        return None
    values = np.stack([np.concatenate([each.ravel() for each in maps]) for maps in zip(*told, strict=True)])
    depths, truths, sigmas = values[:, np.isfinite(values).all(axis=0)].astype(np.float64)
    if not depths.size:
        return None
    errors, counted = np.abs(depths - truths), believed(card, depths, sigmas)
    inside = float((errors[counted] < sigmas[counted]).mean()) if counted.any() else math.nan
    return spread_summary(errors, sigmas) | {
        "believed": {"share": float(counted.mean()), "inside_one": inside}
    }


def provenance(network: Network, set_name: str, seed: int | None, pairs: int) -> dict[str, Any]:
    """What was measured: the network and its weights, the runtime, the code, the test set."""
    card = network.card
    return network_facts(network) | {
        "samples": card.samples,
        "depth_range_m": [card.depth_min_m, card.depth_max_m],
        "commit": source_commit(),
        "set": set_name,
        "seed": seed,
        "pairs": pairs,
    }


def l1_ratios(summaries: dict[str, dict[str, Any]]) -> dict[str, float]:
    """L1 of the network over that of each peer; NaN where a peer has none."""
    own = summaries["network"]["l1_m"]
    peers = {name: summaries[name]["l1_m"] for name in ("constant", "classical")}
    return {name: own / l1_m if l1_m > 0 else math.nan for name, l1_m in peers.items()}


def relative_cost(exact: Network, rounded: Network, pairs: Iterable[TruePair]) -> dict[str, float | None]:
    """What a shorter number format costs: L1 with it over L1 without, less 1, and both L1 in metres.

    `largest_change` is the largest |rounded - exact| / exact of any pixel.
    """
    errors: tuple[list[PictureErrors], list[PictureErrors]] = [], []
    largest = 0.0
    for pair in pairs:
        task = Task.of(pair, exact.card)
        answers_m = [task.ask(network, pair).depth_m[0] for network in (exact, rounded)]
        for found, answer_m in zip(errors, answers_m, strict=True):
            found.append(picture_errors(answer_m, task.truth_m))
        change = np.abs(answers_m[1] - answers_m[0]) / np.maximum(answers_m[0], 1e-3)
        largest = max(largest, float(change.max()))
    exact_m, rounded_m = (summary(pictures, [])["l1_m"] for pictures in errors)
    cost = rounded_m / exact_m - 1 if exact_m > 0 else math.nan
    result = {"relative_cost": cost, "l1_exact_m": exact_m, "l1_rounded_m": rounded_m}
    return {key: without_nan(value) for key, value in result.items()} | {"largest_change": largest}


def percentiles(truths: list[Maps]) -> dict[str, float]:
    """Depth percentiles of a test set, to be held against those of the original set's pictures.

    Of single pixels: means over 4x4 make the nearest farther, the smaller the picture the more.
    """
    known = known_pixels(truths)
    values = np.percentile(known, PERCENTILES) if known.size else [math.nan] * len(PERCENTILES)
    return {str(share): float(value) for share, value in zip(PERCENTILES, values, strict=True)}
