import json
import random
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.camera_file import read_camera

CAMERA = Camera(640, 480, 500.5, 501.0, 320.0, 240.0, (0.1, -0.2, 0.0, 0.0, 0.01))
ROS = """image_width: 640
image_height: 480
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0.0, 320, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0, 0, 0.01]
"""


def read(tmp_path, text):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    return read_camera(path)


@pytest.mark.parametrize("ending", ["yaml", "xml", "json"])
def test_opencvs_own_files_are_read(tmp_path, ending):
    path = tmp_path / f"camera.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", CAMERA.matrix)
    storage.write("distortion_coefficients", np.array([CAMERA.distortion]).T)
    storage.release()
    assert read_camera(path) == CAMERA


@pytest.mark.parametrize("text", [ROS, json.dumps(asdict(CAMERA))], ids=["yaml", "json"])
def test_a_byte_order_mark_before_it_is_no_matter(tmp_path, text):
    """Editors of Windows put one there."""
    assert read(tmp_path, "\ufeff" + text) == CAMERA


@pytest.mark.parametrize(("field", "value"), [("height", 480.5), ("model", []), ("width", "wide")])
def test_a_field_of_another_kind_is_refused(tmp_path, field, value):
    with pytest.raises(BadInput, match=r"pixels|model|numbers"):
        read(tmp_path, json.dumps(asdict(CAMERA) | {field: value}))


def test_ros_camera_info_is_read(tmp_path):
    assert read(tmp_path, ROS) == CAMERA


def test_rosequidistant_is_a_fisheye(tmp_path):
    text = ROS.replace("plumb_bob", "equidistant").replace("[0.1, -0.2, 0, 0, 0.01]", "[0.1, 0, 0, 0]")
    assert read(tmp_path, text).model == "fisheye"


@pytest.mark.parametrize("ending", ["yaml", "xml"])
@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_what_opencv_itself_calibrates_and_writes_is_read(tmp_path, model, ending):
    """Chessboard corners of a known lens, calibrated by OpenCV, in the file its calibration sample writes."""
    truth = Camera(640, 480, 400.0, 405.0, 322.0, 238.0, (0.03, -0.01, 0.0, 0.0), model)
    board = np.zeros((1, 54, 3))
    board[0, :, :2] = np.mgrid[:9, :6].T.reshape(-1, 2) * 0.03 - (0.12, 0.075)
    objects, pixels = [], []
    lens = cv2.fisheye if model == "fisheye" else cv2
    for turn in (
        (0.3, 0, 0),
        (-0.3, 0.2, 0),
        (0, 0.4, 0.1),
        (0.2, -0.3, 0.3),
        (0, -0.4, 0),
        (-0.2, 0.3, -0.3),
    ):
        seen, _ = lens.projectPoints(
            board, np.array(turn), np.array([0, 0, 0.3]), truth.matrix, np.array(truth.distortion)
        )
        objects.append(board.astype(np.float32))
        pixels.append(seen.reshape(1, -1, 2).astype(np.float32))
    flags = {"flags": cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC} if model == "fisheye" else {}
    _, matrix, bend, *_ = (
        lens.calibrate(objects, pixels, (640, 480), None, None, **flags)
        if flags
        else (cv2.calibrateCamera(objects, pixels, (640, 480), None, None))
    )
    path = tmp_path / f"camera.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", matrix)):
        storage.write(name, value)
    storage.write("distortion_coefficients", bend)
    storage.write("fisheye_model", int(model == "fisheye"))
    storage.release()
    found = read_camera(path)
    assert found.model == model
    assert np.allclose(
        [found.fx, found.fy, found.cx, found.cy], [truth.fx, truth.fy, truth.cx, truth.cy], atol=0.1
    )


def test_the_files_of_the_ros_calibrator_are_read(tmp_path):
    # As camera_calibration writes ost.yaml, indentation and trailing blanks included.
    rest = "".join(
        f"{name}:\n  rows: 3\n  cols: {columns}\n  data: [" + ", ".join(["0."] * 3 * columns) + "]\n"
        for name, columns in (("rectification_matrix", 3), ("projection_matrix", 4))
    )
    text = ROS.replace("data: [500.5, 0.0, 320,", "data: [500.5    ,   0.     , 320.     ,\n         ")
    assert read(tmp_path, text + rest) == CAMERA


@pytest.mark.parametrize("names", ["DK", "dk"])
def test_a_camera_info_message_as_ros_prints_it_is_read(tmp_path, names):
    bend, matrix = names
    text = f"""height: 480
width: 640
distortion_model: plumb_bob
{bend}: [0.1, -0.2, 0.0, 0.0, 0.01]
{matrix}: [500.5, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]
"""
    assert read(tmp_path, text) == CAMERA


KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [0.01, -0.02, 0.003, -0.004]
  distortion_model: equidistant
  intrinsics: [500.5, 501.0, 320.0, 240.0]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
"""


def test_a_camchain_of_kalibr_is_read(tmp_path):
    fisheye = Camera(640, 480, 500.5, 501.0, 320.0, 240.0, (0.01, -0.02, 0.003, -0.004), "fisheye")
    assert read(tmp_path, KALIBR) == fisheye
    assert read(tmp_path, KALIBR.replace("equidistant", "radtan")) == replace(fisheye, model="pinhole")


EUROC = """# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""
EUROC_CAMERA = Camera(
    752, 480, 458.654, 457.296, 367.215, 248.375, (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
)


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_a_sensor_yaml_of_euroc_is_read(tmp_path, line_end):
    path = tmp_path / "sensor.yaml"
    path.write_bytes(EUROC.replace("\n", line_end).encode())
    assert read_camera(path) == EUROC_CAMERA


def test_a_sensor_yaml_of_tum_vi_is_a_fisheye(tmp_path):
    text = EUROC.replace("radial-tangential", "equidistant")
    assert read(tmp_path, text) == replace(EUROC_CAMERA, model="fisheye")


KITTI = "".join(
    f"P{index}: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 {shift} 0.000000000000e+00 "
    "7.188560000000e+02 1.852157000000e+02 0.000000000000e+00 0.000000000000e+00 0.000000000000e+00 "
    "1.000000000000e+00 0.000000000000e+00\n"
    for index, shift in enumerate(
        ["0.000000000000e+00", "-3.861448000000e+02", "4.538225000000e+01", "-3.372877000000e+02"]
    )
)
KITTI += "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n"
KITTI_SIZE = (1241, 376)


def read_kitti(tmp_path, text, size=KITTI_SIZE):
    path = tmp_path / "calib.txt"
    path.write_text(text)
    return read_camera(path, size)


def test_a_calib_txt_of_kitti_is_read_at_the_size_of_the_pictures(tmp_path):
    expected = Camera(*KITTI_SIZE, 718.856, 718.856, 607.1928, 185.2157)
    assert read_kitti(tmp_path, KITTI) == expected
    assert expected.horizontal_fov_deg == pytest.approx(81.6, abs=0.05)


def test_of_kitti_any_of_the_cameras_will_do(tmp_path):
    alone = KITTI.splitlines()[0]
    assert read_kitti(tmp_path, alone) == read_kitti(tmp_path, KITTI)


@pytest.mark.parametrize(
    ("text", "size", "said"),
    [
        (KITTI, None, "size.*JSON"),
        (KITTI, (620, 188), "middle of 620x188"),
        (KITTI, (1241, 300), "middle of 1241x300"),
        (KITTI.replace("P3: 7.1", "P3: 9.1"), KITTI_SIZE, "one focal length"),
        (KITTI.replace("1.000000000000e+00", "2"), KITTI_SIZE, "rectified"),
        (KITTI.replace("7.188560000000e+02", "0"), KITTI_SIZE, "focal length"),
        (KITTI.replace("7.188560000000e+02", "nan"), KITTI_SIZE, "rectified"),
        (KITTI.replace("6.071928000000e+02", "wide"), KITTI_SIZE, "12 numbers"),
        (KITTI[:300], KITTI_SIZE, "12 numbers"),
        ("P0:", KITTI_SIZE, "12 numbers"),
    ],
)
def test_a_calib_txt_that_is_not_of_these_pictures_is_refused(tmp_path, text, size, said):
    with pytest.raises(BadInput, match=said):
        read_kitti(tmp_path, text, size)


def test_other_files_keep_their_own_size(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(ROS)
    assert read_camera(path, (1280, 960)) == CAMERA


@pytest.mark.parametrize("text", [EUROC, KITTI], ids=["euroc", "kitti"])
def test_cut_and_trashed_files_of_data_sets_read_or_refuse(tmp_path, text, capfd):
    rng = random.Random(0)
    for size in range(len(text)):
        trashed = list(text[: size + 1])
        trashed[rng.randrange(len(trashed))] = chr(rng.randrange(32, 127))
        try:
            assert read_kitti(tmp_path, "".join(trashed)).width > 0
        except BadInput:
            continue


@pytest.mark.parametrize(
    "text",
    [
        ROS.replace("plumb_bob", "double_sphere"),
        EUROC.replace("radial-tangential", "fov"),
        EUROC.replace("camera_model: pinhole", "camera_model: omni"),
        EUROC.replace("resolution:", "resolutions:"),
        KALIBR.replace("equidistant", "fov"),
        KALIBR.replace("camera_model: pinhole", "camera_model: omni"),
        KALIBR.replace("[640, 480]", "[640]"),
    ],
)
def test_a_lens_model_that_is_not_known_is_refused(tmp_path, text):
    with pytest.raises(BadInput, match="camera"):
        read(tmp_path, text)


def test_json_of_a_camera_is_read_back(tmp_path):
    assert read(tmp_path, json.dumps(asdict(CAMERA))) == CAMERA


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no focal length.*--hfov"),
        ("image_width: 3\nimage_height: 4\n", "no focal length.*--hfov"),
        ('{"width": 3}', "no focal length.*--hfov"),
        ("hello world\n", "something else"),
        ('{"width": ', "broken JSON"),
        ('{"a":' * 5000, "broken JSON"),
        (json.dumps({**asdict(CAMERA), "fx": "wide"}), "expected numbers"),
        (json.dumps({**asdict(CAMERA), "zoom": 2}), "unknown"),
        (json.dumps({"fx": 1, "fy": 1, "cx": 0, "cy": 0, "width": 5}), "no height"),
        (ROS.replace("500.5, 0.0,", ""), "3x3"),
        (ROS.replace("500.5", "wide"), "not a number"),
        (ROS.replace("480", "high"), "not a number"),
        (ROS.replace("500.5", "0.0"), "focal length"),
        (ROS.replace("[0.1, -0.2,", "["), "coefficients, got 3"),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path, text, said):
    with pytest.raises(BadInput, match=said):
        read(tmp_path, text)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        read_camera(tmp_path / "none.yaml")


def test_a_binary_file_is_refused(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(BadInput, match="binary"):
        read_camera(path)


def test_cut_and_trashed_files_read_or_refuse(tmp_path, capfd):
    rng = random.Random(0)
    for size in range(len(ROS)):
        text = list(ROS[: size + 1])
        text[rng.randrange(len(text))] = chr(rng.randrange(32, 127))
        try:
            assert read(tmp_path, "".join(text)).width > 0
        except BadInput:
            continue
