"""Pictures from ROS recordings, on the clock that `ros.py` gives to their telemetry."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.flight.records import Frame
from flightdepth.flight.ros_messages import COMPRESSED_IMAGE, IMAGE_KINDS, decoded, stamp_of
from flightdepth.flight.ros_records import DamagedError, RosMessage
from flightdepth.flight.ros_topics import Topic, ros_messages, topics_of, with_pictures
from flightdepth.levels import picture_in

Picture = NDArray[np.uint8]
# Channels of an encoding (sensor_msgs/image_encodings.h) and how OpenCV turns it into RGB.
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, cv2.COLOR_GRAY2RGB),
    # OpenCV names a Bayer pattern by its second row, ROS by its first.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUYV),
}


def ros_frames(path: Path, topic: str | None = None, counts: Counter[str] | None = None) -> Iterator[Frame]:
    """The pictures of `topic` (default: the topic with most), times in ns since the first of the topic with most.

    What is left out is added to `counts`: damaged pictures, those of unknown encodings, times that do not rise.
    """
    counts = Counter() if counts is None else counts
    topics, _ = topics_of(path, Counter(), IMAGE_KINDS)
    known = {each.name: each for each in with_pictures(topics)}
    most = next(iter(known), None)
    chosen = topic or most
    if most is None or chosen not in known:
        got = ", ".join(known) or "no pictures"
        raise BadInput(f"recording {path}", expected=f"pictures{f' in {topic}' if topic else ''}", got=got)
    return _frames(path, known[chosen], counts, known[most].first_ns or 0)


def _frames(path: Path, topic: Topic, counts: Counter[str], zero_ns: int) -> Iterator[Frame]:
    index, last_ns = 0, None
    for message in ros_messages(path, lambda kind: kind in IMAGE_KINDS, counts):
        if message.topic != topic.name:
            continue
        try:
            content = decoded(message)
            stamp_ns = stamp_of(content.header, message.log_ns if topic.unset_ns is None else topic.unset_ns)
            image = picture(message, content)
        except DamagedError:
            counts["damaged pictures"] += 1
            continue
        if last_ns is not None and stamp_ns <= last_ns:
            counts["pictures not later than the one before"] += 1
            continue
        last_ns = stamp_ns
        yield Frame(index, stamp_ns - zero_ns, image)
        index += 1


def picture(message: RosMessage, content: Any) -> Picture:
    """uint8 RGB [H, W, 3] of an Image or CompressedImage."""
    try:
        if message.kind == COMPRESSED_IMAGE:
            return _unpacked(content)
        return _plain(content)
    except cv2.error as error:
        raise DamagedError(f"a picture that OpenCV refuses ({error})") from error


def _unpacked(content: Any) -> Picture:
    image = picture_in(np.asarray(content.data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise DamagedError("a packed picture that cannot be read")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _plain(content: Any) -> Picture:
    if content.encoding not in ENCODINGS:
        raise DamagedError(f"a picture of encoding {content.encoding[:20]!r}")
    channels, conversion = ENCODINGS[content.encoding]
    height, width, step = int(content.height), int(content.width), int(content.step)
    if not (height > 0 and width > 0 and step >= width * channels and height * step <= len(content.data)):
        raise DamagedError(f"a picture of {len(content.data)} bytes for {height} rows of {step}")
    rows = np.asarray(content.data[: height * step], dtype=np.uint8).reshape(height, step)
    image = rows[:, : width * channels].reshape(height, width, channels)
    if conversion is None:
        return image.copy()
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion), dtype=np.uint8)
