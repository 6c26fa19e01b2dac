"""DJI's metadata inside a video, in messages laid out as ExifTool knows them, inside a real MP4."""

import numpy as np
import pytest
from dji_messages import header, picture
from flight_files import add_gpmf, make_video

from flightdepth.errors import BadInput
from flightdepth.flight.dji_metadata import read_dji_metadata
from flightdepth.flight.positions import JUMPING, UNFIXED
from flightdepth.motion import rotation_from_quaternion

RATE_HZ, FIXES_HZ = 25, 5
NORTH_M_S, EAST_M_S, UP_M_S = 4.0, 3.0, 0.5
# Metres a degree at 48 north, WGS 84 (tables of the US NGA).
METRES = (111_200.0, 74_632.0)


def place(index):
    """Of the last fix before a picture."""
    seconds = index // (RATE_HZ // FIXES_HZ) / FIXES_HZ
    return 48 + NORTH_M_S * seconds / METRES[0], 11 + EAST_M_S * seconds / METRES[1]


def height_mm(index):
    return 1000 * UP_M_S * index / RATE_HZ


def messages(protocol=b"Mini4_Pro", count=75, **told):
    each = [picture(i + 1, place(i), above_start_mm=height_mm(i), **told) for i in range(count)]
    return [header(protocol) + each[0], *each[1:]]


def log_of(tmp_path, packets):
    video = make_video(tmp_path / "v.mp4", range(0, 3000, 40))
    return read_dji_metadata(add_gpmf(video, packets, duration_ms=1000 // RATE_HZ, kind="djmd"))


def median_velocity(log):
    return np.median([sample.velocity for sample in log.velocities], axis=0)


def test_velocity_comes_from_the_places_and_the_height_above_the_start(tmp_path):
    log = log_of(tmp_path, messages())
    assert median_velocity(log) == pytest.approx([NORTH_M_S, EAST_M_S, -UP_M_S], abs=0.03)
    assert len(log.velocities) == 15  # one a fix
    assert not log.counts
    assert log.name == "DJI metadata in the video (Mini4_Pro): 15 velocities from positions"


@pytest.mark.parametrize("protocol", [b"AVATA2", b"dji_neo"])
def test_drones_flown_by_view_tell_it_in_another_nest(tmp_path, protocol):
    log = log_of(tmp_path, messages(protocol, flight=4))
    assert median_velocity(log) == pytest.approx([NORTH_M_S, EAST_M_S, -UP_M_S], abs=0.03)


@pytest.mark.parametrize("protocol", [b"Mavic4", b"Mini5Pro"])
def test_places_are_in_degrees_where_a_model_has_them_so_without_saying_it(tmp_path, protocol):
    found = median_velocity(log_of(tmp_path, messages(protocol, degrees=True, says_so=False)))
    assert found[:2] == pytest.approx([NORTH_M_S, EAST_M_S], abs=0.03)


def test_places_are_in_degrees_where_the_message_says_so(tmp_path):
    found = median_velocity(log_of(tmp_path, messages(b"Air3", degrees=True)))
    assert found[:2] == pytest.approx([NORTH_M_S, EAST_M_S], abs=0.03)


def test_the_camera_looks_where_its_gimbal_says(tmp_path):
    log = log_of(tmp_path, messages(gimbal=(-300, 0, 900)))
    forward = [rotation_from_quaternion(each.world_from_camera)[:, 2] for each in log.attitudes]
    assert len(forward) == 75
    # East, and 30 degrees down.
    assert np.array(forward) == pytest.approx(np.tile([0, np.cos(np.pi / 6), 0.5], (75, 1)), abs=1e-6)
    assert "gimbal attitude" in log.name


def test_a_gimbal_that_looks_north_and_level_writes_no_angle_and_tells_one(tmp_path):
    attitudes = log_of(tmp_path, messages(gimbal=(0, 0, 0))).attitudes
    forward = rotation_from_quaternion(attitudes[0].world_from_camera)[:, 2]
    assert forward == pytest.approx([1, 0, 0], abs=1e-6)


def test_the_drones_own_attitude_comes_along(tmp_path):
    bodies = log_of(tmp_path, messages(drone=(20, -50, -900))).body_attitudes
    nose = rotation_from_quaternion(bodies[0].world_from_body)[:, 0]
    pitch = np.radians(-5)
    assert nose == pytest.approx([0, -np.cos(pitch), -np.sin(pitch)], abs=1e-6)
    assert len(bodies) == 75


def test_each_picture_tells_of_its_own_time(tmp_path):
    assert [each.stamp_ns for each in log_of(tmp_path, messages(gimbal=(0, 0, 10))).attitudes] == [
        index * 40_000_000 for index in range(75)
    ]


def test_where_the_drone_was(tmp_path):
    track = log_of(tmp_path, messages()).places
    first, last = track.places[0], track.places[-1]
    assert first == pytest.approx([48, 11, 80])
    assert last[:2] == pytest.approx(place(74))


def test_without_a_height_above_the_start_that_above_the_sea_counts(tmp_path):
    each = [picture(i + 1, place(i), above_start_mm=None, above_sea_mm=80_000 - 20 * i) for i in range(75)]
    log = log_of(tmp_path, [header(b"Air3s") + each[0], *each[1:]])
    assert median_velocity(log)[2] == pytest.approx(20 * RATE_HZ / 1000, abs=0.03)


def test_pictures_before_the_first_fix_are_counted(tmp_path):
    packets = messages()
    packets[:10] = [header(b"Mini4_Pro") + picture(1, None), *(picture(i + 1, None) for i in range(1, 10))]
    log = log_of(tmp_path, packets)
    assert log.counts[UNFIXED] == 10
    assert JUMPING not in log.counts
    assert min(sample.stamp_ns for sample in log.velocities) >= 400_000_000


def test_a_flight_without_a_fix_is_refused_with_what_to_give_instead(tmp_path):
    packets = [header(b"Mini4_Pro") + picture(1, None), *(picture(i + 1, None) for i in range(1, 75))]
    with pytest.raises(BadInput, match=r"Mini4_Pro.*75 pictures, too few with a position.*--speed"):
        log_of(tmp_path, packets)


def test_damaged_messages_are_dropped_and_counted(tmp_path):
    packets = messages()
    packets[20] = packets[20][:-9]
    packets[30] = b"\xff" * 40
    log = log_of(tmp_path, packets)
    assert log.counts == {"damaged telemetry payloads": 2}
    assert median_velocity(log) == pytest.approx([NORTH_M_S, EAST_M_S, -UP_M_S], abs=0.03)


def test_places_that_are_none_on_earth_are_no_fix(tmp_path):
    packets = messages()
    packets[7] = picture(8, (float("nan"), 11.0))
    packets[8] = picture(9, (48.0, 400.0))
    assert log_of(tmp_path, packets).counts[UNFIXED] == 2


def test_another_track_of_data_is_none(tmp_path):
    assert log_of(tmp_path, [b"\x0a\x0bdbginfo_any" + bytes([i + 1]) * 30 for i in range(75)]) is None


def test_a_folder_has_none(tmp_path):
    assert read_dji_metadata(tmp_path) is None


@pytest.mark.parametrize("seed", range(20))
def test_trash_in_a_message_costs_that_message_at_most(tmp_path, seed):
    rng, packets = np.random.default_rng(seed), messages(gimbal=(-100, 0, 450))
    for index in rng.choice(np.arange(1, 75), 10, replace=False):
        spoilt = bytearray(packets[index])
        spoilt[rng.integers(len(spoilt))] = rng.integers(256)
        packets[index] = bytes(spoilt)
    found = log_of(tmp_path, packets)
    assert np.isfinite([sample.velocity for sample in found.velocities]).all()
    assert median_velocity(found)[:2] == pytest.approx([NORTH_M_S, EAST_M_S], abs=0.2)
