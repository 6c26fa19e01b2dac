"""A network's page: what it is, its errors by depth and by angle of travel, and pictures, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flightdepth.evaluation.network_tables import Words, figures, inside
from flightdepth.evaluation.pairs import TruePair
from flightdepth.evaluation.pictures import ERROR_SHARE, answered_sheet
from flightdepth.evaluation.sparsification import curve_svg
from flightdepth.evaluation.spread import LEFT_OUT
from flightdepth.files import write_atomic
from flightdepth.levels import Image, jpeg
from flightdepth.runtimes.network import Network
from flightdepth.weights.card import NetworkCard

QUALITY = 88  # of the JPEG
GAP_PX = 8
NAMES = {"network": "network", "classical": "classical peer", "constant": "best constant"}
ON_PAGE = Words(NAMES, "L1 of the network over this", "-")


def write_page(
    folder: Path, network: Network, result: Mapping[str, Any], pairs: Iterable[TruePair], given: str = ""
) -> list[Path]:
    """NAME.md and NAME.jpg in an existing folder, of `evaluate_network`'s result and some pairs to be shown.

    Where the network tells an error bar, NAME.svg too, its sparsification curve. `given`: see `page_text`.
    """
    name = network.card.name
    picture, page = folder / f"{name}.jpg", folder / f"{name}.md"
    write_atomic(picture, jpeg(sheets(network, pairs), QUALITY))
    write_atomic(page, page_text(network.card, result, picture.name, given).encode())
    if "spread" not in result:
        return [page, picture]
    curve = folder / f"{name}.svg"
    write_atomic(curve, curve_svg(result["spread"]).encode())
    return [page, picture, curve]


def sheets(network: Network, pairs: Iterable[TruePair]) -> Image:
    """RGB: for each pair input above truth, and beside them signed error above prediction; pairs side by side."""
    tiles = [answered_sheet(network, pair) for pair in pairs]
    gap = np.full((tiles[0].shape[0], GAP_PX, 3), 255, np.uint8)
    return np.hstack([part for tile in tiles for part in (tile, gap)][:-1]).astype(np.uint8)


def mean_of(card: NetworkCard) -> list[str]:
    """What else is in the weights, if anything."""
    other = card.mean_with[:16]
    return [f"What ships is the mean of these weights and of those of network {other}."] if other else []


def predecessor(card: NetworkCard) -> list[str]:
    """What shipped before, if anything."""
    before = card.went_on_from
    if before is None:
        return []
    error = "" if before.l1_m is None else f", L1 {before.l1_m:.3f} m on the fixed test set"
    return [
        f"It went on from what shipped before: {before.samples:,} pairs, weights {before.sha256[:16]}{error}."
    ]


def page_text(card: NetworkCard, result: Mapping[str, Any], picture: str, given: str = "") -> str:
    """The page; `given` are the options that say which pairs were measured."""
    errors, by_depth, by_angle, by_place = (markdown(*each) for each in figures(result, ON_PAGE))
    parts = [
        f"# {card.name}",
        what_it_is(card),
        markdown(
            ("stage", "pixels", "focal length px", "pairs", "batch", "learning rate"),
            [
                (
                    s.name,
                    f"{s.width}x{s.height}",
                    f"{s.focal_px:g}",
                    f"{s.samples:,}",
                    s.batch,
                    f"{s.learning_rate:g}" + ("" if s.optimizer == "adamw" else f" ({s.optimizer})"),
                )
                for s in card.stages
            ],
        ),
        *predecessor(card),
        *mean_of(card),
        f"## Errors\n\nOn {result['set']}, {result['pairs']} pairs:",
        errors,
        "By true depth, L1 in metres:",
        by_depth,
        "By the angle between the optical axis and the direction of travel (0 = forward), L1 in metres:",
        by_angle,
        "By place, L1 in metres: where depths within 4x4 px lie apart by three tenths, beside such places, and on what "
        "is flat, with a texture or with a deviation of less than 2 of 255 grey levels:",
        by_place,
        *spread(card, result),
        pictures_text(card, picture),
        written_by(card, result, given),
    ]
    return "\n\n".join(parts) + "\n"


def what_it_is(card: NetworkCard) -> str:
    """The card in a sentence or two."""
    lens = "any lens" if card.any_lens else "one focal length"
    told = "the displacement, a vector" if card.knows_direction else "the length of the displacement"
    return (
        f"{card.architecture} with {card.base_width} feature maps in its first layer, for {lens}. It is told {told},"
        f" and says depth from {card.depth_min_m:g} to {card.depth_max_m:g} m at a displacement of {card.D0_m:.3g} m"
        f" and a focal length of {card.focal_px:g} px; at another one, depth in proportion."
        f" {card.samples:,} training pairs:"
    )


def spread(card: NetworkCard, result: Mapping[str, Any]) -> list[str]:
    """How far the error bar can be trusted, where there is one."""
    if "spread" not in result:
        return []
    found = result["spread"]
    halved, best = (found["sparsification"][by][LEFT_OUT.index(0.5)] for by in ("by_sigma", "by_error"))
    return [
        f"Error bar: {inside(found)}.",
        f"![Sparsification curve]({card.name}.svg)",
        f"Without the half of the pixels whose sigma is largest the error is {halved:.2f} of what it is with all;"
        f" {best:.2f} if the true errors told which. Area between the curves: {found['area']:.3f}.",
    ]


def pictures_text(card: NetworkCard, picture: str) -> str:
    """The picture with its key."""
    full_m = ERROR_SHARE * card.depth_max_m
    return (
        f"## Pictures\n\n![Input, truth, error and prediction]({picture})\n\n"
        "The first pairs of the set. Of each: input above truth, signed error above prediction. Error: green none,"
        f" red too far, blue too near, full at {full_m:g} m. Depth: bright near, dark at {card.depth_max_m:g} m."
    )


def written_by(card: NetworkCard, result: Mapping[str, Any], given: str) -> str:
    """Where the figures come from; a set on the disk has no seed of ours."""
    which, seed = ("--set DIR", "") if result["seed"] is None else ("", f", seed {result['seed']}")
    options = " ".join(each for each in (card.name, given or which, "--report DIR") if each)
    return (
        f"Written by `flightdepth evaluate network {options}`: {result['runtime']},"
        f" weights {result['weights_sha256'][:16]}, commit {short(result['commit'])}{seed}."
    )


def short(commit: str | None) -> str:
    """A commit as people write it, with a mark where files differ from it."""
    return "unknown" if commit is None else commit[:12] + ("+changes" if "+" in commit else "")


def markdown(headings: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
