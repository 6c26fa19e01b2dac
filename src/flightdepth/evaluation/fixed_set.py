"""Which fixed test set a network is measured on."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from flightdepth.errors import BadInput
from flightdepth.evaluation.pairs import SAME_FOCAL
from flightdepth.runtimes.contract import STRIDE
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox import OutdoorTestSet, PairRule, Picture, StoredTestSet, TestSet
from flightdepth.stillbox.sets import ANY_FLIGHT, changed
from flightdepth.stillbox.stored import open_stored_set
from flightdepth.stillbox.testset import SCENES
from flightdepth.weights.card import FLIGHT_DETAIL, NetworkCard

AnySet = TestSet | OutdoorTestSet | StoredTestSet

MOST_PX = 256  # of the pictures that a network for one lens is measured on: crops of larger ones


def outdoor_set(card: NetworkCard, *, scenes: int, flight_size: bool = False) -> OutdoorTestSet:
    """Flights outdoors, like no training room, `full_width` wide; `flight_size` as of `fixed_set`."""
    _check(scenes)
    detail = _detail(card, flight_size=flight_size)
    width, fov_deg = _in_strides(card, full_width(card), ANY_FLIGHT.horizontal_fov_deg)
    low, high = ANY_FLIGHT.speed_m_s
    changes = {"horizontal_fov_deg": fov_deg, "speed_m_s": (low / detail, high / detail)}
    return OutdoorTestSet(detail * width, scenes, config=changed(ANY_FLIGHT, changes))


def fixed_set(
    card: NetworkCard,
    *,
    scenes: int = SCENES,
    textures: Textures | None = None,
    horizontal_fov_deg: float = 90.0,
    flight_size: bool = False,
) -> TestSet:
    """Nominal pairs, square, of pictures `full_width` wide or crops of them, clipped to the network's range.

    Where that is narrow and no whole number of strides, of the nearest that is, through a lens that fits. Their
    frames are the displacement of the network's own training apart.

    `textures` None takes the fixed set's own; others make a set of one's own, not to be compared, and so does
    another field of view, which a network for any lens alone can take. With `flight_size` pictures are as large as such
    a network sees flights through that lens, and as many times less far apart, so that points move by as many pixels.
    """
    if horizontal_fov_deg != 90.0 and not card.any_lens:
        raise BadInput(
            f"--fov for {card.name}", expected="90 degrees, its own", got=f"{horizontal_fov_deg:g}"
        )
    _check(scenes)
    detail = _detail(card, flight_size=flight_size)
    full = full_width(card)
    if full <= MOST_PX:
        full, horizontal_fov_deg = _in_strides(card, full, horizontal_fov_deg)
    config = StillBoxConfig()
    # One for any lens: that of 90 degrees, whatever the field of view.
    speed_m_s = card.at_focal(full / 2).D0_m / card.nominal_shift / config.time_step_s
    full *= detail
    width = full if card.any_lens else min(full, MOST_PX)
    rule = PairRule(card.nominal_shift, card.depth_min_m, card.depth_max_m)
    # Rounded: the usual one is 1 to the bit.
    config = changed(
        config, {"horizontal_fov_deg": horizontal_fov_deg, "speed_m_s": round(speed_m_s / detail, 9)}
    )
    return TestSet(Picture(width, width, full), rule, scenes, textures=textures, config=config)


def stored_set(
    card: NetworkCard, folder: Path, *, scenes: int | None = None, held_out: bool = False
) -> StoredTestSet:
    """The first `scenes` of a set in a folder (None: all), the frames about the network's own displacement apart.

    `held_out`: of the fifth that a network which learns from the set does not see.

    Raises:
        BadInput: no set, one of another focal length than that of a network for one lens, or a turning camera.
    """
    found = open_stored_set(folder)
    if held_out:
        found = found.split()[1]
    if scenes is not None:
        _check(scenes)
        found = replace(found, entries=found.entries[:scenes])
    focal_px = found.camera.fx
    if not card.any_lens and abs(focal_px / card.focal_px - 1) > SAME_FOCAL:
        raise BadInput(
            f"set {folder}",
            expected=f"focal length {card.focal_px:g} px, {card.name}'s",
            got=f"{focal_px:g} px",
        )
    return StoredTestSet(found, card.at_focal(focal_px).D0_m, STRIDE, held_out)


def _check(scenes: int) -> None:
    if scenes < 1:
        raise BadInput("scenes of a test set", expected="at least 1", got=str(scenes))


def full_width(card: NetworkCard) -> int:
    """Width of 90 degrees of view at the network's focal length.

    For any lens at about its recipe's reference length, so that networks see no padding.
    """
    if not card.any_lens:
        return round(2 * card.focal_px)
    return STRIDE * max(1, round(2 * card.focal_px / FLIGHT_DETAIL / STRIDE))


def _detail(card: NetworkCard, *, flight_size: bool) -> int:
    """How many times as fine pictures are as `full_width` says."""
    if flight_size and not card.any_lens:
        raise BadInput(
            f"--flight-size for {card.name}", expected="a network for any lens", got="one for its own"
        )
    return FLIGHT_DETAIL if flight_size else 1


def _in_strides(card: NetworkCard, width: int, fov_deg: float) -> tuple[int, float]:
    """A width that networks take as it is, and the field of view in degrees that has the card's focal length there.

    Both as given where that is one: of whole pictures of 64, 128, 256 and 512 px through 90 degrees.
    """
    if width % STRIDE == 0:
        return width, fov_deg
    whole = STRIDE * max(1, round(width / STRIDE))
    return whole, round(math.degrees(2 * math.atan(whole / 2 / card.focal_px)), 2)


def set_name(pairs: AnySet) -> str:
    """What a table calls a test set; own textures by the beginning of their hash."""
    if isinstance(pairs, StoredTestSet):
        stored = pairs.stored
        lens = f"{stored.width} px, {stored.horizontal_fov_deg:g} degrees"
        part = "held-out scenes" if pairs.held_out else "scenes"
        return f"{stored.folder.name}, {lens}, by {stored.renderer}, {part} {stored.digest}"
    if isinstance(pairs, OutdoorTestSet):
        return f"outdoor flights {pairs.width} px{_lens(pairs)}"
    picture = pairs.picture
    textures = "" if pairs.textures is None else f", own textures {pairs.textures.digest[:12]}"
    crop = "" if picture.width == picture.full_width else f", crops of {picture.full_width} px"
    lens = _lens(pairs)
    step_m = pairs.config.step_m
    shift = f"shift {pairs.rule.nominal_shift}" + ("" if step_m == 0.1 else f" of {step_m:g} m")
    return f"Still Box {picture.width} px{crop}, {shift}{lens}{textures}"


def _lens(pairs: TestSet | OutdoorTestSet) -> str:
    """The field of view, where it is another than usual."""
    fov_deg = pairs.config.horizontal_fov_deg
    return "" if fov_deg == 90 else f", {fov_deg:g} degrees"
