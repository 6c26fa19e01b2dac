import re

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.dji_srt import read_dji_srt
from flightdepth.flight.records import AttitudeSample, VelocitySample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion
from tests_recordings import DJI_LAYOUTS, clock, cues, matrice_30, mavic_3, mavic_pro, mini_2, phantom_4_rtk

VELOCITY = (3.0, -4.0, 0.5)


def read(tmp_path, text, name="flight.srt"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_telemetry(path)


def of_kind(telemetry, kind):
    return [sample for sample in telemetry.samples if isinstance(sample, kind)]


def velocity_table(telemetry):
    return np.array([sample.velocity for sample in of_kind(telemetry, VelocitySample)])


@pytest.mark.parametrize("layout", DJI_LAYOUTS)
def test_a_constant_velocity_comes_back_from_each_layout(tmp_path, layout):
    body, rate, fixes = DJI_LAYOUTS[layout]
    telemetry = read(tmp_path, cues(VELOCITY, body, seconds=20, rate=rate, fixes_per_s=fixes))
    found = velocity_table(telemetry)
    assert np.abs(np.median(found, axis=0) - VELOCITY).max() < 0.05
    assert np.abs(found - VELOCITY)[2:-2].max() < 0.3
    assert telemetry.counts == {}


@pytest.mark.parametrize(
    ("focal_len", "degrees"), [("24.00", 71.6), ("240", 71.6), ("162.00", 12.2), ("24", 71.6), ("1620", 12.2)]
)
def test_a_focal_length_in_tenths_has_no_decimals(tmp_path, focal_len, degrees):
    text = cues(VELOCITY, mavic_3, seconds=3, rate=30, fixes_per_s=5).replace("24.00", focal_len)
    assert read(tmp_path, text).view.horizontal_deg == pytest.approx(degrees, abs=0.1)


def test_a_first_fix_that_is_stale_changes_no_scale(tmp_path):
    """Metres per degree of longitude follow from the latitude."""
    text = cues(VELOCITY, mavic_3, seconds=20, rate=30, fixes_per_s=5)
    first = re.search(r"latitude: *([-0-9.]+)", text)[1]
    found = velocity_table(read(tmp_path, text.replace(first, "10.000000", 1)))
    assert np.abs(np.median(found, axis=0) - VELOCITY).max() < 0.05


def test_times_are_those_of_the_cues_at_which_the_position_changed(tmp_path):
    telemetry = read(tmp_path, cues(VELOCITY, mavic_3, seconds=3, rate=30, fixes_per_s=5))
    stamps = [sample.stamp_ns for sample in of_kind(telemetry, VelocitySample)]
    assert np.diff(stamps).tolist() == pytest.approx([200_000_000] * (len(stamps) - 1), abs=1)


def test_hours_and_minutes_count(tmp_path):
    text = cues(VELOCITY, mavic_3, seconds=3, rate=30, fixes_per_s=5)
    soon, late = (read(tmp_path, each).samples for each in (text, text.replace("00:00:", "12:34:")))
    later_ns = (12 * 3600 + 34 * 60) * 10**9
    assert [each.stamp_ns for each in late] == [each.stamp_ns + later_ns for each in soon]


def test_a_last_subtitle_that_may_have_lost_digits_is_left_out(tmp_path):
    text = cues(VELOCITY, mavic_3, seconds=3, rate=30, fixes_per_s=5)
    telemetry = read(tmp_path, text)
    cut = read(tmp_path, text.rstrip()[:-8])
    assert telemetry.counts == {}
    assert cut.counts == {"subtitles cut off at the end": 1}
    assert len(cut.view.stamps_ns) == len(telemetry.view.stamps_ns) - 1
    np.testing.assert_allclose(velocity_table(cut)[:10], velocity_table(telemetry)[:10], atol=0.1)


def test_the_error_is_told_and_holds(tmp_path):
    telemetry = read(tmp_path, cues(VELOCITY, mavic_3, seconds=20))
    sigmas = np.array([sample.sigma for sample in of_kind(telemetry, VelocitySample)])
    errors = np.abs(velocity_table(telemetry) - VELOCITY).max(axis=1)
    assert (sigmas > 0).all()
    assert 0.3 < np.sqrt((errors**2).mean()) / sigmas.mean() < 2
    assert (errors < 4 * sigmas).mean() > 0.95


def test_gimbal_angles_are_yaw_from_north_and_pitch_up(tmp_path):
    # Yaw 90: looks east; pitch -30: down by 30 degrees; roll 0: its right is south.
    for body in (mavic_3, phantom_4_rtk):
        samples = of_kind(read(tmp_path, cues(VELOCITY, body)), AttitudeSample)
        axes = rotation_from_quaternion(samples[0].world_from_camera)
        assert np.allclose(axes[:, 2], (0, np.cos(np.pi / 6), np.sin(np.pi / 6)), atol=1e-9)
        assert np.allclose(axes[:, 0], (-1, 0, 0), atol=1e-9)


def test_the_drone_s_own_speeds_are_used(tmp_path):
    def coarse(drone):  # positions of 11 m cannot tell 5.00 m/s
        [line] = phantom_4_rtk(drone)
        return [line.replace(f"{drone.lon:.6f}, {drone.lat:.6f}", f"{drone.lon:.4f}, {drone.lat:.4f}")]

    found = velocity_table(read(tmp_path, cues(VELOCITY, coarse, seconds=60, rate=1, fixes_per_s=1)))
    assert np.allclose(np.linalg.norm(found[:, :2], axis=1), 5.0, atol=0.01)
    assert np.allclose(found[:, 2], 0.5)


def test_speeds_along_two_axes_are_used_whichever_is_north(tmp_path):
    text = cues(VELOCITY, matrice_30, seconds=10)
    found = velocity_table(read(tmp_path, text))
    assert np.linalg.norm(found[:, :2], axis=1) == pytest.approx(5.0, abs=1e-9)
    assert found[:, 2] == pytest.approx(0.5)
    assert np.abs(found - VELOCITY).max() < 0.5  # the directions are those of the positions


def test_positions_that_seldom_change_leave_no_gaps(tmp_path):
    """A Mini 2 rounds to 11 m: most frames of such a flight had no velocity within 1.5 s."""
    found = of_kind(read(tmp_path, cues((3.0, -1.0, 0.0), mini_2, seconds=60, rate=1)), VelocitySample)
    assert np.diff([sample.stamp_ns for sample in found]).max() <= 1.25e9
    assert found[-1].stamp_ns - found[0].stamp_ns > 50e9
    errors = np.array([sample.velocity for sample in found])[5:-5] - (3.0, -1.0, 0.0)
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.5


def test_a_slow_drone_whose_rounded_position_stands_still_keeps_its_speed(tmp_path):
    text = cues((3.0, -4.0, 0.0), mini_2, seconds=30, rate=1)
    slow = re.sub(r"H\.S [\d.]+", "H.S 0.80", text.rstrip().splitlines()[-1])
    text += "".join(f"{i + 1}\n{clock(i)} --> {clock(i + 1)}\n{slow}\n\n" for i in range(30, 42))
    found = of_kind(read(tmp_path, text), VelocitySample)
    late = np.array([sample.velocity for sample in found if sample.stamp_ns > 36e9])
    assert len(late) >= 4
    assert np.linalg.norm(late, axis=1) == pytest.approx(0.8)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_the_vertical_speed_is_that_of_the_heights(tmp_path, sign):
    def written(drone):
        [line] = phantom_4_rtk(drone)
        return [line.replace(f"V.S {drone.down:.2f}", f"V.S {sign * drone.down:.2f}")]

    found = velocity_table(read(tmp_path, cues(VELOCITY, written, seconds=20, rate=1, fixes_per_s=1)))
    assert np.allclose(found[:, 2], 0.5)


def test_south_of_the_equator_and_beyond_90_degrees_east_the_order_is_seen(tmp_path):
    # GPS(lat, lon) without a height as third number: only 149 can be no latitude.
    def swapped(drone):
        return [f"GPS({drone.lat - 68.9:.6f},{drone.lon + 146.8:.6f},16) BAROMETER:{drone.height:.1f}"]

    found = velocity_table(read(tmp_path, cues((3.0, 0.0, 0.0), swapped, seconds=20, rate=1, fixes_per_s=1)))
    assert np.abs(np.median(found, axis=0) - (3, 0, 0)).max() < 0.1


@pytest.mark.parametrize(("east_west", "north_south"), [("E", "N"), ("W", "N"), ("E", "S"), ("W", "S")])
def test_autels_hemispheres_turn_the_sign_and_its_height_counts(tmp_path, east_west, north_south):
    """West was flown as east, of 8 degrees east longitude was taken for latitude, and no climb was seen."""
    signs = (1 if north_south == "N" else -1), (1 if east_west == "E" else -1)

    def autel(drone):
        return [
            f"HOME({east_west}: 2.200000, {north_south}: 48.900000) 2025-08-27 13:21:35",
            f"GPS({east_west}: {drone.lon:.6f}, {north_south}: {drone.lat:.6f}, {drone.height:.2f}m)",
            "ISO:100 SHUTTER:400 EV:0.0 F-NUM:2.8",
            "F.PRY (0.6°, 1.2°, -31.2°), G.PRY (-40.3°, 0.0°, -31.2°)",
        ]

    telemetry = read(tmp_path, cues(VELOCITY, autel, seconds=20, rate=1, fixes_per_s=1))
    flown = np.array(VELOCITY) * (*signs, 1)
    assert np.abs(np.median(velocity_table(telemetry), axis=0) - flown).max() < 0.1
    assert len(of_kind(telemetry, AttitudeSample)) == 20


def test_windows_lines_and_utf16_are_read(tmp_path):
    text = cues(VELOCITY, mavic_3, newline="\r\n")
    path = tmp_path / "flight.srt"
    path.write_bytes(text.encode("utf-16"))
    assert np.abs(velocity_table(read_dji_srt(path)) - VELOCITY).max() < 0.3


def test_cues_before_the_first_fix_are_counted(tmp_path):
    def unfixed(drone):
        return mavic_pro(drone) if drone.index >= 5 else ["GPS(0.0000,0.0000,0) BAROMETER:0.0"]

    telemetry = read(tmp_path, cues(VELOCITY, unfixed, seconds=20, rate=1, fixes_per_s=1))
    assert telemetry.counts == {"subtitles without a position": 5}


def test_subtitles_of_a_film_are_refused_with_the_reason(tmp_path):
    text = "1\n00:00:01,000 --> 00:00:02,000\nHello.\n\n2\n00:00:03,000 --> 00:00:04,000\nBye.\n"
    with pytest.raises(BadInput, match=r"DJI subtitles with two GPS positions or more, got 2 subtitles"):
        read(tmp_path, text)


def test_a_text_without_a_subtitle_is_refused_by_its_reader(tmp_path):
    """It ended in a traceback."""
    path = tmp_path / "none.srt"
    path.write_text("hello\n")
    with pytest.raises(BadInput, match=r"DJI subtitles with two GPS positions or more, got 0 subtitles"):
        read_dji_srt(path)


def test_the_name_of_the_file_does_not_matter(tmp_path):
    assert read(tmp_path, cues(VELOCITY, mavic_3), "flight.csv").name.startswith("DJI subtitles")
