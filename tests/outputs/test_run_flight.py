from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from output_samples import HEIGHT, SOURCE, WIDTH, known

from flightdepth.camera import Camera
from flightdepth.flight import AttitudeSample, Frame, VelocitySample
from flightdepth.flight.places import SEA_LEVEL, PlaceTrack
from flightdepth.flight.steadiness import MAX_TURN_RAD
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.outputs import FlightFolder, FlightWriter, Preview, run_flight
from flightdepth.outputs.writer import MASK, PROPOSED_MASK

FRAME_NS = 33_366_667
TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (HEIGHT, 600, 3), np.uint8), (0, 0), 1)


class Recorder:
    """An estimator that writes down what it was given."""

    shown = None

    def __init__(self):
        self.calls = []
        self.dropped = Counter({"late velocities": 3})

    def max_turn_rad(self, stamp_ns):
        return 10 * MAX_TURN_RAD if ("attitude", stamp_ns, (1, 0, 0, 0)) in self.calls else MAX_TURN_RAD

    def add_velocity(self, stamp_ns, velocity, *, frame, sigma):
        self.calls.append(("velocity", stamp_ns, tuple(velocity), frame, sigma))

    def add_attitude(self, stamp_ns, world_from_camera):
        self.calls.append(("attitude", stamp_ns, tuple(world_from_camera)))

    def see_through(self, camera):
        self.calls.append(("camera", camera.fx))

    def add_frame(self, stamp_ns, image, *, unusable):
        self.calls.append(("frame", stamp_ns, unusable))
        return known(10)


class FlightOf:
    camera = Camera.from_fov(WIDTH, HEIGHT, 90)
    gyroscope = None
    turns = None
    mask = None
    any_direction = False
    places = None
    utc = None

    def __init__(self, *events):
        self.events = events
        self.counts = {}

    def __iter__(self):
        yield from self.events
        self.counts = {"damaged frames": 1}

    def lens_doubt(self):
        return "the turns tell another lens"


def picture(index, x=0):
    return Frame(index, index * FRAME_NS, np.ascontiguousarray(TEXTURE[:, x : x + WIDTH]))


@pytest.fixture
def go(tmp_path):
    def run(*events, places=None):
        estimator, seen, flight = Recorder(), [], FlightOf(*events)
        flight.places = places
        with FlightWriter(tmp_path / "out", SOURCE, Preview(WIDTH, HEIGHT)) as writer:
            run_flight(flight, estimator, writer, lambda frame, result: seen.append(frame.index))
        return SimpleNamespace(calls=estimator.calls, seen=seen, folder=FlightFolder(tmp_path / "out"))

    return run


def test_samples_and_frames_reach_the_estimator_in_order(go):
    done = go(
        VelocitySample(0, np.array([1.0, 2, 3]), "camera", 0.1),
        AttitudeSample(5, np.array([1.0, 0, 0, 0])),
        picture(0),
        picture(1),
    )
    assert done.calls == [
        ("velocity", 0, (1, 2, 3), "camera", 0.1),
        ("attitude", 5, (1, 0, 0, 0)),
        ("frame", 0, None),
        ("frame", FRAME_NS, None),
    ]


def test_every_frame_is_written_and_told(go):
    done = go(picture(0), picture(1), picture(2))
    assert done.seen == [row.index for row in done.folder.rows] == [0, 1, 2]


def test_a_frame_that_cannot_be_followed_is_said_to_be_unusable(go):
    done = go(picture(0), picture(1), picture(2, x=300))
    assert [unusable is None for _, _, unusable in done.calls] == [True, True, False]
    assert "too fast" in done.calls[2][2]


def panned(index, rad, camera=FlightOf.camera):
    """A picture of a camera that turned right by so much."""
    down = np.array([[1.0, 0, -100], [0, 1, 0], [0, 0, 1]])
    turn = camera.matrix @ cv2.Rodrigues(np.array([0.0, -rad, 0.0]))[0] @ np.linalg.inv(camera.matrix)
    seen = cv2.warpPerspective(TEXTURE, turn @ down, (WIDTH, HEIGHT))
    return Frame(index, index * FRAME_NS, seen)


@pytest.mark.parametrize("zoomed", [False, True])
def test_a_turn_is_judged_through_the_lens_as_it_zoomed(go, zoomed):
    """.7 degrees in a tenth of a second pass, through half the focal length, for flying past something."""
    lens = FlightOf.camera.zoomed(2)
    frames = [replace(panned(k, 0.004 * k, lens), camera=lens if zoomed else None) for k in range(4)]
    refused = [call[2] for call in go(*frames).calls if call[0] == "frame"]
    assert (refused[-1] is not None) == zoomed


def test_a_turn_counts_against_what_the_estimator_bears_at_that_time(go):
    attitude = AttitudeSample(4 * FRAME_NS, np.array([1.0, 0, 0, 0]))
    done = go(*(panned(k, 0.01 * k) for k in range(4)), attitude, panned(4, 0.04), panned(5, 0.05))
    refused = [call[2] for call in done.calls if call[0] == "frame"]
    assert [reason is None for reason in refused] == [True, False, False, False, True, False]
    assert "degrees in" in refused[-1]


def turning(leg):
    """A camera that turns by 2.3 degrees a picture, as its log says, with a bar in its pictures or not."""
    yield VelocitySample(0, np.array([0.0, 3.0, 0.0]), "world", 0.1)
    for index in range(24):
        rad = 0.04 * (index - 12)
        yield AttitudeSample(index * FRAME_NS, quaternion_from_rotation(yawed(rad) @ NED_FROM_CAMERA))
        yield VelocitySample(index * FRAME_NS, np.array([0.0, 3.0, 0.0]), "world", 0.1)
        frame = panned(index, rad)
        if leg:
            frame.image[:, 10:22] = 0
        yield frame


def yawed(rad):
    return cv2.Rodrigues(np.array([0.0, 0.0, rad]))[0]


@pytest.mark.parametrize("leg", [True, False])
def test_of_what_stands_still_while_the_camera_turns_a_mask_is_proposed(go, leg):
    done = go(*turning(leg))
    warnings = [line for line in done.folder.record.source.warnings if "stands still" in line]
    proposed = cv2.imread(str(done.folder.folder / PROPOSED_MASK), cv2.IMREAD_UNCHANGED)
    if not leg:
        assert not warnings and proposed is None
        return
    [warning] = warnings
    assert f"{np.mean(proposed == 0):.1%} of the picture" in warning and PROPOSED_MASK in warning
    assert (proposed[:, 10:22] == 0).all() and (proposed[:, 30:] == 255).all()


def test_the_mask_that_was_given_stays_beside_the_result(go, monkeypatch):
    """Where it was the one that the result before had proposed, it went with that."""
    shown = np.ones((HEIGHT, WIDTH), bool)
    shown[40:, 10:22] = False
    monkeypatch.setattr(FlightOf, "mask", SimpleNamespace(shown=shown))
    kept = cv2.imread(str(go(picture(0)).folder.folder / MASK), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(kept, np.where(shown, 255, 0))


def test_what_was_dropped_by_either_side_is_recorded(go):
    counts = go(picture(0)).folder.record.counts
    assert counts.dropped == {"damaged frames": 1, "late velocities": 3}


def test_each_frame_has_the_place_that_its_velocities_tell(go):
    done = go(
        VelocitySample(0, np.array([1.0, 0, 0]), "world"),
        VelocitySample(FRAME_NS * 2, np.array([1.0, 0, 0]), "world"),
        picture(0),
        picture(1),
    )
    assert [pose.position_ned[0] for pose in done.folder.poses.values()] == [0, 0.0334]
    assert {pose.attitude for pose in done.folder.poses.values()} == {"unknown"}


def test_each_frame_has_the_place_on_earth_that_the_log_tells(go):
    """`poses.csv` knew no latitudes, and no cloud could be laid on a map."""
    track = PlaceTrack(
        np.array([0, 2 * FRAME_NS]),
        np.array([(48.1, 11.5, 520.0), (48.100002, 11.500004, np.nan)]),
        SEA_LEVEL,
    )
    velocities = [VelocitySample(FRAME_NS * i, np.array([1.0, 0, 0]), "world") for i in (0, 3)]
    poses = go(*velocities, *map(picture, range(4)), places=track).folder.poses
    expected = [
        (48.1, 11.5, 520),
        (48.100001, 11.500002, np.nan),
        (48.100002, 11.500004, np.nan),
        (np.nan,) * 3,
    ]
    np.testing.assert_allclose([pose.place for pose in poses.values()], expected, atol=1e-9)
