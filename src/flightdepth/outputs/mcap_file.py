"""A flight as a ROS 2 recording, one MCAP file: depth, confidence, picture, lens and the camera's place.

topic                        type                          content
/camera/depth/image_raw      sensor_msgs/Image             32FC1, metres, NaN = unknown (REP 118)
/camera/confidence           sensor_msgs/Image             8UC1, 255 = 1, 0 = do not use
/camera/image_raw/compressed sensor_msgs/CompressedImage   JPEG, from the preview
/camera/camera_info          sensor_msgs/CameraInfo        the lens of all three; maps lie in the distorted picture
/camera/depth/camera_info    sensor_msgs/CameraInfo        the same: image_transport looks for it beside the image
/tf                          tf2_msgs/TFMessage            map (east-north-up) from camera_optical

Stamps count from the video's first picture, or from 1970 where universal time is asked for. A frame whose attitude is
unknown has no transform, nor has one outside the longest segment of the flight: another segment has another origin.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.files import file_in_progress
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.levels import jpeg
from flightdepth.motion import ENU_FROM_NED, Vector, quaternion_from_rotation
from flightdepth.outputs.cloud import placed
from flightdepth.outputs.encoding import bytes_from_confidence
from flightdepth.outputs.pictures import pictures
from flightdepth.outputs.poses import FramePose
from flightdepth.outputs.read import FlightFolder
from flightdepth.outputs.ros_fields import camera_fields, image_fields

DEPTH = "/camera/depth/image_raw"
CONFIDENCE = "/camera/confidence"
PICTURE = "/camera/image_raw/compressed"
LENS, DEPTH_LENS = "/camera/camera_info", "/camera/depth/camera_info"
TRANSFORM = "/tf"
MAP, OPTICAL = "map", "camera_optical"
KINDS = {
    DEPTH: "sensor_msgs/msg/Image",
    CONFIDENCE: "sensor_msgs/msg/Image",
    PICTURE: "sensor_msgs/msg/CompressedImage",
    LENS: "sensor_msgs/msg/CameraInfo",
    DEPTH_LENS: "sensor_msgs/msg/CameraInfo",
    TRANSFORM: "tf2_msgs/msg/TFMessage",
}
JPEG_QUALITY = 85


def write_mcap(
    path: Path,
    folder: FlightFolder,
    on_frame: Callable[[], None] = lambda: None,
    *,
    utc: UniversalTime | None = None,
) -> int:
    """Every frame of a flight into `path`, which appears when all of it stands; how many.

    Of an interrupted flight those that its preview shows. `utc`, the record's, makes stamps count from 1970.
    """
    poses = placed(folder) if any(pose.attitude != "unknown" for pose in folder.poses.values()) else {}
    stamps = {row.index: row.stamp_ns if utc is None else utc.at(row.stamp_ns) for row in folder.rows}
    frames = 0
    with file_in_progress(path) as file:
        recording = Recording(file)
        for index, image in pictures(folder):
            stamp_ns = stamps[index]
            recording.depth(stamp_ns, folder.depth_m(index))
            recording.confidence(stamp_ns, bytes_from_confidence(folder.confidence(index)))
            recording.picture(stamp_ns, image)
            recording.lens(stamp_ns, folder.camera(index))
            if index in poses:
                recording.transform(stamp_ns, poses[index])
            frames += 1
            on_frame()
        recording.finish()
    return frames


class Recording:
    """Messages, serialised by rosbags after ROS 2's definitions, in an MCAP file, compressed with zstd."""

    def __init__(self, file: BinaryIO) -> None:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore

        self._store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self._writer: Any = Writer(file)
        self._writer.start(profile="ros2", library="flightdepth")
        self._channels = {topic: self._channel(topic, kind) for topic, kind in KINDS.items()}
        self._count = 0

    def depth(self, stamp_ns: int, depth_m: NDArray[np.float32]) -> None:
        """Depth in metres [H, W], NaN = unknown."""
        self._image(DEPTH, stamp_ns, depth_m, "32FC1")

    def confidence(self, stamp_ns: int, stored: NDArray[np.uint8]) -> None:
        """Confidence [H, W] in 255ths."""
        self._image(CONFIDENCE, stamp_ns, stored, "8UC1")

    def picture(self, stamp_ns: int, image: NDArray[np.uint8]) -> None:
        """RGB [H, W, 3], packed as JPEG."""
        data = np.frombuffer(jpeg(image, JPEG_QUALITY), np.uint8)
        header = self._header(stamp_ns, OPTICAL)
        self._write(PICTURE, stamp_ns, header=header, format="rgb8; jpeg compressed bgr8", data=data)

    def lens(self, stamp_ns: int, camera: Camera) -> None:
        """The camera of the picture as it is."""
        roi = self._message("sensor_msgs/msg/RegionOfInterest")
        whole = roi(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        header = self._header(stamp_ns, OPTICAL)
        for topic in (LENS, DEPTH_LENS):
            self._write(topic, stamp_ns, header=header, roi=whole, **camera_fields(camera))

    def transform(self, stamp_ns: int, pose: FramePose) -> None:
        """The camera's place, map from camera."""
        transform = self._message("geometry_msgs/msg/Transform")(
            translation=self._vector(ENU_FROM_NED @ pose.position_ned),
            rotation=self._quaternion(ENU_FROM_NED @ pose.ned_from_camera),
        )
        stamped = self._message("geometry_msgs/msg/TransformStamped")(
            header=self._header(stamp_ns, MAP), child_frame_id=OPTICAL, transform=transform
        )
        self._write(TRANSFORM, stamp_ns, transforms=[stamped])

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()

    def _image(self, topic: str, stamp_ns: int, pixels: NDArray[Any], encoding: str) -> None:
        header = self._header(stamp_ns, OPTICAL)
        self._write(topic, stamp_ns, header=header, **image_fields(pixels, encoding))

    def _channel(self, topic: str, kind: str) -> int:
        definition, _ = self._store.generate_msgdef(kind, ros_version=2)
        schema = self._writer.register_schema(kind, "ros2msg", definition.encode())
        return int(self._writer.register_channel(topic, "cdr", schema))

    def _message(self, kind: str) -> Any:
        return self._store.types[kind]

    def _header(self, stamp_ns: int, frame: str) -> Any:
        time = self._message("builtin_interfaces/msg/Time")
        stamp = time(sec=stamp_ns // NS_PER_S, nanosec=stamp_ns % NS_PER_S)
        return self._message("std_msgs/msg/Header")(stamp=stamp, frame_id=frame)

    def _vector(self, xyz: Vector) -> Any:
        x, y, z = map(float, xyz)
        return self._message("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)

    def _quaternion(self, rotation: Vector) -> Any:
        w, x, y, z = map(float, quaternion_from_rotation(rotation))
        return self._message("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)

    def _write(self, topic: str, stamp_ns: int, **fields: Any) -> None:
        kind = KINDS[topic]
        data = self._store.serialize_cdr(self._message(kind)(**fields), kind)
        self._writer.add_message(self._channels[topic], stamp_ns, bytes(data), stamp_ns, self._count)
        self._count += 1
