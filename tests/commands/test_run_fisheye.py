"""The sample flight seen through a fisheye: depth agrees with that of the pinhole, pixel by pixel of the same ray."""

import json
from dataclasses import asdict

import av
import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.cli import main
from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO
from flightdepth.flight.camera_file import read_camera
from flightdepth.outputs import FlightFolder
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.lens import distort, undistort

PINHOLE = read_camera(CALIBRATION)
# Twice the pinhole's pixels in the middle, so that the second resampling costs little.
FISHEYE = Camera(960, 540, 720.0, 720.0, 479.5, 269.5, (0.03, 0.07, -0.07, 0.03), "fisheye")


def ray_table(width, height):
    """Pinhole pixel [H, W, 2] where each pixel of the fisheye looks, float32."""
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    rays = undistort(np.stack([columns, rows], -1).astype(np.float64), FISHEYE)
    return distort(rays, PINHOLE).astype(np.float32)


def frames(count):
    with av.open(str(VIDEO)) as container:
        for index, picture in enumerate(container.decode(video=0)):
            if index == count:
                return
            yield picture.to_ndarray(format="rgb24")


def warped(image, table):
    return cv2.remap(image, table[..., 0], table[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def test_the_network_sees_the_same_picture_through_both_lenses():
    (image,) = frames(1)
    table = ray_table(FISHEYE.width, FISHEYE.height)
    grids = NetworkGrid(PINHOLE, 256), NetworkGrid(FISHEYE, 256)
    seen = grids[0].image(image), grids[1].image(warped(image, table))
    # One ray, two pixels: the fisheye's grid compared where the pinhole's grid has the same direction.
    columns, rows = np.meshgrid(np.arange(seen[1].shape[1]), np.arange(seen[1].shape[0]))
    rays = undistort(np.stack([columns, rows], -1).astype(np.float64), grids[1].camera)
    at = distort(rays, grids[0].camera).astype(np.float32)
    other = cv2.remap(seen[0], at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    inside = np.kron(grids[1].valid, np.ones((4, 4), np.uint8))
    inside = cv2.erode(inside, np.ones((9, 9), np.uint8)).astype(bool)
    assert inside.mean() > 0.5
    assert np.abs(other.astype(float) - seen[1])[inside].mean() < 4


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_run_on_the_fisheye_agrees_with_the_pinholes(tmp_path, capsys):
    count = 22
    table = ray_table(FISHEYE.width, FISHEYE.height)
    with av.open(str(tmp_path / "fisheye.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = FISHEYE.width, FISHEYE.height, "yuv420p"
        for image in frames(count):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(warped(image, table), format="rgb24")))
        container.mux(stream.encode(None))
    (tmp_path / "fisheye.json").write_text(json.dumps(asdict(FISHEYE)))
    for name, video, camera in (
        ("pinhole", VIDEO, CALIBRATION),
        ("fisheye", tmp_path / "fisheye.mp4", tmp_path / "fisheye.json"),
    ):
        options = ["--telemetry", LOG, "--camera", camera, "--end", "0.7", "--out", tmp_path / name]
        assert main(["run", str(video), *map(str, [*options, "--network", "motion"])]) == 0
    folders = [FlightFolder(tmp_path / name) for name in ("pinhole", "fisheye")]
    ratios = []
    for index in range(12, 21, 4):
        pinhole_m, fisheye_m = (folder.depth_m(index) for folder in folders)
        nothing = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": float("nan")}
        at_rays_m = cv2.remap(pinhole_m, table[..., 0], table[..., 1], cv2.INTER_NEAREST, **nothing)
        ratios.append(fisheye_m / at_rays_m)
    logs = np.log(np.stack(ratios)[np.isfinite(ratios)])
    with capsys.disabled():
        print(
            f" fisheye / pinhole: median {np.exp(np.median(logs)):.3f}, median off {np.median(np.abs(logs)):.3f}"
        )
    assert len(logs) > 1e5
    assert abs(np.median(logs)) < 0.03
    assert np.median(np.abs(logs)) < 0.08
