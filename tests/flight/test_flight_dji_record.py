"""DJI flight records as CSV: velocities, attitudes and times of a known flight come back from each layout."""

import re

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.records import Recording
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion
from tests_dji_records import (
    DJI_RECORDS,
    MPH,
    START_S,
    airdata,
    flight_reader,
    record,
    steady,
    txt_log,
    weaving,
)

LAYOUTS = pytest.mark.parametrize("layout", DJI_RECORDS)


def read(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "flight.log"  # the reader must not depend on names
    path.write_bytes(text.encode(encoding))
    return read_telemetry(path)


def velocity_table(telemetry):
    """Seconds since the first velocity [n], velocities [n, 3]."""
    samples = telemetry.velocities
    return np.array([each.stamp_ns for each in samples]) / 1e9, np.array([each.velocity for each in samples])


def forward(samples):
    """Where cameras look: north, east, down [n, 3]."""
    return np.array([rotation_from_quaternion(each.world_from_camera)[:, 2] for each in samples])


@LAYOUTS
def test_velocities_come_back_as_exact_as_they_are_written(tmp_path, layout):
    telemetry = read(tmp_path, DJI_RECORDS[layout](record()))
    time_s, found = velocity_table(telemetry)
    assert telemetry.counts == {}
    assert time_s == pytest.approx(np.arange(600) / 10, abs=1e-6)
    assert np.abs(found - weaving(time_s)).max() < 0.051
    assert "600 velocities from its speeds" in telemetry.name
    assert "(" not in telemetry.name  # DJI's own axes


@LAYOUTS
def test_the_error_is_told_and_is_not_less_than_the_rounding(tmp_path, layout):
    samples = read(tmp_path, DJI_RECORDS[layout](record())).velocities
    errors = np.array([each.velocity - weaving(np.array([each.stamp_ns / 1e9]))[0] for each in samples])
    sigmas = np.array([each.sigma for each in samples])
    assert sigmas.min() > 0.028  # 0.1 m/s / 12^0.5
    assert sigmas.max() < 0.15
    assert errors.std() < sigmas.mean() * 1.05


def test_a_speed_that_is_late_is_less_sure(tmp_path):
    late = record()
    speeds = [row.speeds for row in late]
    for row, old in zip(late[5:], speeds, strict=False):
        row.speeds = old  # half a second
    sigma = read(tmp_path, airdata(late)).velocities[0].sigma
    assert 0.15 < sigma < 0.6


@LAYOUTS
def test_the_gimbal_tells_the_camera_and_the_body_is_kept_apart(tmp_path, layout):
    telemetry = read(tmp_path, DJI_RECORDS[layout](record(yaw_at=lambda time_s: 90 + 0 * time_s)))
    axes = rotation_from_quaternion(telemetry.attitudes[0].world_from_camera)
    assert np.allclose(axes[:, 2], (0, np.cos(np.pi / 6), np.sin(np.pi / 6)), atol=1e-9)  # east, 30 down
    assert np.allclose(axes[:, 0], (-1, 0, 0), atol=1e-9)  # its right is south
    body = rotation_from_quaternion(telemetry.body_attitudes[0].world_from_body)
    assert body[:, 0] == pytest.approx((0, np.cos(np.deg2rad(8.5)), np.sin(np.deg2rad(8.5))), abs=0.02)
    assert body[2, 1] > 0.01  # rolled to the right: its right side is down
    assert len(telemetry.body_attitudes) == 600


@LAYOUTS
def test_recordings_are_told(tmp_path, layout):
    log = record(recordings=((10, 25), (40, 50)))
    assert read(tmp_path, DJI_RECORDS[layout](log)).recordings == (
        Recording(10_050_000_000, 24_950_000_000),
        Recording(40_050_000_000, 49_950_000_000),
    )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_degree_signs_and_marks_of_order_do_no_harm(tmp_path, encoding):
    telemetry = read(tmp_path, flight_reader(record()), encoding)
    assert len(telemetry.velocities) == 600


def test_a_gimbal_that_starts_anywhere_is_put_right_by_the_nose_that_it_follows(tmp_path):
    """A Mini 2's yaw was 36 degrees off, and flight seen as going aside where it went ahead."""
    telemetry = read(tmp_path, airdata(record(gimbal_off=36)))
    found = forward(telemetry.attitudes)
    yaw_deg = np.rad2deg(np.unwrap(np.arctan2(found[:, 1], found[:, 0])))
    assert yaw_deg == pytest.approx(20 + 3 * np.arange(600) / 10, abs=0.2)
    assert "its yaw turned by +36 deg to the drone's, which it follows" in telemetry.name


@pytest.mark.parametrize(
    ("off", "mode"), [(36, "Free"), (100, "Follow Yaw"), (lambda time_s: time_s * 2, "Follow Yaw")]
)
def test_a_gimbal_that_was_turned_aside_keeps_its_own_heading(tmp_path, off, mode):
    log = record(yaw_at=lambda time_s: 20 + 0 * time_s)
    for row in log:
        row.gimbal_yaw = 20 - (off(row.time_s) if callable(off) else off)
    telemetry = read(tmp_path, flight_reader(log, mode=mode))
    told = np.deg2rad([round(row.gimbal_yaw, 1) for row in log])
    found = forward(telemetry.attitudes)
    assert np.arctan2(found[:, 1], found[:, 0]) == pytest.approx(
        (told + np.pi) % (2 * np.pi) - np.pi, abs=1e-3
    )


def test_a_gimbal_in_fpv_mode_follows_too(tmp_path):
    """DJI's FPV mode turns the camera with the drone, and rolls it too."""
    telemetry = read(tmp_path, flight_reader(record(gimbal_off=36), mode="FPV"))
    assert "its yaw turned by +36 deg" in telemetry.name


@pytest.mark.parametrize("aside_deg", [45, 180])
def test_moments_in_which_a_gimbal_looks_aside_are_kept(tmp_path, aside_deg):
    """They were turned to the nose; a yaw that flips beyond straight down, with a roll of 180, upside down."""
    log = record(seconds=200, yaw_at=lambda time_s: 20 + 0 * time_s, gimbal_off=12)
    for row in log[900:1200]:
        row.gimbal_yaw += aside_deg
    found = forward(read(tmp_path, airdata(log)).attitudes)
    yaw_deg = np.rad2deg(np.arctan2(found[:, 1], found[:, 0])) % 360
    expected = np.where((np.arange(2000) >= 900) & (np.arange(2000) < 1200), 20 + aside_deg, 20)
    assert yaw_deg == pytest.approx(expected, abs=0.2)


def test_a_log_whose_gimbal_tells_nothing_has_no_camera_attitude(tmp_path):
    log = record(gimbal_pitch=0)
    for row in log:
        row.gimbal_yaw = 0
    telemetry = read(tmp_path, airdata(log))
    assert not telemetry.attitudes
    assert len(telemetry.body_attitudes) == 600


@pytest.mark.parametrize("speed_m_s", [0.0, 0.3])
def test_a_drone_that_hovers_all_the_time_is_as_sure_of_its_speeds(tmp_path, speed_m_s):
    """No instant is fast enough to tell of the axes, nor of the error: all are taken."""
    telemetry = read(tmp_path, airdata(record(steady((speed_m_s, 0.0, 0.0)))))
    assert velocity_table(telemetry)[1] == pytest.approx(np.tile((speed_m_s, 0, 0), (600, 1)), abs=1e-4)
    assert all(0 <= sample.sigma < 0.1 for sample in telemetry.velocities)
    assert "from its speeds" in telemetry.name


def test_positions_overrule_other_axes(tmp_path):
    """AirData's manual calls x east; its files of DJI's drones say north. Others may do as the manual says."""
    log = record()
    for row in log:
        row.speeds = row.speeds[[1, 0, 2]] * (1, 1, -1)
    time_s, found = velocity_table(telemetry := read(tmp_path, airdata(log)))
    assert np.abs(found - weaving(time_s)).max() < 0.051
    assert "(x is east) (z is up)" in telemetry.name


@pytest.mark.parametrize("factor", [0.0, 1 / MPH])
def test_speeds_that_positions_deny_are_left_for_the_positions(tmp_path, factor):
    log = record()
    for row in log:
        row.speeds = row.speeds * factor  # all zero, or in another unit than the header says
    telemetry = read(tmp_path, airdata(log))
    time_s, found = velocity_table(telemetry)
    assert "from positions" in telemetry.name
    assert np.abs(found - weaving(time_s))[10:-10].max() < 0.3


def test_without_columns_of_speeds_the_positions_tell(tmp_path):
    text = re.sub(r"[xyz]Speed\(mph\)", "other", airdata(record()))
    time_s, found = velocity_table(telemetry := read(tmp_path, text))
    assert "from positions" in telemetry.name
    assert np.abs(found - weaving(time_s))[10:-10].max() < 0.3


def test_without_a_fix_the_speeds_still_tell(tmp_path):
    log = record(steady((3.0, -4.0, 0.5)))
    for row in log:
        row.lat = row.lon = 0.0
    telemetry = read(tmp_path, airdata(log))
    assert velocity_table(telemetry)[1] == pytest.approx(np.tile((3, -4, 0.5), (600, 1)), abs=1e-4)
    assert telemetry.counts == {"rows without a position": 600}


def test_what_is_left_out_is_counted_by_kind(tmp_path):
    log = record()
    log[5].speeds = np.array([np.nan, 1, 1])
    log[6].speeds = np.array([1, 400, 1])
    log[7].lat += 1
    log[20].time_s = log[18].time_s
    lines = airdata(log).splitlines()
    lines[31] = lines[31].replace("P-GPS,", "", 1)
    lines[41] = lines[41].replace("4000,", "x,", 1)
    telemetry = read(tmp_path, "\n".join(lines))
    assert telemetry.counts == {
        "rows without a speed": 1,
        "velocities above 150 m/s": 1,
        "positions that jump": 1,
        "rows not later than the one before": 1,
        "rows of another number of cells than the header": 1,
        "rows without a time": 1,
        "last lines without an end: cut off": 1,
    }
    assert len(velocity_table(telemetry)[0]) == 600 - 6


def test_rows_that_repeat_while_moving_are_left_out(tmp_path):
    log = record(steady((3.04, -4.0, 0.0)))
    for row in log[200:300]:
        row.lat, row.lon, row.height_m = log[200].lat, log[200].lon, log[200].height_m
    telemetry = read(tmp_path, airdata(log))
    assert telemetry.counts == {"rows that repeat while moving": 79}
    steady_log = read(tmp_path, airdata(record(steady((3.04, -4.0, 0.0)))))
    assert steady_log.counts == {}


def test_a_time_in_flight_that_stands_on_the_ground_gives_way_to_the_clock(tmp_path):
    """It counts from when the motors start: a video begun before would have begun with them."""
    log = record(recordings=((10, 50),))
    flown = [max(0.0, round(row.time_s - 20, 1)) for row in log]
    lines = txt_log(log).splitlines()
    parted = [line.split(",") for line in lines]
    for cells, seconds in zip(parted[1:], flown, strict=True):
        cells[13] = str(seconds)
    telemetry = read(tmp_path, "\n".join(map(",".join, parted)) + "\n")
    assert telemetry.counts == {}
    assert telemetry.recordings == (Recording(10_050_000_000, 49_950_000_000),)


def clocked(start_s, change):
    """A log of a minute that begins at a time of the day and tells no time in flight; `change` alters each clock."""
    log = record(start_s=start_s - START_S, recordings=())
    text = txt_log(log).replace("OSD.flyTime [s]", "other")
    return re.sub(
        r"2018/07/04 (\d+):(\d+):([\d.]+)", lambda clock: change(int(clock[1]), clock[2], clock[3]), text
    )


@pytest.mark.parametrize(
    ("start_h", "change"),
    [
        (24, lambda hours, minutes, seconds: f"2018/07/04 {hours % 24:02}:{minutes}:{seconds}"),
        (
            24,
            lambda hours, minutes, seconds: (
                "" if hours == 23 and seconds > "58" else f"{hours % 24}:{minutes}:{seconds}"
            ),
        ),
        (
            12,
            lambda hours, minutes, seconds: (
                f"{hours}:{minutes}:{seconds} {'a' if hours < 12 else 'p'}.\u00a0m."
            ),
        ),
        (13, lambda hours, minutes, seconds: f"{hours - 12 or 12}:{minutes}:{seconds} PM"),
        (13, lambda hours, minutes, seconds: f"{(hours - 1) % 12 + 1}:{minutes}:{seconds}"),
    ],
    ids=["midnight", "rows without a clock at midnight", "noon", "one o'clock", "one o'clock of half a day"],
)
def test_a_clock_runs_on(tmp_path, start_h, change):
    telemetry = read(tmp_path, clocked(start_h * 3600 - 30, change))
    left_out = telemetry.counts.get("rows without a time", 0)
    expected = np.delete(np.arange(600) / 10, range(300 - left_out, 300))
    assert velocity_table(telemetry)[0] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("cell", "hours"),
    [("2:22:59 PM", 14), ("2:22:59,5 p. m.", 14), ("12:22:59 am", 0), ("12:22:59 p.m.", 12)],
)
def test_the_log_s_clock_is_told_in_hours_of_the_day(tmp_path, cell, hours):
    header, row, *_ = clocked(0, lambda *_: cell.replace(",", ".")).splitlines()
    later = row.replace(":59", ":58")
    name = read(tmp_path, f"{header}\n{later}\n{row}\n").name
    assert f"{hours * 3600 + 22 * 60 + 58}." in name


def test_a_record_that_tells_no_flight_says_what_it_lost(tmp_path):
    log = record(seconds=3)
    for row in log:
        row.speeds, row.lat, row.lon = np.full(3, np.nan), 0, 0
    with pytest.raises(BadInput, match=r"got none \(30 rows without a position\)"):
        read(tmp_path, airdata(log))
    with pytest.raises(BadInput, match=r"got none$"):
        read(tmp_path, airdata([]))


def test_a_row_with_a_cell_beyond_reason_is_left_out(tmp_path):
    """The csv module raises where a cell is longer than 128 KiB."""
    header, *rows = airdata(
        record(),
    ).splitlines()
    rows[5] += "x" * 200_000
    telemetry = read(tmp_path, "\n".join([header, *rows, ""]))
    assert telemetry.counts == {"rows of another number of cells than the header": 1}


def test_a_record_that_is_still_encrypted_is_named(tmp_path):
    path = tmp_path / "DJIFlightRecord_2024-05-01_[10-00-00].txt"
    path.write_bytes(bytes([100, 0x80, 0x42, 0, 0, 0, 0, 0, 0xB0, 1, 13, 0]) + bytes(range(256)) * 20)
    with pytest.raises(BadInput, match=r"DJI's encrypted flight record: AirData .* decode it to CSV"):
        read_telemetry(path)


def test_other_tables_are_no_flight_records(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text("time(millisecond),latitude,longitude,name\n0,48.7,2.2,a\n")
    with pytest.raises(BadInput, match="one time column and one set of velocity columns"):
        read_telemetry(path)
