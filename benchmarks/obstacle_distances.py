"""How far the obstacle distances are from the truth: python benchmarks/obstacle_distances.py [--quick] [--work DIR]

Rendered flights among trees and houses, ahead and then sideways, at 4 to 6 m/s, 30 pictures/s, each through JPEG; the
log's velocity has 0.05 m/s of noise. What an autopilot reads AGE_FRAMES after a picture is held against the true
depth of that later time, sector by sector, for n = 1, 2, 3 and for n = 1 that looks near and far in turn. The truth
of a sector is what the same rays say with every pixel known and no blind cone. Flights are drawn from a seed on which
nothing was chosen. Intervals are of 95 %, by bootstrap over flights. A run that was stopped goes on in its --work.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.evaluation.provenance import network_facts, source_commit
from flightdepth.files import file_in_progress, without_nan, write_json
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import UNKNOWN, distances_cm
from flightdepth.live.obstacle_rays import rays_of, sectors_of
from flightdepth.live.obstacles import ObstacleSettings, Pose, Sectors, Sight
from flightdepth.machine import usable_cores
from flightdepth.motion import NED_FROM_CAMERA, Vector, quaternion_from_rotation
from flightdepth.ranges import MultiRangeEstimator, RangedDepth
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.judge import judge_sha256
from flightdepth.runtimes.network import load_network, nearest_network
from flightdepth.scenes.outdoor import draw_outdoor, outdoor_flight
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox.photometric import through_jpeg
from flightdepth.weights.store import find_network, read_card

# Low, so that much of what is seen stands in the corridor, at 3 to 40 m.
CONFIG = OutdoorConfig(frames=90, turn_over_s=1.0, height_m=(5.5, 8.0), houses=(9, 13))
CAMERA = Camera.from_fov(384, 216, 75.0)
SEED = 152
QUICK, ALL = 6, 24  # flights
JPEG_QUALITY = 80
SPEED_NOISE_M_S = 0.05
HEADING_RAD = 0.0  # the camera looks north all the time, and so does the nose
AGE_FRAMES, FROM_FRAME, EVERY = 3, 24, 3
SETTINGS = ObstacleSettings()
WRONG = 1.5  # a factor: farther than the truth by it is a miss, nearer by it a false alarm
BINS_M = ((0.0, 5.0), (5.0, 10.0), (10.0, 20.0), (20.0, 40.0))
BOOTSTRAPS = 1000


@dataclass(frozen=True)
class Way:
    """How the estimator is run."""

    ranges: int
    turns: int = 1

    @property
    def label(self) -> str:
        """For the table."""
        return f"n = {self.ranges}" + (f", {self.turns} in turn" if self.turns > 1 else "")


WAYS = (Way(1), Way(1, 2), Way(2), Way(3))


@dataclass(frozen=True, eq=False)
class Compared:
    """What was told and what was true of k sectors of one flight.

    told_m  [k]  inf: free; NaN: unknown
    true_m  [k]  inf: nothing within `max_m`
    ahead   [k]  flown mainly along the optical axis
    """

    told_m: Vector
    true_m: Vector
    ahead: NDArray[np.bool_]


def part(number: int, work: Path) -> list[Compared]:
    """Flight `number` for each of WAYS; from `work` where it stands there, flown by the same weights."""
    weights = read_card(find_network(nearest_network(CAMERA))).sha256
    path = work / f"flight-{number:03d}-{weights[:12]}-{judge_sha256()[:12]}.npz"
    if not path.exists():
        flown = compared(number)
        named = {f"{name}_{i}": value for i, one in enumerate(flown) for name, value in asdict(one).items()}
        with file_in_progress(path) as file:
            np.savez(file, **named)
    with np.load(path) as stored:
        return [
            Compared(*(stored[f"{name}_{i}"] for name in ("told_m", "true_m", "ahead")))
            for i in range(len(WAYS))
        ]


def compared(number: int) -> list[Compared]:
    """Flight `number` for each of WAYS."""
    flight = outdoor_flight(CONFIG, SEED, number)
    rendered = render(draw_outdoor(CONFIG, SEED, number), outdoor_textures(0), CAMERA)
    images = [through_jpeg(image, JPEG_QUALITY) for image in rendered.images]
    velocity_ned = flight.velocity(np.arange(CONFIG.frames) / CONFIG.rate_hz) @ NED_FROM_CAMERA.T
    attitude = quaternion_from_rotation(NED_FROM_CAMERA @ flight.world_from_camera)
    truths = {
        frame: true_sectors(rendered.depth_m[frame], Pose.of(attitude, HEADING_RAD, velocity_ned[frame]))
        for frame in range(FROM_FRAME, CONFIG.frames, EVERY)
    }
    noise = SPEED_NOISE_M_S * np.random.default_rng(number).standard_normal(velocity_ned.shape)
    found = []
    for way in WAYS:
        told = {
            frame + AGE_FRAMES: distances_cm(sectors, SETTINGS)
            for frame, sectors in fly(way, images, velocity_ned + noise, attitude)
        }
        found.append(against(told, truths, abs(velocity_ned[:, 0]) > abs(velocity_ned[:, 1])))
    return found


def fly(
    way: Way, images: list[NDArray[np.uint8]], velocity_ned: Vector, attitude: Vector
) -> Iterator[tuple[int, Sectors]]:
    """The sectors AGE_FRAMES after each frame, by what was known with it."""
    network = load_network(nearest_network(CAMERA))
    estimator = MultiRangeEstimator(network, CAMERA, ranges=way.ranges, turns=way.turns)
    obstacles = ObstacleMap(lambda camera: Sight.of(network.card, network.focal_px(camera)), SETTINGS)
    for frame, image in enumerate(images):
        stamp_ns = round(frame / CONFIG.rate_hz * 1e9)
        estimator.add_velocity(stamp_ns, velocity_ned[frame])
        estimator.add_attitude(stamp_ns, attitude)
        obstacles.add(
            stamp_ns,
            estimator.add_frame(stamp_ns, image),
            CAMERA,
            world_from_camera=attitude,
            heading_rad=HEADING_RAD,
            velocity_ned=velocity_ned[frame],
        )
        yield frame, obstacles.at(stamp_ns + round(AGE_FRAMES / CONFIG.rate_hz * 1e9))


def true_sectors(depth_m: NDArray[np.float32], pose: Pose) -> Sectors:
    """Of a true depth map, infinite in the sky; each ray sees all."""
    unknown = RangedDepth.unknown(CAMERA.height, CAMERA.width, "to be replaced", 0.0)
    told = replace(
        unknown,
        depth_m=np.where(np.isfinite(depth_m), depth_m, np.float32(1e4)).astype(np.float32),
        confidence=np.ones_like(unknown.confidence),
        range_depths_m=np.zeros((1, 1, 1), np.float32),
        shifts=np.ones(1, np.int64),
        displacements_m=np.array([1e9]),
        centroids_m=np.full(1, np.nan),
        reason=None,
        # Upwards and very far: every ray that matters sees it.
        moved_m=np.array([[0.0, 1e9, 0.0]]),
    )
    return sectors_of(rays_of(told, CAMERA, pose, Sight(1e6), SETTINGS), SETTINGS)


def against(
    told_cm: dict[int, NDArray[np.uint16]], truths: dict[int, Sectors], is_ahead: NDArray[np.bool_]
) -> Compared:
    """Of the sectors within the view at the frames that have a truth."""
    told, true, ahead = [], [], []
    for frame, truth in truths.items():
        within = (truth.clear_m > 0) | np.isfinite(truth.obstacle_m)
        values = told_cm[frame][within].astype(np.float64)
        metres = np.where(values > SETTINGS.max_m * 100, np.inf, values / 100)
        told.append(np.where(values == UNKNOWN, np.nan, metres))
        near = truth.obstacle_m <= SETTINGS.max_m
        true.append(np.where(near, truth.obstacle_m, np.inf)[within])
        ahead.append(np.full(within.sum(), is_ahead[frame]))
    return Compared(np.concatenate(told), np.concatenate(true), np.concatenate(ahead))


def figures(flights: list[Compared], chosen: Callable[[Compared], NDArray[np.bool_]]) -> dict[str, float]:
    """Shares and relative errors of the `chosen` sectors of some flights together; NaN where there are none."""
    picked = [chosen(flight) for flight in flights]
    told = np.concatenate([flight.told_m[which] for flight, which in zip(flights, picked, strict=True)])
    true = np.concatenate([flight.true_m[which] for flight, which in zip(flights, picked, strict=True)])
    known, near = ~np.isnan(told), np.isfinite(true)
    measured = near & np.isfinite(told)
    relative = np.abs(told[measured] / true[measured] - 1)
    return {
        "sectors": float(len(told)),
        "known": share(known, np.ones_like(known)),
        "median error": float(np.median(relative)) if len(relative) else np.nan,
        "p95 error": float(np.percentile(relative, 95)) if len(relative) else np.nan,
        "misses": share(told > WRONG * true, known & near),
        "called free": share(np.isposinf(told), known & near),
        "false alarms": share(told < np.minimum(true, SETTINGS.max_m) / WRONG, known),
    }


def share(which: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    """Of those `among` that are True, how many of `which` are."""
    return float((which & among).sum() / among.sum()) if among.any() else float("nan")


def intervals(
    flights: list[Compared], chosen: Callable[[Compared], NDArray[np.bool_]]
) -> dict[str, list[float]]:
    """Each figure with the ends of its interval."""
    rng, point = np.random.default_rng(0), figures(flights, chosen)
    drawn = [
        figures([flights[i] for i in rng.integers(len(flights), size=len(flights))], chosen)
        for _ in range(BOOTSTRAPS)
    ]
    return {
        name: [value, *np.nanpercentile([one[name] for one in drawn], [2.5, 97.5]).tolist()]
        if np.isfinite(value)
        else [np.nan] * 3
        for name, value in point.items()
    }


CHOSEN: dict[str, Callable[[Compared], NDArray[np.bool_]]] = {
    "all": lambda flight: np.ones_like(flight.ahead),
    "flying ahead": lambda flight: flight.ahead,
    "flying sideways": lambda flight: ~flight.ahead,
    **{
        f"{low:.0f}-{high:.0f} m": partial(
            lambda flight, low, high: (flight.true_m >= low) & (flight.true_m < high), low=low, high=high
        )
        for low, high in BINS_M
    },
    "nothing near": lambda flight: np.isinf(flight.true_m),
}


def main() -> None:
    """Print a table, a row for each way and kind of sector."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} flights, not {ALL}")
    parser.add_argument("--work", type=Path, help="keeps each flight, and the figures in figures.json")
    options = parser.parse_args()
    work = options.work or Path(tempfile.mkdtemp())
    work.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(usable_cores(), mp_context=multiprocessing.get_context("spawn")) as pool:
        flights = list(pool.map(partial(part, work=work), range(QUICK if options.quick else ALL)))
    found = {
        f"{way.label}; {name}": intervals([flight[i] for flight in flights], chosen)
        for i, way in enumerate(WAYS)
        for name, chosen in CHOSEN.items()
    }
    for label, row in found.items():
        cells = [
            f"{name} {value:.3f} ({low:.3f} to {high:.3f})"
            for name, (value, low, high) in row.items()
            if name != "sectors"
        ]
        print(f"{label} [{row['sectors'][0]:.0f}]: " + "; ".join(cells))
    about = {"commit": source_commit(), "network": network_facts(load_network(nearest_network(CAMERA)))}
    about |= {"seed": SEED, "flights": len(flights), "rows": found}
    write_json(work / "figures.json", without_nan(about))


if __name__ == "__main__":
    main()
