"""The way of a camera whose log tells a speed alone: pairs by hand, along a known path."""

from types import SimpleNamespace

import numpy as np
import pytest
from output_samples import unknown

from flightdepth.flight import Frame
from flightdepth.motion import NED_FROM_CAMERA, rotation_angle_rad, rotation_from_euler
from flightdepth.outputs.poses import PoseTrack
from flightdepth.outputs.seen_path import REMEMBERED, SeenPath
from flightdepth.ranges.seen_turns import SeenOrientation

FRAMES = 60


def circling(frame):
    """Position in the first camera's axes (right, down, forward) and attitude; it flies where it looks."""
    turned = np.radians(3.0 * frame)
    radius_m = 10.0
    place = radius_m * np.array([1 - np.cos(turned), 0.0, np.sin(turned)])
    return place, rotation_from_euler(0, turned, 0)


def result(index, shifts, begun=0):
    """What the pairs with frames so many before tell; turns were put together since frame `begun`."""
    place, attitude = circling(index)
    moved_m = [attitude.T @ (place - circling(index - shift)[0]) for shift in shifts]
    orientation = SeenOrientation(circling(begun)[1].T @ attitude, begun)
    return SimpleNamespace(orientation=orientation, moved_m=np.array(moved_m), shifts=np.array(shifts))


@pytest.mark.parametrize("shifts", [(1,), (1, 4), (2, 3, 7)])
def test_the_way_is_that_of_the_pairs_put_together(shifts):
    path = SeenPath()
    first = shifts[-1]
    for index in range(first, FRAMES):
        place_m, segment, attitude = path.at(index, result(index, shifts, begun=first))
        place, turned = circling(index)
        began, from_began = circling(first)
        assert segment == 0
        np.testing.assert_allclose(place_m, NED_FROM_CAMERA @ from_began.T @ (place - began), atol=1e-9)
        assert rotation_angle_rad(attitude.T @ NED_FROM_CAMERA @ from_began.T @ turned) < 1e-6


def test_it_begins_looking_north_level():
    place_m, segment, attitude = SeenPath().at(3, result(3, (1,), begun=3))
    assert segment == 0 and np.array_equal(place_m, np.zeros(3))
    np.testing.assert_allclose(attitude, NED_FROM_CAMERA, atol=1e-12)


@pytest.mark.parametrize(("shifts", "begun"), [((1,), 30), ((25,), 0)])
def test_where_nothing_leads_on_another_segment_begins(shifts, begun):
    """Turns were put together anew; or the pair is with a frame that had no place."""
    path = SeenPath()
    segments = [path.at(index, result(index, (1,)))[1] for index in range(10, 30)]
    assert segments == [0] * 20
    place_m, segment, _ = path.at(30, result(30, shifts, begun))
    assert segment == 1 and np.array_equal(place_m, np.zeros(3))
    assert path.at(31, result(31, (1,), begun))[1] == 1


def test_what_pictures_do_not_tell_has_no_pose():
    path = SeenPath()
    blind = result(5, (1,))
    assert path.at(5, SimpleNamespace(orientation=None, moved_m=blind.moved_m, shifts=blind.shifts)) is None
    assert (
        path.at(5, SimpleNamespace(orientation=blind.orientation, moved_m=None, shifts=blind.shifts)) is None
    )
    track = PoseTrack(any_direction=True)
    assert track.at(Frame(0, 0, np.zeros((8, 8, 3), np.uint8)), unknown()) is None


def test_poses_of_a_speed_alone_are_assumed():
    track = PoseTrack(any_direction=True)
    for index in range(1, 5):
        frame = Frame(index, index * 33_000_000, np.zeros((8, 8, 3), np.uint8))
        pose = track.at(frame, result(index, (1,), begun=1))
    assert (pose.attitude, pose.segment, pose.index) == ("assumed", 0, 4)
    assert pose.position_ned == pytest.approx(
        NED_FROM_CAMERA @ circling(1)[1].T @ (circling(4)[0] - circling(1)[0])
    )


def test_what_is_remembered_stays_bounded():
    path = SeenPath()
    for index in range(1, REMEMBERED + 20):
        path.at(index, result(index, (1,)))
    assert len(path._positions) == REMEMBERED
