"""How fast the camera may turn: `python benchmarks/turns.py [--rates R ...] [--swing HZ] [--late MS] [--as-run]`.

Rendered flights outdoors, 30 pictures a second at 5 m/s, 640x360 and 80 degrees wide, whose camera turns about the
vertical at an even rate, or swings at up to that. Each picture is filmed by a rolling shutter, blurred by its
exposure, and compressed (H.264, crf 21). A log tells velocities of the world 20 times a second, with 0.05 m/s of noise
on each axis, and the attitude with 0.15 degrees about each, or no attitude. Depth is that of `run`, two ranges, over
what is nearer than 150 m, but that no picture is refused for its turn unless `--as-run` asks for it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.commands.terminal import counted
from flightdepth.evaluation.metrics import depth_errors, depth_sums
from flightdepth.flight import AttitudeSample, Steadiness, VelocitySample
from flightdepth.flight.records import NS_PER_S, Sample, give
from flightdepth.motion import NED_FROM_CAMERA, Vector, quaternion_from_rotation
from flightdepth.ranges.estimator import MultiRangeEstimator
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.network import Network, load_network
from flightdepth.scenes.outdoor import draw_outdoor, outdoor_flight
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox.h264 import through_h264
from flightdepth.stillbox.pairs import Image

CAMERA = Camera.from_fov(640, 360, 80.0)
CONFIG = OutdoorConfig(frames=36, legs="any", turn_over_s=0.4, speed_m_s=(4.5, 5.5), height_m=(6.0, 15.0))
SEED = 4100
RATES_DEG_S = (0.0, 15.0, 25.0, 50.0, 90.0)
FIRST_MEASURED = 20  # frame; the first ones have no long pairs yet
FARTHEST_M = 150.0
LOG_HZ = 20
SPEED_NOISE_M_S, ATTITUDE_NOISE_RAD = 0.05, np.radians(0.15)
EXPOSURE_S, BLURRED_OF = 0.004, 5  # pictures that make a blurred one
BANDS = 24  # of rows read at one time
RATE_FACTOR = 21.0


@dataclass(frozen=True)
class Turning:
    """A flight whose camera turns: pictures, true depth [H, W] and attitudes [F, 3, 3], and what the log tells."""

    pictures: list[Image]
    depth_m: list[Maps]
    ned_from_camera: Vector
    samples: list[Sample]

    @classmethod
    def filmed(
        cls,
        number: int,
        rate_deg_s: float,
        *,
        config: OutdoorConfig = CONFIG,
        swing_hz: float = 0.0,
        readout_s: float,
        late_s: float = 0.0,
    ) -> Turning:
        flight, scene = outdoor_flight(config, SEED, number), draw_outdoor(config, SEED, number)

        def yaw_rad(time_s: float) -> float:
            """It looks ahead in the middle of the flight."""
            turning_s = time_s - config.duration_s / 2
            if swing_hz:
                turning_s = np.sin(2 * np.pi * swing_hz * turning_s) / (2 * np.pi * swing_hz)
            return float(np.radians(rate_deg_s) * turning_s)

        def world_from_camera(time_s: float) -> Vector:
            turn = cv2.Rodrigues(np.array([0.0, yaw_rad(time_s), 0.0]))[0]
            return np.asarray(turn @ flight.world_from_camera)

        def rate_rad_s(time_s: float) -> float:
            return (yaw_rad(time_s + 1e-3) - yaw_rad(time_s - 1e-3)) / 2e-3

        times_s = np.arange(config.frames) / config.rate_hz
        turned = replace(scene, world_from_camera=np.array([world_from_camera(each) for each in times_s]))
        textures = outdoor_textures(number)
        seen = [render(turned, textures, CAMERA, frames=[frame]) for frame in range(config.frames)]
        pictures = [
            _filmed(each.images[0], rate_rad_s(time_s), flight.world_from_camera, readout_s)
            for each, time_s in zip(seen, times_s, strict=True)
        ]
        rng = np.random.default_rng(number)
        samples: list[Sample] = []
        for time_s in np.arange(round(config.duration_s * LOG_HZ) + 1) / LOG_HZ:
            stamp_ns = round(time_s * NS_PER_S)
            ned = NED_FROM_CAMERA @ flight.velocity(np.array([time_s]))[0]
            noisy = (
                world_from_camera(time_s - late_s) @ cv2.Rodrigues(rng.normal(0, ATTITUDE_NOISE_RAD, 3))[0]
            )
            velocity = ned + SPEED_NOISE_M_S * rng.standard_normal(3)
            samples.append(VelocitySample(stamp_ns, velocity, "world", SPEED_NOISE_M_S))
            samples.append(AttitudeSample(stamp_ns, quaternion_from_rotation(NED_FROM_CAMERA @ noisy)))
        depth_m = [each.depth_m[0] for each in seen]
        ned_from_camera = NED_FROM_CAMERA @ turned.world_from_camera
        return cls(through_h264(pictures, RATE_FACTOR), depth_m, ned_from_camera, samples)


def _filmed(image: Image, rate_rad_s: float, world_from_camera: Vector, readout_s: float) -> Image:
    """The picture of a camera that turns while its rows are read, the middle one at the picture's time."""
    if rate_rad_s == 0:
        return image
    axis = rate_rad_s * (world_from_camera.T @ np.array([0.0, 1.0, 0.0]))  # in the camera's axes
    edges = np.linspace(0, CAMERA.height, BANDS + 1).astype(int)
    taken = np.zeros(image.shape, np.float32)
    for exposed_s in np.linspace(-0.5, 0.5, BLURRED_OF) * EXPOSURE_S:
        for top, end in pairwise(edges):
            late_s = exposed_s + ((top + end) / 2 / CAMERA.height - 0.5) * readout_s
            turn = CAMERA.matrix @ cv2.Rodrigues(-axis * late_s)[0] @ np.linalg.inv(CAMERA.matrix)
            down = np.array([[1.0, 0, 0], [0, 1, -top], [0, 0, 1]])
            size = (CAMERA.width, int(end - top))
            taken[top:end] += cv2.warpPerspective(image, down @ turn, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(np.rint(taken / BLURRED_OF), np.uint8)


@dataclass
class Row:
    """Sums over the measured frames: of `depth_sums`, of pixels inside one sigma, of frames and those refused."""

    sums: Vector
    inside: int = 0
    frames: int = 0
    refused: int = 0


def fly(network: Network, flight: Turning, row: Row, *, told: bool, as_run: bool) -> None:
    """One flight through the estimator, as `run` does it; `told`: the log tells the attitude."""
    estimator = MultiRangeEstimator(network, CAMERA, ranges=2)
    steadiness = Steadiness(CAMERA)
    for sample in flight.samples:
        if told or isinstance(sample, VelocitySample):
            give(sample, estimator)
    for frame, (picture, truth_m) in enumerate(zip(flight.pictures, flight.depth_m, strict=True)):
        stamp_ns = round(frame * NS_PER_S / CONFIG.rate_hz)
        limit_rad = estimator.max_turn_rad(stamp_ns) if as_run else np.pi
        unusable = steadiness.add(stamp_ns, picture, limit_rad).unusable
        found = estimator.add_frame(stamp_ns, picture, unusable=unusable)
        if frame < FIRST_MEASURED:
            continue
        counted_hw = truth_m < FARTHEST_M
        row.sums += depth_sums(found.depth_m, truth_m, counted_hw)
        row.frames += 1
        row.refused += found.reason is not None
        if found.sigma_m is not None:
            row.inside += int((np.abs(found.depth_m - truth_m) < found.sigma_m)[counted_hw].sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--network", default="motion")
    parser.add_argument("--rates", type=float, nargs="+", default=RATES_DEG_S, help="degrees a second")
    parser.add_argument("--swing", type=float, default=0.0, help="to and fro, so many times a second")
    parser.add_argument("--late", type=float, default=0.0, help="ms by which the attitudes' times are late")
    parser.add_argument("--readout", type=float, default=20.0, help="ms from the first row to the last")
    parser.add_argument("--as-run", action="store_true", help="refuse pictures that turn too fast")
    options = parser.parse_args()
    network = load_network(options.network)
    table = Table("degrees/s", "attitude", "no depth", "known", "error", "inside sigma")
    for rate_deg_s in options.rates:
        rows = {told: Row(np.zeros(7)) for told in (True, False)}
        for number in counted(range(options.scenes), f"{rate_deg_s:g} degrees/s", "flights"):
            late = {"readout_s": options.readout / 1000, "late_s": options.late / 1000}
            flight = Turning.filmed(number, rate_deg_s, swing_hz=options.swing, **late)
            for told, row in rows.items():
                fly(network, flight, row, told=told, as_run=options.as_run)
        for told, row in rows.items():
            errors = depth_errors(row.sums)
            inside = row.inside / max(errors.known * errors.pixels, 1)
            table.add_row(
                f"{rate_deg_s:g}",
                "told" if told else "unknown",
                f"{row.refused / row.frames:.0%}",
                f"{errors.known:.0%}",
                f"{errors.abs_rel:.1%}",
                f"{inside:.0%}",
            )
    Console().print(table)


if __name__ == "__main__":
    main()
