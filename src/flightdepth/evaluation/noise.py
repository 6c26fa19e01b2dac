"""What wrong telemetry costs: the error of a network on pairs whose reported motion is off."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.evaluation.metrics import picture_errors
from flightdepth.evaluation.pairs import Task, TruePair, refuse_namesakes
from flightdepth.levels import Image
from flightdepth.motion import Vector
from flightdepth.ranges.derotation import derotated
from flightdepth.runtimes.network import Network
from flightdepth.scenes import chance
from flightdepth.stillbox.motion_noise import rotated, tilted

DIRECTION, SPEED, ROTATION = "direction off, degrees", "speed off, share", "unreported rotation, degrees"
# Kind of error -> its sizes.
KINDS: Mapping[str, tuple[float, ...]] = {
    DIRECTION: (0.0, 1.0, 2.0, 5.0, 10.0),
    SPEED: (0.0, 0.02, 0.05, 0.1),
    ROTATION: (0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0),
}
SEED = 11
DEROTATED = "{} derotated"  # heading of the errors after what the pictures show of it was taken out


def noise_rows(
    networks: Sequence[Network], pairs: Iterable[TruePair], *, derotate: bool = False
) -> list[dict[str, Any]]:
    """Rows {kind, size, L1 in metres per network}: one for each size of each of the KINDS of error, over all pairs.

    Every network is asked about the same wrong pairs; the truth stays what it is. `derotate` adds the L1 of
    each after the rotation and the direction seen in the pictures have mended the pair.

    Raises:
        BadInput: two have one name, or answer in other metres.
    """
    refuse_namesakes("networks", networks)
    rows: dict[tuple[str, float], dict[str, list[float]]] = {
        (kind, size): {} for kind, sizes in KINDS.items() for size in sizes
    }
    for number, pair in enumerate(pairs):
        networks = [network.at_focal(pair.focal_px) for network in networks]
        _refuse_other_metres(networks)
        for (kind, size), columns in rows.items():
            for network in networks:
                for name, error_m in _errors_m(
                    network, pair, (kind, size), chance.stream(SEED, number), derotate=derotate
                ):
                    columns.setdefault(name, []).append(error_m)
    return [
        {"kind": kind, "size": size} | {name: float(np.mean(column)) for name, column in columns.items()}
        for (kind, size), columns in rows.items()
    ]


def _refuse_other_metres(networks: Sequence[Network]) -> None:
    """Errors can be compared where all depths are clipped alike and are metres at one displacement."""
    told = [
        f"{card.depth_min_m:g} to {card.depth_max_m:g} m at {card.D0_m:.3g} m"
        for card in (network.card for network in networks)
    ]
    if len(set(told)) > 1:
        got = ", ".join(f"{each.card.name} {range_m}" for each, range_m in zip(networks, told, strict=True))
        mend = "Measure them one after the other."
        raise BadInput("networks", expected="networks of one range", got=got, mend=mend)


def _errors_m(
    network: Network, pair: TruePair, error: tuple[str, float], rng: np.random.Generator, *, derotate: bool
) -> Iterator[tuple[str, float]]:
    """L1 by column: as reported, and mended where asked for."""
    task = Task.of(pair, network.card)
    reported = _reported(task, pair, error, rng)
    tries = {network.card.name: reported}
    if derotate:
        previous, nominal, _ = derotated(reported[0], pair.current, reported[1], task.camera)
        tries[DEROTATED.format(network.card.name)] = previous, nominal
    for name, (previous, nominal) in tries.items():
        found = task.ask(network, pair, previous=previous, nominal=nominal)
        yield name, picture_errors(found.depth_m[0], task.truth_m).l1_m


def _reported(
    task: Task, pair: TruePair, error: tuple[str, float], rng: np.random.Generator
) -> tuple[Image, Vector]:
    """The pair as telemetry that errs so tells it: the earlier picture, and the displacement at D0, metres (3,)."""
    kind, size = error
    if kind == DIRECTION:
        return pair.previous, tilted(task.nominal, chance.unit_vector(rng), size)
    if kind == SPEED:
        return pair.previous, task.nominal * (1 + (size if rng.random() < 0.5 else -size))
    turn = chance.unit_vector(rng) * np.radians(size)
    return rotated(pair.previous, task.camera, turn), task.nominal
