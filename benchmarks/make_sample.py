"""Makes the sample flight of `flightdepth demo` again: python benchmarks/make_sample.py [--out DIR]

Byte for byte the same on one machine and build of the dependencies; elsewhere depth may differ by a centimetre
and the video by its encoder. It needs the extra `train` (for numba) and a minute.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from flightdepth.camera import Camera
from flightdepth.commands.demo import SAMPLE, TRUTH_OFFSET_PX, TRUTH_STEP_PX
from flightdepth.files import write_atomic
from flightdepth.flight import AttitudeSample, VelocitySample, write_csv
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.outputs.encoding import centimetres_from_depth, png
from flightdepth.renderers.raycast import render
from flightdepth.scenes.outdoor import draw_outdoor, outdoor_flight
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures

CONFIG = OutdoorConfig()
SEED = 13
TEXTURE_SEED = 0
CAMERA = Camera.from_fov(640, 360, 75.0)
TRUTH_EVERY = 10  # frames
LOG_HZ = 20
SPEED_NOISE_M_S = 0.05  # per axis, as of a flight controller that fuses satellites and inertia
NS_PER_S = 1_000_000_000
ENCODER = {"preset": "slow", "crf": "19", "threads": "1", "x264-params": "threads=1:lookahead_threads=1"}


def truth_camera() -> Camera:
    """The camera whose pixels are each TRUTH_STEP_PX-th pixel of CAMERA, from TRUTH_OFFSET_PX on."""
    step, first = TRUTH_STEP_PX, TRUTH_OFFSET_PX
    return Camera(
        CAMERA.width // step,
        CAMERA.height // step,
        CAMERA.fx / step,
        CAMERA.fy / step,
        (CAMERA.cx - first) / step,
        (CAMERA.cy - first) / step,
    )


def make_video(path: Path) -> None:
    """Render and encode all frames."""
    scene, textures = draw_outdoor(CONFIG, SEED), outdoor_textures(TEXTURE_SEED)
    rate = Fraction(CONFIG.rate_hz).limit_denominator(1001)

    def images() -> Iterator[NDArray[np.uint8]]:
        for frame in track(range(CONFIG.frames), "frames"):
            yield render(scene, textures, CAMERA, frames=[frame]).images[0]

    with av.open(str(path), "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", rate=rate, options=ENCODER)
        stream.width, stream.height, stream.pix_fmt = CAMERA.width, CAMERA.height, "yuv420p"
        for image in images():
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))


def make_truth(folder: Path) -> None:
    """True depth of every tenth frame, in the format of `flightdepth run`; the sky is 65535."""
    folder.mkdir(exist_ok=True)
    scene, textures = draw_outdoor(CONFIG, SEED), outdoor_textures(TEXTURE_SEED)
    for frame in range(TRUTH_EVERY, CONFIG.frames, TRUTH_EVERY):
        depth_m = render(scene, textures, truth_camera(), frames=[frame]).depth_m[0]
        write_atomic(folder / f"{frame:06d}.png", png(centimetres_from_depth(depth_m)))


def make_log(path: Path) -> None:
    """Velocity in the world with noise, and the camera's orientation, which is held by its gimbal."""
    flight, rng = outdoor_flight(CONFIG, SEED), np.random.default_rng(SEED)
    stamps = np.arange(round(CONFIG.duration_s * LOG_HZ) + 1) * (NS_PER_S // LOG_HZ)
    exact = flight.velocity(stamps * 1e-9) @ NED_FROM_CAMERA.T
    noisy = (exact + SPEED_NOISE_M_S * rng.standard_normal(exact.shape)).round(3)
    attitude = quaternion_from_rotation(NED_FROM_CAMERA @ flight.world_from_camera).round(9)
    velocities = [
        VelocitySample(int(stamp), velocity, "world", SPEED_NOISE_M_S)
        for stamp, velocity in zip(stamps, noisy, strict=True)
    ]
    write_csv(path, [*velocities, *(AttitudeSample(int(stamp), attitude) for stamp in stamps)])


def make_poses(path: Path) -> None:
    """True pose of the camera at each frame: position north-east-down, world_from_camera as a quaternion."""
    flight = outdoor_flight(CONFIG, SEED)
    time_s = np.arange(CONFIG.frames) / CONFIG.rate_hz
    positions = flight.position(time_s) @ NED_FROM_CAMERA.T
    attitude = quaternion_from_rotation(NED_FROM_CAMERA @ flight.world_from_camera)
    lines = ["stamp_ns,north_m,east_m,down_m,qw,qx,qy,qz"]
    for stamp_s, position in zip(time_s, positions, strict=True):
        cells = [str(round(stamp_s * NS_PER_S)), *(f"{metres:.4f}" for metres in position)]
        lines.append(",".join([*cells, *(f"{part:.9f}" for part in attitude)]))
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def make_camera(path: Path) -> None:
    """The calibration."""
    write_atomic(path, (json.dumps(asdict(CAMERA), indent=2) + "\n").encode())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=SAMPLE)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    make_camera(out / "camera.json")
    make_log(out / "telemetry.csv")
    make_poses(out / "poses.csv")
    make_truth(out / "truth")
    make_video(out / "flight.mp4")


if __name__ == "__main__":
    main()
