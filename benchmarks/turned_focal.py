"""How exact the focal length is that a camera's turns tell, on points worked out here: nothing is rendered.

    python benchmarks/turned_focal.py

Prints a line for each case: of how many flights turns tell a focal length, how many of these would be taken unasked,
the median and the worst error, the worst error in standard deviations told, and how often the right camera would be
denied.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from flightdepth.camera import Camera
from flightdepth.flight import AttitudeSample, GyroscopeTrack, Telemetry, VelocitySample
from flightdepth.flight.lenses import CERTAIN_ERROR
from flightdepth.flight.turn_verdict import turns_deny
from flightdepth.flight.turned_focal import TurnedFocal, TurnWatch, ideal_lenses
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.runtimes.lens import distort, undistort

GRID_HZ, EDGE_S = 200, 1.0
PAIR_S, PAIRS_HZ, POINTS = 0.1, 15, 60
NEAREST_M, FARTHEST_M = 8.0, 200.0
PINHOLE = Camera.from_fov(160, 90, 70.0)
FISHEYE = Camera.from_fov(160, 90, 110.0, model="fisheye")


@dataclass(frozen=True)
class Case:
    """A flight that turns now and then.

    speed_m_s     straight ahead where the camera looks at first, and half as much to its right
    shake_deg     of the drone, about each axis, at some 1 to 5 Hz
    smoothed_s    pictures turn as the smoothed camera does: standard deviation of a Gaussian
    follows_s     pictures turn as a gimbal that follows the drone, which is what the log tells of: time constant
    readout_s     of the picture's rows, one after the other
    zoom          focal length at the end, over that at the start
    lag_s         the log's times are too late
    attitude_hz   the log tells attitudes, so many a second; 0: a gyroscope
    """

    camera: Camera = PINHOLE
    lasts_s: float = 40.0
    turn_deg: float = 25.0
    speed_m_s: float = 0.0
    shake_deg: float = 0.0
    smoothed_s: float = 0.0
    follows_s: float = 0.0
    readout_s: float = 0.0
    zoom: float = 1.0
    lag_s: float = 0.0
    attitude_hz: float = 0.0
    noise_px: float = 0.05


CASES = {
    "hovers": Case(),
    "hovers, fisheye": Case(FISHEYE),
    "5 m/s": Case(speed_m_s=5.0),
    "5 m/s, fisheye": Case(FISHEYE, speed_m_s=5.0),
    "10 m/s": Case(speed_m_s=10.0),
    "5 m/s, attitudes at 10 Hz": Case(speed_m_s=5.0, attitude_hz=10.0),
    "5 m/s, turns by 5 degrees": Case(speed_m_s=5.0, turn_deg=5.0),
    "5 m/s, one turn": Case(speed_m_s=5.0, lasts_s=6.0),
    "rows read out in 30 ms": Case(speed_m_s=5.0, readout_s=0.03),
    "screwed on, shakes by 0.5 degrees": Case(speed_m_s=5.0, shake_deg=0.5),
    "log 0.1 s late": Case(speed_m_s=5.0, lag_s=0.1),
    "log 0.3 s late": Case(speed_m_s=5.0, lag_s=0.3),
    "log 1 s late": Case(speed_m_s=5.0, lag_s=1.0),
    "hovers, view of 20 degrees": Case(Camera.from_fov(160, 90, 20.0), turn_deg=10.0),
    "5 m/s, view of 20 degrees": Case(Camera.from_fov(160, 90, 20.0), speed_m_s=5.0, turn_deg=10.0),
    "zooms to 1.5 times": Case(speed_m_s=5.0, zoom=1.5),
    "zooms to twice": Case(zoom=2.0),
    "stabilised over 0.15 s": Case(speed_m_s=5.0, shake_deg=0.5, smoothed_s=0.15),
    "stabilised over 0.3 s": Case(speed_m_s=5.0, shake_deg=0.5, smoothed_s=0.3),
    "stabilised over 0.3 s, no shake": Case(speed_m_s=5.0, smoothed_s=0.3),
    "stabilised over 0.6 s": Case(speed_m_s=5.0, shake_deg=0.5, smoothed_s=0.6),
    "stabilised over 1 s, no shake": Case(smoothed_s=1.0),
    "gimbal behind the drone by 0.2 s": Case(speed_m_s=5.0, follows_s=0.2),
    "gimbal behind the drone by 0.5 s": Case(speed_m_s=5.0, follows_s=0.5),
    "gimbal behind the drone by 1 s": Case(follows_s=1.0),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=8)
    parser.add_argument("--case", default="", help="part of the names of those wanted")
    args = parser.parse_args()
    flights = args.flights
    print(f"{'':36} {'told':>6} {'taken':>6} {'median':>7} {'worst':>7} {'sigmas':>7} {'denied':>7}")
    for name, case in ((name, case) for name, case in CASES.items() if args.case in name):
        answers = [answer(case, seed) for seed in range(flights)]
        told = [each for each in answers if each.camera is not None]
        errors = np.array([abs(each.camera.fx / case.camera.fx - 1) for each in told if each.camera])
        taken = sum(each.share <= CERTAIN_ERROR for each in told)
        denied = sum(turns_deny(each, case.camera) is not None for each in told)
        figures = f"{'':>7} {'':>7} {'':>7}"
        if told:
            sigmas = max(error / each.share for error, each in zip(errors, told, strict=True))
            figures = f"{np.median(errors):7.1%} {errors.max():7.1%} {sigmas:7.1f}"
        print(f"{name:36} {len(told):6} {taken:6} {figures} {denied:7}")


def answer(case: Case, seed: int) -> TurnedFocal:
    """What turns tell of one flight."""
    watch = watched(case, seed)
    return watch.focal(ideal_lenses(watch.camera))


def watched(case: Case, seed: int = 0, *, tried: Camera | None = None) -> TurnWatch:
    """Points 8 to 200 m away, followed through the flight of one seed; `tried` is the camera they are taken for."""
    rng = np.random.default_rng(seed)
    turned = angles(case, rng)
    watch = TurnWatch(told(case, turned, rng), tried or case.camera)
    seen = pictured(case, turned)
    for at_s in np.arange(PAIR_S, case.lasts_s, 1 / PAIRS_HZ):
        before, after = followed(case, seen, at_s, rng)
        watch.add(before, after, round((at_s - PAIR_S) * 1e9), round(at_s * 1e9))
    return watch


def angles(case: Case, rng: np.random.Generator) -> np.ndarray:
    """Roll, pitch and yaw, rad [n, 3], at GRID_HZ from EDGE_S before the first picture to EDGE_S after the last."""
    at_s = np.arange(-EDGE_S, case.lasts_s + EDGE_S, 1 / GRID_HZ)
    yaw, start_s = np.zeros_like(at_s), 1.0
    while start_s < case.lasts_s - 2:
        lasts_s, turn = (
            rng.uniform(1, 3),
            np.radians(rng.choice([-1, 1]) * case.turn_deg * rng.uniform(0.5, 1.5)),
        )
        part = ((at_s - start_s) / lasts_s).clip(0, 1)
        yaw += turn * part**2 * (3 - 2 * part)
        start_s += lasts_s + rng.uniform(1, 3)
    pitch = np.radians(-15 + 2 * np.sin(at_s + rng.uniform(0, 6)))
    shake = np.zeros((len(at_s), 3))
    for hertz in rng.uniform(1, 5, 6):
        phase, size = rng.uniform(0, 2 * np.pi, 3), np.radians(case.shake_deg) / np.sqrt(3)
        shake += size * np.sin(2 * np.pi * hertz * at_s[:, None] + phase)
    return np.stack([np.zeros_like(at_s), pitch, yaw], axis=1) + shake


def pictured(case: Case, turned: np.ndarray) -> np.ndarray:
    """The angles [n, 3] that the pictures show of those of the drone."""
    seen = turned
    if case.smoothed_s:
        steps = np.arange(-3 * case.smoothed_s, 3 * case.smoothed_s, 1 / GRID_HZ)
        weights = np.exp(-((steps / case.smoothed_s) ** 2) / 2)
        edge = np.pad(turned, ((len(steps) // 2, (len(steps) - 1) // 2), (0, 0)), mode="edge")
        columns = [np.convolve(column, weights / weights.sum(), mode="valid") for column in edge.T]
        seen = np.stack(columns, axis=1)
    if case.follows_s:
        seen = seen.copy()
        for k in range(1, len(seen)):
            seen[k] = seen[k - 1] + (turned[k] - seen[k - 1]) / (case.follows_s * GRID_HZ)
    return seen


def told(case: Case, turned: np.ndarray, rng: np.random.Generator) -> Telemetry:
    """The log: how the drone turned."""
    matrices = rotations(turned)
    stamps = ((np.arange(len(turned)) / GRID_HZ - EDGE_S + case.lag_s) * 1e9).astype(np.int64)
    velocity = VelocitySample(int(stamps[0]), np.zeros(3))
    if case.attitude_hz:
        every = round(GRID_HZ / case.attitude_hz)
        pairs = zip(stamps[::every], matrices[::every], strict=True)
        samples = [AttitudeSample(int(stamp), quaternion_from_rotation(turn)) for stamp, turn in pairs]
        return Telemetry("attitudes", (velocity, *samples))
    steps = np.einsum("kji,kjl->kil", matrices[:-1], matrices[1:])
    odd = (steps - steps.transpose(0, 2, 1)) / 2
    rates = np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=1) * GRID_HZ
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    track = GyroscopeTrack((stamps[1:] + stamps[:-1]) // 2, rates @ axes + rng.normal(0, 0.003, rates.shape))
    return Telemetry("a gyroscope", (velocity,), gyroscope=track)


def rotations(turned: np.ndarray) -> np.ndarray:
    """World (NED) from camera [n, 3, 3] of roll, pitch and yaw [n, 3]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(turned).T, np.sin(turned).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), -1, 0) @ NED_FROM_CAMERA


def followed(
    case: Case, seen: np.ndarray, at_s: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [n, 2] of points in the picture of PAIR_S before and in that of `at_s`."""
    camera = case.camera
    earlier, later = (zoomed(case, s) for s in (at_s - PAIR_S, at_s))
    before = rng.uniform((0, 0), (camera.width - 1, camera.height - 1), (POINTS, 2))
    rays = np.hstack([undistort(before, earlier), np.ones((POINTS, 1))])
    depths = np.exp(rng.uniform(np.log(NEAREST_M), np.log(FARTHEST_M), (POINTS, 1)))
    flown = case.speed_m_s * PAIR_S * np.array([1.0, 0.5, 0.0])
    points = np.einsum("kij,kj->ki", attitudes(case, seen, at_s - PAIR_S, before), rays * depths) - flown
    after = before
    for _ in range(3):  # the row of a point tells when it was seen, which tells its row
        there = np.einsum("kji,kj->ki", attitudes(case, seen, at_s, after), points)
        after = distort(there[:, :2] / np.maximum(there[:, 2:], 0.1), later)
    kept = (there[:, 2] > 1) & (np.abs(after - before) < 40).all(axis=1)
    return before[kept], after[kept] + rng.normal(0, case.noise_px, (int(kept.sum()), 2))


def zoomed(case: Case, at_s: float) -> Camera:
    """The camera of a picture."""
    focal = case.zoom ** (at_s / case.lasts_s)
    return replace(case.camera, fx=focal * case.camera.fx, fy=focal * case.camera.fy)


def attitudes(case: Case, seen: np.ndarray, at_s: float, pixels: np.ndarray) -> np.ndarray:
    """World from camera [n, 3, 3] when each of the points [n, 2] of the picture at a time was seen."""
    times = at_s + (pixels[:, 1] / case.camera.height - 0.5) * case.readout_s
    grid = np.arange(len(seen)) / GRID_HZ - EDGE_S
    return rotations(np.stack([np.interp(times, grid, column) for column in seen.T], axis=1))


if __name__ == "__main__":
    main()
