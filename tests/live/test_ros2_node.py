"""The ROS 2 node's conversions against rosbags' message definitions, through CDR and back."""

from __future__ import annotations

import ast
import math
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")
from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.ros_records import DamagedError
from flightdepth.motion import rotation_from_euler, rotation_from_quaternion
from flightdepth.outputs.ros_fields import camera_fields, image_fields
from flightdepth.runtimes.network import load_network
from tests_recordings import START_NS, STORES, Messages

PACKAGE = Path(__file__).parents[2] / "ros2" / "flightdepth_ros"
STORE, MADE = STORES["cdr"], Messages("cdr")
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"


@pytest.fixture(scope="module")
def conversion():
    sys.path.insert(0, str(PACKAGE))
    try:
        from flightdepth_ros import conversion as module

        yield module
    finally:
        sys.path.remove(str(PACKAGE))


def through_cdr(kind: str, message):
    """The message as another node receives it."""
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, kind), kind)


def info_message(fields: dict):
    roi = STORE.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return STORE.types[INFO](
        header=MADE.header(0, "camera_optical"),
        roi=roi,
        **{
            name: np.asarray(value, np.float64) if name in "dkrp" else value for name, value in fields.items()
        },
    )


def test_depth_is_metres_with_nan():
    depth_m = np.array([[1.5, np.nan, 40.25], [0.01, 100.0, 7.0]], np.float32)
    fields = image_fields(depth_m, "32FC1")
    message = STORE.types[IMAGE](header=MADE.header(0, "camera_optical"), **fields)
    back = through_cdr(IMAGE, message)
    assert (back.encoding, back.step, back.is_bigendian) == ("32FC1", 12, 0)
    np.testing.assert_array_equal(back.data.view("<f4").reshape(back.height, back.width), depth_m)


@pytest.mark.parametrize(
    "camera",
    [
        Camera(640, 480, 500, 510, 319.5, 240.5),
        Camera(640, 480, 500, 510, 319.5, 240.5, (-0.2, 0.03, 0.001, -0.002, 0.0)),
        Camera(640, 480, 500, 510, 319.5, 240.5, (0.1, 0.2, 0, 0, 0.3, 0.1, 0.2, 0.3)),
        Camera(640, 480, 300, 300, 319.5, 240.5, (0.05, -0.01, 0.002, 0.0), "fisheye"),
    ],
)
def test_a_camera_comes_back_from_its_info(conversion, camera):
    back = conversion.camera_of(through_cdr(INFO, info_message(camera_fields(camera))))
    assert back == camera


def test_a_region_of_interest_that_is_the_whole_picture_is_none(conversion):
    info = info_message(camera_fields(Camera(64, 48, 50, 50, 31.5, 23.5)))
    info.roi.width, info.roi.height = 64, 48
    assert conversion.camera_of(info).width == 64
    info.roi.width = 32
    with pytest.raises(BadInput, match="region of interest"):
        conversion.camera_of(info)


@pytest.mark.parametrize(("name", "value"), [("binning_x", 2), ("distortion_model", "thin_prism")])
def test_what_is_not_the_whole_picture_is_refused(conversion, name, value):
    fields = camera_fields(Camera(64, 48, 50, 50, 31.5, 23.5)) | {name: value}
    with pytest.raises(BadInput, match="camera info"):
        conversion.camera_of(info_message(fields))


def test_a_picture_and_its_time(conversion):
    pixels = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    _, message = MADE.image(0.5, pixels[..., ::-1], "bgr8")
    stamp_ns, image = conversion.image_of(through_cdr(IMAGE, message), 1)
    assert stamp_ns == START_NS + 500_000_000
    np.testing.assert_array_equal(image, pixels)


def test_velocity_in_north_east_down(conversion):
    kind, message = MADE.odometry(0.0, (4.0, 1.0, -0.5), sigma=0.2)  # the body's x points east
    stamp_ns, velocity, sigma = conversion.velocity_of(through_cdr(kind, message), 1)
    assert stamp_ns == START_NS and sigma == pytest.approx(0.2)
    np.testing.assert_allclose(velocity, (1.0, 4.0, 0.5))


def test_a_camera_ahead_on_a_body_that_points_east(conversion):
    kind, message = MADE.odometry(0.0, (0.0, 0.0, 0.0))
    _, attitude = conversion.camera_attitude_of(through_cdr(kind, message), 1, 0.0)
    axis, down = rotation_from_quaternion(attitude)[:, 2], rotation_from_quaternion(attitude)[:, 1]
    np.testing.assert_allclose(axis, (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(down, (0, 0, 1), atol=1e-12)


def test_a_camera_that_looks_up_on_a_body_that_points_east(conversion):
    kind, message = MADE.odometry(0.0, (0.0, 0.0, 0.0))
    _, attitude = conversion.camera_attitude_of(through_cdr(kind, message), 1, 30.0)
    axis = rotation_from_quaternion(attitude)[:, 2]
    np.testing.assert_allclose(axis, (0, math.sqrt(3) / 2, -0.5), atol=1e-12)


def test_odometry_of_the_camera_itself_needs_no_mount(conversion):
    """Visual odometry tells how its optical frame is turned."""
    kind, message = MADE.odometry(0.0, (0.0, 0.0, 0.0))
    message.child_frame_id = "camera_optical_frame"
    looks_down_in_enu = STORE.types["geometry_msgs/msg/Quaternion"](1.0, 0.0, 0.0, 0.0)
    message.pose.pose.orientation = looks_down_in_enu
    _, attitude = conversion.camera_attitude_of(through_cdr(kind, message), 1, 30.0)
    # x east, y south, z down: in north-east-down the columns of the camera's axes.
    expected = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(rotation_from_quaternion(attitude), expected, atol=1e-12)


@pytest.mark.parametrize("told", [{"wxyz": (0, 0, 0, 0), "child": ""}, {"frame": "camera_optical_frame"}])
def test_odometry_that_tells_no_orientation_of_the_drone_is_left_out(conversion, told):
    """It ended the node."""
    kind, message = MADE.odometry(0.0, (0.0, 0.0, 0.0), **told)
    with pytest.raises(DamagedError, match="how the drone is turned"):
        conversion.camera_attitude_of(through_cdr(kind, message), 1, 0.0)


def test_conversion_needs_no_ros(conversion):
    """rclpy stands in the node alone, and the node imports only what conversion has."""
    node = ast.parse((PACKAGE / "flightdepth_ros" / "node.py").read_text())
    [wanted] = [
        entry
        for entry in ast.walk(node)
        if isinstance(entry, ast.ImportFrom) and entry.module == "flightdepth_ros.conversion"
    ]
    assert all(hasattr(conversion, name.name) for name in wanted.names)
    assert "rclpy" not in (PACKAGE / "flightdepth_ros" / "conversion.py").read_text().split('"""', 2)[2]


class Logged:
    """As much of rclpy's Node as DepthNode uses after its start."""

    def __init__(self):
        self.lines, self.published = [], []

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **how: self.lines.append(text))

    def get_parameter(self, name):
        return SimpleNamespace(value=math.nan)

    def publish(self, publisher, made, source, fields):
        self.published.append(fields)

    depth = info = None
    now_ns = START_NS


def told(made, *_, **fields):
    """What stands in for the start of a ROS object: keeps what it was told by name."""
    vars(made).update(fields)


@pytest.fixture
def node(conversion, monkeypatch):
    """The node's class, with names in place of ROS, which is not here."""
    names = {"rclpy": [], "rclpy.node": ["Node"], "rclpy.qos": ["QoSProfile", "ReliabilityPolicy"]}
    names |= {"nav_msgs.msg": ["Odometry"], "sensor_msgs.msg": ["CameraInfo", "Image"]}
    for module, held in names.items():
        made = ModuleType(module)
        for name in held:
            setattr(made, name, type(name, (), {"BEST_EFFORT": 0, "__init__": told}))
        monkeypatch.setitem(sys.modules, module, made)
    monkeypatch.delitem(sys.modules, "flightdepth_ros.node", raising=False)
    from flightdepth_ros.node import DepthNode

    made = type(
        "Node",
        (Logged,),
        dict(vars(DepthNode)) | {"__init__": Logged.__init__, "publish": Logged.publish, "now_ns": START_NS},
    )()
    made.camera = Camera.from_fov(64, 48, 75)
    made.network, made.ranges = load_network("tiny-clamped-256"), 1
    made.begin()
    yield made
    sys.modules.pop("flightdepth_ros.node", None)


def test_a_message_that_cannot_be_used_does_not_end_the_node(node):
    """The NaN of a filter that has just begun did, and so did a picture of another size."""
    node.on_odometry(MADE.odometry(0.0, (math.nan, 0.0, 0.0))[1])
    node.on_image(MADE.image(0.5, np.zeros((9, 16, 3), np.uint8), "bgr8")[1])
    assert [line.split(":")[0] for line in node.lines] == ["odometry left out", "image left out"]
    node.on_odometry(MADE.odometry(0.1, (1.0, 0.0, 0.0))[1])
    assert len(node.lines) == 2


def test_pictures_that_turn_have_no_depth(node):
    """They had a wrong one: only `run` and `live` asked whether they turn."""
    rng = np.random.default_rng(5)
    seen = cv2.resize(rng.integers(0, 256, (12, 16), np.uint8), (64, 48), interpolation=cv2.INTER_CUBIC)
    matrix = node.camera.matrix
    for k in range(6):
        node.on_odometry(MADE.odometry(k / 30, (1.0, 0.0, 0.0))[1])
        turn = matrix @ rotation_from_euler(0.0, math.radians(2 * k), 0.0) @ np.linalg.inv(matrix)
        turned = cv2.warpPerspective(seen, turn, (64, 48), borderMode=cv2.BORDER_REFLECT)
        node.on_image(MADE.image(k / 30, np.repeat(turned[..., None], 3, axis=2), "bgr8")[1])
    assert "turns" in node.lines[-1]
    assert {fields["encoding"] for fields in node.published[::2]} == {"32FC1"}
    depth_m = np.frombuffer(node.published[-2]["data"], np.float32)
    assert np.isnan(depth_m).all()


def test_a_bag_that_is_played_again_has_depth_again(node):
    """Nothing came any more, nor after a simulator's reset: each picture was left out as not later than the last."""
    seen = cv2.resize(np.random.default_rng(5).integers(0, 256, (12, 16, 3), np.uint8), (64, 48))
    for _ in range(2):
        said = []
        for k in range(7):
            node.on_odometry(MADE.odometry(k / 5, (3.0, 0.0, 0.0))[1])
            node.on_image(MADE.image(k / 5, np.roll(seen, k, axis=1), "bgr8")[1])
            said.append(len(node.lines))
        assert said[2] == said[-1]  # each from the third on has depth
    assert len(node.published) == 2 * 2 * 7
    assert node.lines[1] == "times go back by 1.2 s: begun anew"


@pytest.mark.parametrize("back_s", [0.9, 1.1])
def test_pictures_that_come_late_by_up_to_a_second_are_left_out_alone(node, back_s):
    for at_s in (2.0, 2.0 - back_s, 2.1):
        node.on_image(MADE.image(at_s, np.zeros((48, 64, 3), np.uint8), "bgr8")[1])
    assert any("image left out" in line for line in node.lines) == (back_s < 1)
    assert any("begun anew" in line for line in node.lines) == (back_s > 1)


def test_odometry_is_heard_from_publishers_that_promise_no_delivery(node):
    """mavros is one: nothing of it came."""
    from flightdepth_ros.node import DepthNode

    heard = {}

    class Heard(DepthNode):
        def create_subscription(self, kind, topic, callback, quality):
            heard[topic] = getattr(quality, "reliability", "reliable"), getattr(quality, "depth", quality)

        def declare_parameter(self, *_):
            pass

        create_publisher = declare_parameter

    Heard()
    assert heard == {"camera_info": (0, 1), "odometry": (0, 50), "image": (0, 1)}


def test_the_package_is_named_alike_everywhere():
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert root.findtext("name") == "flightdepth_ros"
    assert (PACKAGE / "resource" / "flightdepth_ros").exists()
    assert "flightdepth_ros" in (PACKAGE / "setup.cfg").read_text()
