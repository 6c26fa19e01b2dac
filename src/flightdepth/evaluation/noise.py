"""What wrong telemetry costs: the error of a network on pairs whose reported motion is off."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.evaluation.metrics import picture_errors
from flightdepth.evaluation.pairs import Task, TruePair, refuse_namesakes
from flightdepth.ranges.derotation import derotated
from flightdepth.runtimes.network import Network
from flightdepth.scenes import chance
from flightdepth.stillbox.motion_noise import rotated, tilted

# Kind of error -> its sizes: degrees, share of the speed, degrees.
KINDS: Mapping[str, tuple[float, ...]] = {
    "direction off, degrees": (0.0, 1.0, 2.0, 5.0, 10.0),
    "speed off, share": (0.0, 0.02, 0.05, 0.1),
    "unreported rotation, degrees": (0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0),
}
SEED = 11
DEROTATED = "{} derotated"  # heading of the errors after what the pictures show of it was taken out


@dataclass(frozen=True)
class Wrong:
    """A pair as telemetry reports it: the earlier picture, and the displacement at D0, metres (3,)."""

    previous: NDArray[np.uint8]
    nominal: NDArray[np.float64]


def noise_rows(
    networks: Sequence[Network],
    pairs: Iterable[TruePair],
    kinds: Mapping[str, tuple[float, ...]] = KINDS,
    *,
    derotate: bool = False,
) -> list[dict[str, Any]]:
    """Rows {kind, size, L1 in metres per network}: one for each kind of error and size, over all pairs.

    Every network is asked about the same wrong pairs; the truth stays what it is. `derotate` adds the L1 of
    each after the rotation and the direction seen in the pictures have mended the pair.

    Raises:
        BadInput: two have one name, or answer in other metres.
    """
    refuse_namesakes("networks", networks)
    rows: dict[tuple[str, float], dict[str, list[float]]] = {
        (kind, size): {} for kind, sizes in kinds.items() for size in sizes
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
    kind, size = error
    task = Task.of(pair, network.card)
    wrong = WRONGS[kind](task, pair, size, rng)
    tries = {network.card.name: wrong}
    if derotate:
        previous, nominal, _ = derotated(wrong.previous, pair.current, wrong.nominal, task.camera)
        tries[DEROTATED.format(network.card.name)] = Wrong(previous, nominal)
    for name, each in tries.items():
        found = task.ask(network, pair, previous=each.previous, nominal=each.nominal)
        yield name, picture_errors(found.depth_m[0], task.truth_m).l1_m


def _direction(task: Task, pair: TruePair, degrees: float, rng: np.random.Generator) -> Wrong:
    return Wrong(pair.previous, tilted(task.nominal, chance.unit_vector(rng), degrees))


def _speed(task: Task, pair: TruePair, share: float, rng: np.random.Generator) -> Wrong:
    return Wrong(pair.previous, task.nominal * (1 + (share if rng.random() < 0.5 else -share)))


def _rotation(task: Task, pair: TruePair, degrees: float, rng: np.random.Generator) -> Wrong:
    vector = chance.unit_vector(rng) * np.radians(degrees)
    return Wrong(rotated(pair.previous, task.camera, vector), task.nominal)


WRONGS: Mapping[str, Callable[[Task, TruePair, float, np.random.Generator], Wrong]] = dict(
    zip(KINDS, (_direction, _speed, _rotation), strict=True)
)
