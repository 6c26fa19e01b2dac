"""The recording, read back by rosbags and by mcap's own reader."""

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from flown_folder import FRAMES, RED, STEP_M, WALL_M, write_flown
from output_samples import HEIGHT, SOURCE, WIDTH
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from flightdepth.camera import Camera
from flightdepth.flight.ros_frames import ros_frames
from flightdepth.outputs.mcap_file import (
    CONFIDENCE,
    DEPTH,
    DEPTH_LENS,
    KINDS,
    LENS,
    PICTURE,
    TRANSFORM,
    Recording,
    write_mcap,
)

mcap_reader = pytest.importorskip("mcap.reader")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ros")
    write_mcap(folder / "flight.mcap", write_flown(folder / "out"))
    return folder / "flight.mcap"


def messages(path: Path, topic: str) -> list:
    with AnyReader([path]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == topic]
        return [
            (stamp_ns, reader.deserialize(data, connection.msgtype))
            for connection, stamp_ns, data in reader.messages(chosen)
        ]


def test_depth_is_32fc1_in_metres_and_nan_where_unknown(recording):
    found = messages(recording, DEPTH)
    assert len(found) == FRAMES
    stamp_ns, image = found[4]
    assert stamp_ns == image.header.stamp.sec * 10**9 + image.header.stamp.nanosec == 400_000_000
    assert (image.encoding, image.height, image.width, image.step) == ("32FC1", HEIGHT, WIDTH, 4 * WIDTH)
    assert image.data.view("<f4") == pytest.approx(WALL_M - 4 * STEP_M, abs=0.005)
    assert np.isnan(found[0][1].data.view("<f4")).all()


def test_depth_and_its_lens_are_in_one_frame(recording):
    depth, lens = messages(recording, DEPTH)[1][1], messages(recording, LENS)[1][1]
    assert depth.header.frame_id == lens.header.frame_id == "camera_optical"
    assert lens.k.reshape(3, 3) == pytest.approx(SOURCE.camera.matrix)
    assert (lens.width, lens.height, lens.distortion_model, len(lens.d)) == (WIDTH, HEIGHT, "plumb_bob", 5)


def test_depth_has_its_lens_where_ros_looks_for_it(recording):
    """Found in review: RViz's DepthCloud and depth_image_proc look beside the depth, and found none."""
    assert Path(DEPTH_LENS) == Path(DEPTH).with_name("camera_info")
    lenses = [str(message) for _, message in messages(recording, LENS)]
    assert [str(message) for _, message in messages(recording, DEPTH_LENS)] == lenses
    assert len(lenses) == FRAMES


def test_each_picture_has_the_lens_as_it_zoomed(tmp_path):
    camera = SOURCE.camera
    folder = write_flown(tmp_path / "out", frames=3, cameras={0: camera, 2: camera.zoomed(1.5)})
    write_mcap(tmp_path / "flight.mcap", folder)
    focals = [(lens.k[0], lens.k[4], lens.p[0]) for _, lens in messages(tmp_path / "flight.mcap", LENS)]
    assert np.array(focals) == pytest.approx(camera.fx * np.outer((1, 1, 1.5), (1, 1, 1)))


def test_transforms_put_the_wall_where_it_is(recording):
    """A point ahead in each frame's optical axes is the same in the map: north is y."""
    for stamp_ns, message in messages(recording, TRANSFORM):
        (one,) = message.transforms
        assert (one.header.frame_id, one.child_frame_id) == ("map", "camera_optical")
        q, t = one.transform.rotation, one.transform.translation
        forward = np.array([q.x * q.z + q.w * q.y, q.y * q.z - q.w * q.x, 0.5 - q.x**2 - q.y**2]) * 2
        depth_m = WALL_M - STEP_M * stamp_ns / 1e8
        assert np.array([t.x, t.y, t.z]) + forward * depth_m == pytest.approx([0, WALL_M, 0], abs=1e-3)


def test_confidence_and_pictures(recording):
    confidence = messages(recording, CONFIDENCE)[3][1]
    assert confidence.encoding == "8UC1"
    assert set(confidence.data.tolist()) == {204}
    packed = messages(recording, PICTURE)[3][1]
    image = cv2.imdecode(packed.data, cv2.IMREAD_COLOR)[..., ::-1]
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(image.astype(int) - RED).max() < 10


def test_mcaps_own_reader_sees_an_indexed_ros_2_recording(recording):
    with recording.open("rb") as file:
        reader = mcap_reader.make_reader(file)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert {channel.topic for channel in summary.channels.values()} == set(KINDS)
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        store = get_typestore(Stores.ROS2_HUMBLE)
        stamps = [
            (message.log_time, store.deserialize_cdr(message.data, schema.name).header.frame_id)
            for schema, _, message in reader.iter_messages(topics=[DEPTH])
        ]
    assert stamps == [(i * 100_000_000, "camera_optical") for i in range(FRAMES)]


def test_flightdepth_reads_the_pictures_of_its_own_recording(recording):
    frames = list(ros_frames(recording, PICTURE))
    assert [frame.stamp_ns for frame in frames] == [i * 100_000_000 for i in range(FRAMES)]


@pytest.mark.parametrize(
    ("camera", "name", "count"),
    [
        (Camera(8, 6, 4, 4, 3, 2, (0.1, 0, 0, 0), "fisheye"), "equidistant", 4),
        (Camera(8, 6, 4, 4, 3, 2, (0.1, 0, 0, 0)), "plumb_bob", 5),
        (Camera(8, 6, 4, 4, 3, 2, (0.1,) * 8), "rational_polynomial", 8),
    ],
)
def test_lenses_have_ros_names(camera, name, count):
    file = io.BytesIO()
    recording = Recording(file)
    recording.lens(0, camera)
    recording.finish()
    store = get_typestore(Stores.ROS2_HUMBLE)
    ((_, _, message),) = mcap_reader.make_reader(io.BytesIO(file.getvalue())).iter_messages(topics=[LENS])
    lens = store.deserialize_cdr(message.data, KINDS[LENS])
    assert (lens.distortion_model, len(lens.d), lens.d[0]) == (name, count, pytest.approx(0.1))
