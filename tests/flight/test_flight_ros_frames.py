from collections import Counter

import cv2
import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.ros import read_ros
from flightdepth.flight.ros_frames import ros_frames
from tests_recordings import ROS_CONTAINERS, Messages, write_mcap

RED = np.zeros((6, 8, 3), np.uint8)
RED[..., 0] = 200
MADE = Messages("cdr")


def recorded(tmp_path, *messages):
    timed = [(topic, index / 20, message) for index, (topic, message) in enumerate(messages)]
    return write_mcap(tmp_path / "flight.mcap", timed)


@pytest.mark.parametrize("container", ROS_CONTAINERS)
def test_pictures_come_back_from_each_container(tmp_path, container):
    write, serial = ROS_CONTAINERS[container]
    made = Messages(serial)
    path = write(
        tmp_path / "f.bag", [("/image", i / 10, made.image(i / 10, RED + i, "rgb8")) for i in range(3)]
    )
    frames = list(ros_frames(path))
    assert [frame.stamp_ns for frame in frames] == [0, 100_000_000, 200_000_000]
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert all((frame.image == RED + index).all() for index, frame in enumerate(frames))


@pytest.mark.parametrize(
    ("encoding", "pixel"),
    [("rgb8", (200, 0, 0)), ("bgr8", (0, 0, 200)), ("rgba8", (200, 0, 0, 255)), ("bgra8", (0, 0, 200, 255))],
)
def test_red_is_red_in_each_encoding(tmp_path, encoding, pixel):
    array = np.broadcast_to(np.array(pixel, np.uint8), (6, 8, len(pixel)))
    [frame] = ros_frames(recorded(tmp_path, ("/image", MADE.image(0, array, encoding))))
    assert (frame.image == RED).all()


@pytest.mark.parametrize(
    ("encoding", "row", "column"),
    [("bayer_rggb8", 0, 0), ("bayer_bggr8", 1, 1), ("bayer_gbrg8", 1, 0), ("bayer_grbg8", 0, 1)],
)
def test_a_red_scene_through_each_bayer_pattern_is_red(tmp_path, encoding, row, column):
    array = np.zeros((16, 16), np.uint8)
    array[row::2, column::2] = 200
    [frame] = ros_frames(recorded(tmp_path, ("/image", MADE.image(0, array, encoding))))
    assert (frame.image[4:-4, 4:-4] == (200, 0, 0)).all()


def test_pictures_and_telemetry_count_from_the_same_picture_though_it_cannot_be_unpacked(tmp_path):
    data = cv2.imencode(".jpg", RED)[1].tobytes()
    pictures = [("/image", MADE.compressed(k / 10, data[: None if k else 20])) for k in range(3)]
    path = recorded(tmp_path, *pictures, ("/odom", MADE.odometry(0.1, (1, 0, 0))))
    assert [frame.stamp_ns for frame in ros_frames(path)] == [100_000_000, 200_000_000]
    telemetry = read_ros(path)
    assert telemetry.velocities[0].stamp_ns == 100_000_000
    assert telemetry.time_0_told


def test_a_jpeg_is_unpacked(tmp_path):
    data = cv2.imencode(".jpg", cv2.cvtColor(RED, cv2.COLOR_RGB2BGR))[1].tobytes()
    [frame] = ros_frames(recorded(tmp_path, ("/image/compressed", MADE.compressed(0, data))))
    assert np.abs(frame.image.astype(int) - RED).max() < 12


def test_padded_rows_lose_their_padding(tmp_path):
    kind, message = MADE.image(0, np.pad(RED, ((0, 0), (0, 4), (0, 0))), "rgb8")
    message.width = 8
    [frame] = ros_frames(recorded(tmp_path, ("/image", (kind, message))))
    assert (frame.image == RED).all()


def test_telemetry_and_pictures_share_a_clock(tmp_path):
    path = recorded(
        tmp_path,
        ("/odom", MADE.odometry(0.00, (1, 0, 0))),
        ("/image", MADE.image(0.03, RED, "rgb8")),
        ("/odom", MADE.odometry(0.05, (1, 0, 0))),
    )
    stamps = [sample.stamp_ns for sample in read_ros(path).velocities]
    assert stamps == [-30_000_000, 20_000_000]
    assert [frame.stamp_ns for frame in ros_frames(path)] == [0]


def test_a_second_camera_is_on_the_same_clock(tmp_path):
    pictures = [("/most", MADE.image(0.3 + i / 10, RED, "rgb8")) for i in range(3)]
    later = ("/later", MADE.image(0.7, RED, "rgb8"))
    [frame] = ros_frames(recorded(tmp_path, *pictures, later), "/later")
    assert frame.stamp_ns == 400_000_000


def test_damaged_pictures_are_counted(tmp_path):
    kind, short = MADE.image(0.05, RED, "rgb8")
    short.height = 2**31
    path = recorded(
        tmp_path,
        ("/image", MADE.image(0, RED, "rgb8")),
        ("/image", (kind, short)),
        ("/image", MADE.image(0.1, RED, "no such")),
        ("/image", MADE.image(0.0, RED, "rgb8")),
    )
    counts = Counter()
    assert len(list(ros_frames(path, counts=counts))) == 1
    assert counts == {"damaged pictures": 2, "pictures not later than the one before": 1}


def test_the_topics_are_listed_where_the_one_asked_for_is_missing(tmp_path):
    path = recorded(tmp_path, ("/left", MADE.image(0, RED, "rgb8")))
    with pytest.raises(BadInput, match=r"pictures in /right, got /left"):
        ros_frames(path, "/right")


def raw_depth(time_s):
    return "/camera/depth/image_rect_raw", MADE.image(
        time_s, np.full((6, 8), 1500, np.uint16).view(np.uint8), "16UC1"
    )


def metric_depth(time_s):
    array = np.full((6, 8), 1.5, np.float32).view(np.uint8)
    return "/zed/depth/depth_registered", MADE.image(time_s, array, "32FC1")


def packed_depth(time_s):
    kind, message = MADE.compressed(time_s, bytes(20))
    message.format = "16UC1; compressedDepth"
    return "/camera/depth/image_rect_raw/compressedDepth", (kind, message)


@pytest.mark.parametrize("depth", [raw_depth, metric_depth, packed_depth])
def test_a_cameras_own_depth_is_no_picture_and_tells_no_time_0(tmp_path, depth):
    """It often comes once more than the colours: all pictures were damaged, and times counted from its first one."""
    colours = [("/camera/color/image_raw", MADE.image(0.5 + k / 10, RED + k, "rgb8")) for k in range(3)]
    path = recorded(
        tmp_path, *(depth(k / 10) for k in range(4)), *colours, ("/odom", MADE.odometry(0.75, (1, 0, 0)))
    )
    counts = Counter()
    frames = list(ros_frames(path, counts=counts))
    assert [frame.stamp_ns for frame in frames] == [0, 100_000_000, 200_000_000]
    assert not counts
    assert read_ros(path).velocities[0].stamp_ns == 250_000_000
