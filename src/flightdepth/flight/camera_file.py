"""Camera calibrations as they are commonly stored.

Supported: OpenCV's calibration files (YAML, XML or JSON, as cv2.FileStorage writes them), ROS camera_info
YAML (the calibrator's file or a message as `topic echo` prints it), Kalibr's camchain YAML (its first camera),
sensor.yaml of a camera of EuRoC or TUM VI, calib.txt of KITTI's odometry, and JSON with this package's own
names: width, height, fx, fy, cx, cy, distortion, model.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flightdepth.camera import Camera, Model
from flightdepth.errors import BadInput
from flightdepth.motion import Vector

EXPECTED = (
    "an OpenCV calibration, a Kalibr camchain, a ROS camera_info YAML, EuRoC's sensor.yaml, KITTI's calib.txt "
    "or JSON with width, height, fx, fy, cx, cy"
)
MATRIX_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k")
DISTORTION_NAMES = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "distortion_coeffs",
    "D",
    "d",
)
SIZE_NAMES = (("image_width", "image_height"), ("width", "height"))
MODELS: dict[str, Model] = {
    "": "pinhole",
    "none": "pinhole",
    "pinhole": "pinhole",
    "radtan": "pinhole",
    "radial-tangential": "pinhole",
    "plumb_bob": "pinhole",
    "rational_polynomial": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
INTRINSICS, SIZE = ("intrinsics",), ("resolution",)  # Kalibr's and EuRoC's
KITTI_CAMERAS = ("P0", "P1", "P2", "P3")
KITTI_MEND = (
    "KITTI's file does not tell the size: it fits a video or folder of its pictures in full size; "
    "for others write JSON with width, height, fx, fy, cx, cy."
)
KITTI_OFF_CENTRE = 0.1  # of a side; its sequences have up to 0.04, pictures made smaller or cropped more
OWN_FIELDS = {"width", "height", "fx", "fy", "cx", "cy", "distortion", "model"}


def read_camera(path: Path, size: tuple[int, int] | None = None) -> Camera:
    """Read a calibration; a file without a focal length is refused (BadInput), as is one that is broken.

    `size` is (width, height) of the pictures as they are stored, in pixels. It matters to KITTI's calib.txt alone,
    which does not tell its own: without a size, or with one of other pictures, it is refused.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"camera {path}", expected=EXPECTED, got="a binary file") from error
    except OSError as error:
        raise BadInput(f"camera {path}", expected=EXPECTED, got=error.strerror or str(error)) from error
    if text.lstrip().startswith("P0:"):
        return _from_kitti(path, text, size)
    own = _own_fields(path, text)
    return _from_own(path, own) if own is not None else _from_storage(path, text)


def _own_fields(path: Path, text: str) -> dict[str, Any] | None:
    """The JSON object of a file with this package's names, or None for any other file."""
    if not text.lstrip().startswith("{"):
        return None
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"camera {path}", expected=EXPECTED, got=f"broken JSON ({error})") from error
    return value if not set(value) & {*MATRIX_NAMES, "opencv_storage"} else None


def _from_own(path: Path, fields: dict[str, Any]) -> Camera:
    if "fx" not in fields or "fy" not in fields:
        raise _no_focal_length(path)
    unknown, missing = set(fields) - OWN_FIELDS, OWN_FIELDS - {"distortion", "model"} - set(fields)
    if unknown or missing:
        got = f"unknown {sorted(unknown)}" if unknown else f"no {', '.join(sorted(missing))}"
        raise BadInput(f"camera {path}", expected=EXPECTED, got=got)
    try:
        fx, fy, cx, cy = (float(fields[name]) for name in ("fx", "fy", "cx", "cy"))
        distortion = tuple(float(value) for value in fields.get("distortion", ()))
        width, height = _whole(fields["width"]), _whole(fields["height"])
    except (TypeError, ValueError, OverflowError) as error:
        raise BadInput(f"camera {path}", expected="numbers", got=str(error)) from error
    return Camera(width, height, fx, fy, cx, cy, distortion, fields.get("model", "pinhole"))


def _whole(pixels: Any) -> int:
    number = float(pixels)
    if not number.is_integer():
        raise ValueError(f"{pixels} where a side has whole pixels")
    return int(number)


def _from_kitti(path: Path, text: str, size: tuple[int, int] | None) -> Camera:
    """Lines of `P0: ` and the 12 numbers of a 3x4 matrix: rectified cameras, all with the same first 3x3."""
    lines = (line.strip().partition(":") for line in text.splitlines())
    try:
        rows = [
            [float(number) for number in rest.split()] for name, _, rest in lines if name in KITTI_CAMERAS
        ]
        if wrong := [len(row) for row in rows if len(row) != 12]:
            raise ValueError(f"{wrong[0]} numbers")
    except ValueError as error:
        raise BadInput(f"camera {path}", expected="12 numbers a matrix", got=str(error)) from error
    matrices = np.array(rows).reshape(-1, 3, 4)[:, :, :3]
    fx, fy, cx, cy = (float(matrices[0, row, column]) for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if (matrices != np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])).any():
        raise BadInput(f"camera {path}", expected="rectified cameras of one focal length", got="others")
    if size is None:
        raise BadInput(f"camera {path}", expected="the size of its pictures", got="none", mend=KITTI_MEND)
    width, height = size
    camera = Camera(width, height, fx, fy, cx, cy)
    off = max(abs((cx + 0.5) / width - 0.5), abs((cy + 0.5) / height - 0.5))
    if off > KITTI_OFF_CENTRE:
        expected = f"its principal point near the middle of {width}x{height}"
        raise BadInput(f"camera {path}", expected=expected, got=f"{cx:g}, {cy:g}", mend=KITTI_MEND)
    return camera


def _from_storage(path: Path, text: str) -> Camera:
    # ROS writes plain YAML; OpenCV reads it once it carries OpenCV's first line.
    marked = text if text.lstrip().startswith(("%YAML", "<?xml", "{")) else f"%YAML:1.0\n---\n{text}"
    try:
        storage = cv2.FileStorage(marked, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        first = storage.root().getNode("cam0")
        return _from_kalibr(path, first) if first.isMap() else _from_nodes(path, storage.root())
    except (cv2.error, SystemError, TypeError, ValueError, OverflowError) as error:
        reason = "broken file" if isinstance(error, cv2.error | SystemError) else error
        raise BadInput(f"camera {path}", expected=EXPECTED, got=f"something else ({reason})") from error


def _from_nodes(path: Path, root: Any) -> Camera:
    matrix = _numbers(root, MATRIX_NAMES)
    if matrix is None and not root.getNode(INTRINSICS[0]).empty():
        return _from_kalibr(path, root)  # EuRoC's sensor.yaml: the fields of Kalibr's cam0 by themselves
    if matrix is None:
        raise _no_focal_length(path)
    names = SIZE_NAMES[1] if root.getNode(SIZE_NAMES[0][0]).empty() else SIZE_NAMES[0]
    width, height = (_whole(_real(root.getNode(name), name)) for name in names)
    if len(matrix) != 9:
        raise BadInput(f"camera {path}", expected="a 3x3 camera matrix", got=f"{len(matrix)} numbers")
    distortion = _numbers(root, DISTORTION_NAMES)
    coefficients = () if distortion is None else tuple(distortion.tolist())
    fx, fy, cx, cy = (float(matrix[i]) for i in (0, 4, 2, 5))
    return Camera(width, height, fx, fy, cx, cy, distortion=coefficients, model=_model(path, root))


def _from_kalibr(path: Path, root: Any) -> Camera:
    kind, intrinsics, size = root.getNode("camera_model"), _numbers(root, INTRINSICS), _numbers(root, SIZE)
    if not (kind.isString() and kind.string() == "pinhole" and intrinsics is not None and size is not None):
        raise BadInput(f"camera {path}", expected="Kalibr's pinhole model", got="another, or a part of it")
    if len(intrinsics) != 4 or len(size) != 2:
        raise BadInput(f"camera {path}", expected="4 intrinsics and 2 sizes", got=str([*intrinsics, *size]))
    distortion = _numbers(root, DISTORTION_NAMES)
    coefficients = () if distortion is None else tuple(distortion.tolist())
    fx, fy, cx, cy = (float(value) for value in intrinsics)
    return Camera(int(size[0]), int(size[1]), fx, fy, cx, cy, coefficients, _model(path, root))


def _model(path: Path, root: Any) -> Model:
    """The lens model by its name; one that this package does not have is refused, not taken for another."""
    flag = root.getNode("fisheye_model")
    if flag.isInt() and flag.real() != 0:
        return "fisheye"
    node = root.getNode("distortion_model")
    if node.empty():
        node = root.getNode("camera_model")
    name = node.string().strip() if node.isString() else ""
    if name not in MODELS:
        raise BadInput(f"distortion model of camera {path}", expected=", ".join(MODELS)[2:], got=name)
    return MODELS[name]


def _numbers(root: Any, names: tuple[str, ...]) -> Vector | None:
    """Numbers of the first node with one of `names`: OpenCV's matrix, ROS's {rows, cols, data} or a list."""
    for name in names:
        node = root.getNode(name)
        if node.isMap() and not node.getNode("dt").empty():  # only OpenCV's own matrices say their type
            return np.asarray(node.mat(), dtype=np.float64).ravel()
        if node.isMap():
            node = node.getNode("data")
        if node.isSeq():
            return np.array([_real(node.at(i), name) for i in range(node.size())])
    return None


def _real(node: Any, name: str) -> float:
    # real() of something else gives the largest double, silently.
    if not (node.isInt() or node.isReal()):
        raise ValueError(f"{name} is not a number")
    return float(node.real())


def _no_focal_length(path: Path) -> BadInput:
    mend = "Give --hfov DEGREES instead."
    return BadInput(f"camera {path}", expected=EXPECTED, got="no focal length", mend=mend)
