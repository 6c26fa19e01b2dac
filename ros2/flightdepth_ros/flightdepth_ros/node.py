"""The node. Topics: image, camera_info and odometry in; depth and depth/camera_info out.

Parameters: network ("" = the nearest), ranges (2), mount_pitch_deg (NaN = a stabilised camera; else the camera is
screwed to the drone and looks up by so many degrees).
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight.ros_records import DamagedError
from flightdepth.flight.steadiness import Steadiness
from flightdepth.live.depth_stage import BACK_NS
from flightdepth.outputs.ros_fields import camera_fields, image_fields
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.network import load_network, nearest_network
from flightdepth_ros.conversion import camera_attitude_of, camera_of, image_of, velocity_of

SEQUENCES = {"data": "B", "d": "d"}  # of any length: rclpy of Humble takes them as array.array, no ndarray
# One picture waits at most: a newer one takes its place, so that the delay does not grow.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# mavros publishes odometry so; a reliable subscription hears nothing of it, while this one hears either kind.
SENSED = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class DepthNode(Node):
    """One estimator; the first CameraInfo makes it, and pictures whose times go back make it anew."""

    def __init__(self) -> None:
        super().__init__("flightdepth")
        self.declare_parameter("network", "")
        self.declare_parameter("ranges", 2)
        self.declare_parameter("mount_pitch_deg", math.nan)
        self.estimator: MultiRangeEstimator | None = None
        self.camera = None
        self.depth = self.create_publisher(Image, "depth", NEWEST)
        self.info = self.create_publisher(CameraInfo, "depth/camera_info", NEWEST)
        self.create_subscription(CameraInfo, "camera_info", self.on_camera, NEWEST)
        self.create_subscription(Odometry, "odometry", self.on_odometry, SENSED)
        self.create_subscription(Image, "image", self.on_image, NEWEST)

    def on_camera(self, message: CameraInfo) -> None:
        """The first tells the camera; later ones are ignored."""
        if self.estimator is not None:
            return
        self.camera = camera_of(message)
        name = self.get_parameter("network").value or nearest_network(self.camera)
        self.network, self.ranges = load_network(name), self.get_parameter("ranges").value
        self.network.warm_up(self.network.grid(self.camera).camera, self.ranges)
        self.begin()
        self.get_logger().info(f"{self.network.card.name}, {self.camera.width}x{self.camera.height}")

    def begin(self) -> None:
        """Nothing is known yet of pictures and motion."""
        self.estimator = MultiRangeEstimator(self.network, self.camera, ranges=self.ranges)
        self.steadiness = Steadiness(self.camera)
        self.newest_ns = 0

    def on_odometry(self, message: Odometry) -> None:
        """Velocity, and the attitude of a camera that is screwed to the drone."""
        if self.estimator is None:
            return
        pitch_deg = self.get_parameter("mount_pitch_deg").value
        with self.left_out_if_bad("odometry"):
            stamp_ns, velocity, sigma = velocity_of(message, self.now_ns)
            self.estimator.add_velocity(stamp_ns, velocity, sigma=sigma)
            if not math.isnan(pitch_deg):
                self.estimator.add_attitude(*camera_attitude_of(message, self.now_ns, pitch_deg))

    def on_image(self, message: Image) -> None:
        """Depth of each picture; where there is none, the log says why."""
        if self.estimator is None:
            return
        with self.left_out_if_bad("image"):
            stamp_ns, image = image_of(message, self.now_ns)
            back_ns = self.newest_ns - stamp_ns
            if back_ns > BACK_NS:  # a bag that is played again, a simulator that was reset
                self.get_logger().warning(f"times go back by {back_ns / 1e9:.1f} s: begun anew")
                self.begin()
            self.newest_ns = max(self.newest_ns, stamp_ns)
            turn = self.steadiness.add(stamp_ns, image, self.estimator.max_turn_rad(stamp_ns))
            result = self.estimator.add_frame(stamp_ns, image, unusable=turn.unusable)
            if result.reason is not None:
                self.get_logger().warning(f"no depth: {result.reason}", throttle_duration_sec=2.0)
            if result.doubt is not None:
                self.get_logger().warning(result.doubt, throttle_duration_sec=10.0)
            self.publish(self.depth, Image(), message, image_fields(result.depth_m, "32FC1"))
            self.publish(self.info, CameraInfo(), message, camera_fields(self.camera))

    @contextmanager
    def left_out_if_bad(self, what: str) -> Iterator[None]:
        """A message that cannot be used ends nothing, such as the NaN of a filter that has just begun."""
        try:
            yield
        except (BadInput, DamagedError) as error:
            self.get_logger().warning(f"{what} left out: {error}", throttle_duration_sec=2.0)

    @property
    def now_ns(self) -> int:
        """The node's clock."""
        return self.get_clock().now().nanoseconds

    @staticmethod
    def publish(publisher, made, source: Image, fields: dict[str, object]) -> None:
        """With the picture's own header: same time, same optical frame."""
        made.header = source.header
        for name, value in fields.items():
            setattr(made, name, array(SEQUENCES[name], value.tobytes()) if name in SEQUENCES else value)
        publisher.publish(made)


def main() -> int:
    """Until Ctrl-C; the exit code."""
    rclpy.init()
    node = DepthNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    except FlightDepthError as error:
        node.get_logger().fatal(str(error))
        return error.exit_code
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
