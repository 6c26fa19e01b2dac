"""Which fixed test set a network is measured on."""

from __future__ import annotations

from flightdepth.errors import BadInput
from flightdepth.scenes import Textures
from flightdepth.stillbox import PairRule, Picture, TestSet
from flightdepth.stillbox.testset import SCENES
from flightdepth.weights.card import NetworkCard

ANY_LENS_PX = 256


def fixed_set(card: NetworkCard, *, scenes: int = SCENES, textures: Textures | None = None) -> TestSet:
    """Nominal pairs, square, at the network's focal length (any lens: 256 px, 90 degrees), clipped to its range.

    `textures` None takes the fixed set's own; others make a set of one's own, not to be compared.
    """
    if scenes < 1:
        raise BadInput("scenes of a test set", expected="at least 1", got=str(scenes))
    width = ANY_LENS_PX if card.any_lens else square_width(card)
    full_width = ANY_LENS_PX if card.any_lens else round(2 * card.focal_px)  # 90 degrees of view
    rule = PairRule(card.nominal_shift, card.depth_min_m, card.depth_max_m)
    return TestSet(Picture(width, width, full_width), rule, scenes, textures=textures)


def set_name(pairs: TestSet) -> str:
    """What a table calls a test set."""
    picture = pairs.picture
    textures = "" if pairs.textures is None else ", own textures"
    crop = "" if picture.width == picture.full_width else f", crops of {picture.full_width} px"
    return f"Still Box {picture.width} px{crop}, shift {pairs.rule.nominal_shift}{textures}"


def square_width(card: NetworkCard) -> int:
    """Width of the last square stage at the network's focal length, or else the last stage's shorter side."""
    squares = [
        stage.width
        for stage in card.stages
        if stage.width == stage.height and stage.focal_px == card.focal_px
    ]
    return squares[-1] if squares else min(card.width, card.height)
