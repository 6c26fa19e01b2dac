"""The snippet of docs/files.md that turns a frame's depth into points."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from flown_folder import WALL_M, write_flown
from output_samples import HEIGHT, WIDTH

from flightdepth.camera import Camera
from flightdepth.runtimes.lens import pixel_rays

TEXT = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")
(SNIPPET,) = (code for code in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL) if "points_ned" in code)


@pytest.mark.parametrize(
    "camera",
    [
        Camera.from_fov(WIDTH, HEIGHT, 90),
        Camera(WIDTH, HEIGHT, 50, 55, 47, 30, (-0.2, 0.05, 0.001, -0.002)),
        Camera(WIDTH, HEIGHT, 50, 50, 47, 30, (0.02, -0.01, 0, 0), "fisheye"),
        Camera.from_fov(WIDTH, HEIGHT, 110, model="fisheye"),
    ],
)
def test_the_points_lie_on_the_wall_where_the_lens_saw_it(tmp_path, camera):
    index = 12
    names = {"cv2": cv2, "np": np, "flight": write_flown(tmp_path / "out", frames=index + 1, camera=camera)}
    exec(SNIPPET, names)
    far_m = names["depth_m"][0, 0]
    east_down = far_m * pixel_rays(camera, 1).reshape(-1, 3)[:, :2]
    assert names["points_ned"][:, 0] == pytest.approx(WALL_M, abs=0.006)
    assert names["points_ned"][:, 1:] == pytest.approx(east_down, abs=0.02)
