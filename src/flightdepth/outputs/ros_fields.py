"""Depth and its camera as the fields of ROS messages, for recordings and for the ROS 2 node."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera


def image_fields(pixels: NDArray[Any], encoding: str) -> dict[str, Any]:
    """A sensor_msgs/Image of one channel, [H, W]: depth is 32FC1, metres, NaN = unknown (REP 118)."""
    height, width = pixels.shape
    little = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    return {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": width * pixels.itemsize,
        "data": little.view(np.uint8).ravel(),
    }


def camera_fields(camera: Camera) -> dict[str, Any]:
    """A sensor_msgs/CameraInfo of maps that lie in the distorted picture: K as it is, P without distortion."""
    model = "equidistant" if camera.model == "fisheye" else "plumb_bob"
    if len(camera.distortion) > 5:
        model = "rational_polynomial"
    fewest = 4 if camera.model == "fisheye" else 5  # coefficients that ROS's model has
    return {
        "height": camera.height,
        "width": camera.width,
        "distortion_model": model,  # sensor_msgs/distortion_models.hpp
        "d": np.array(camera.distortion + (0.0,) * (fewest - len(camera.distortion))),
        "k": camera.matrix.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.hstack([camera.matrix, np.zeros((3, 1))]).ravel(),
        "binning_x": 0,
        "binning_y": 0,
    }
