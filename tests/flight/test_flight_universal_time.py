"""Universal time of a flight: leap seconds, what each log tells of it, and that it stays with the frames."""

import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from flight_files import add_gpmf, gps5_payload, gps9_payload, klv, lned_payload, make_video
from hypothesis import given
from hypothesis import strategies as st
from px4_files import position, write_px4_mcap
from pymavlink.DFReader import DFReader_binary
from pymavlink.dialects.v20 import common as mavlink

from flightdepth.errors import BadInput
from flightdepth.flight import Frame, open_flight, read_telemetry
from flightdepth.flight.gpmf_telemetry import KARMA_LATE_NS, read_gpmf
from flightdepth.flight.universal_time import UniversalTime, utc_of_gps_ns, utc_text
from tests_dji_records import airdata, flight_reader, litchi, record, txt_log
from tests_gpx import gopro2gpx, points
from tests_logs import (
    AUTOPILOT,
    GROUND,
    RECEIVED_US,
    START_US,
    dataflash_flight,
    dataflash_fmt,
    dataflash_head,
    heartbeat,
    ned_message,
    px4_gps,
    tlog_flight,
    tlog_part,
    ulog_flight,
    velocity,
    written,
)
from tests_recordings import START_NS, cues, mavic_3, odometry_flight, parrot_csv, write_ros1, write_ros2

# 1 May 2026, 9:30: 56 years of 365 days, 14 leap days and 120 days of 2026 are 20,574 days of 86,400 s, and 34,200 s.
UTC_S = 1_777_627_800
# Since 6 January 1980 (3,657 days) 1,461,663,000 s, and 18 leap seconds: 2,416 weeks of 604,800 s and 466,218 s.
GPS_WEEK, OF_WEEK_MS = 2416, 466_218_000
MS, S = 10**6, 10**9


def test_the_numbers_by_hand_are_those_of_the_calendar():
    assert datetime.fromtimestamp(UTC_S, UTC) == datetime(2026, 5, 1, 9, 30, tzinfo=UTC)


def test_the_time_of_satellites_is_ahead_by_leap_seconds():
    assert utc_of_gps_ns(GPS_WEEK, OF_WEEK_MS + 250) == UTC_S * S + 250 * MS


@pytest.mark.parametrize(
    ("week", "of_week_ms", "utc"),
    [
        (1930, 17_000, "2016-12-31T23:59:60"),  # the leap second itself counts as the second after it
        (1930, 16_000, "2016-12-31T23:59:59"),
        (1930, 18_000, "2017-01-01T00:00:00"),
        (1851, 259_217_000, "2015-07-01T00:00:00"),
        (1695, 16_000, "2012-07-01T00:00:00"),
        (1512, 345_615_000, "2009-01-01T00:00:00"),
    ],
)
def test_leap_seconds_by_the_almanac(week, of_week_ms, utc):
    """IERS, Bulletin C: the satellites were 15, 16, 17, 18 s ahead from these midnights on."""
    second = 59 if utc.endswith("60") else int(utc[-2:])
    moment = datetime.fromisoformat(f"{utc[:-2]}{second:02d}+00:00")
    expected = int(moment.timestamp()) + utc.endswith("60")
    assert utc_of_gps_ns(week, of_week_ms) == expected * S


@given(st.integers(0, 4000), st.integers(0, 7 * 86_400_000 - 2))
def test_time_never_runs_back_but_in_a_leap_second(week, of_week_ms):
    step_ns = utc_of_gps_ns(week, of_week_ms + 1) - utc_of_gps_ns(week, of_week_ms)
    assert step_ns in (MS, MS - S)


def test_a_time_as_text():
    assert utc_text(UTC_S * S + 250_999_999) == "2026-05-01T09:30:00.250Z"


@given(st.integers(-(10**15), 10**15), st.integers(-(10**15), 10**15))
def test_a_moment_stays_when_the_log_is_moved(stamp_ns, offset_ns):
    utc = UniversalTime(UTC_S * S, "satellites")
    assert utc.later_by(offset_ns).at(stamp_ns + offset_ns) == utc.at(stamp_ns)
    assert utc.later_by(offset_ns).later_by(-offset_ns) == utc


@pytest.mark.parametrize("unset", ["1970-01-01", "1980-01-06", "1999-08-22", "2000-01-01", "2099-01-01"])
def test_a_clock_that_nobody_set_tells_nothing(unset):
    told_ns = int(datetime.fromisoformat(f"{unset}T12:00+00:00").timestamp()) * S
    assert UniversalTime.of(told_ns, "computer") is None
    assert UniversalTime.by_readings([(0, told_ns)], "satellites") is None


def test_a_few_damaged_readings_move_nothing():
    sound = [(i * S, (UTC_S + i) * S) for i in range(10)]
    damaged = [(3, 2 * UTC_S * S), (4, 0), (5, UTC_S * S // 2)]
    assert UniversalTime.by_readings(sound + damaged, "satellites") == UniversalTime(UTC_S * S, "satellites")


def utc_of(path):
    log = read_telemetry(path)
    return None if log.utc is None else (log.utc.ns_at_zero, log.utc.clock)


@pytest.mark.parametrize("topic", ["vehicle_gps_position", "sensor_gps"])
def test_px4_by_its_receiver(tmp_path, topic):
    """Time 0 is the first velocity, START_US by PX4's clock; the message came 60 ms after the time that it tells."""
    readings = [
        px4_gps(START_US + i * 200_000 + 60_000, UTC_S * 10**6 + i * 200_000, relative_us=-60_000)
        for i in range(20)
    ]
    log = read_telemetry(written(tmp_path / "a.ulg", ulog_flight(gps=readings, gps_topic=topic)))
    assert (log.utc.ns_at_zero, log.utc.clock) == (UTC_S * S, "satellites")
    assert log.counts == read_telemetry(written(tmp_path / "b.ulg", ulog_flight())).counts
    assert log.digest == read_telemetry(tmp_path / "b.ulg").digest


def test_px4_before_the_fix_tells_nothing(tmp_path):
    cold = [px4_gps(START_US + i * 200_000, 0) for i in range(3)]
    wrong = [px4_gps(START_US + i * 200_000, (UTC_S - 777) * 10**6, fix=0) for i in range(3, 9)]
    assert utc_of(written(tmp_path / "a.ulg", ulog_flight(gps=cold + wrong))) is None
    right = [px4_gps(START_US + 2_000_000, (UTC_S + 2) * 10**6)]
    assert utc_of(written(tmp_path / "a.ulg", ulog_flight(gps=cold + wrong + right))) == (
        UTC_S * S,
        "satellites",
    )


def test_px4_without_a_receiver_tells_none(tmp_path):
    assert utc_of(written(tmp_path / "a.ulg", ulog_flight())) is None


def test_px4_receiver_times_that_are_trash_are_left_out(tmp_path):
    trash = [px4_gps(2**64 - 1, 2**64 - 1), px4_gps(START_US, 2**64 - 1), px4_gps(START_US, 5)]
    assert utc_of(written(tmp_path / "a.ulg", ulog_flight(gps=trash))) is None


ARDUPILOT_GPS = (0x89, "GPS", "QBBIHBcLLeffffB")  # ArduPilot 4.x
GPS_COLUMNS = "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"
GPS_PACKED = struct.Struct("<QBBIHBhiiiffffB")


def ardupilot_gps(stamp_us, of_week_ms, week=GPS_WEEK, *, status=3, receiver=0):
    told = (
        stamp_us,
        receiver,
        status,
        of_week_ms,
        week,
        12,
        80,
        487_000_000,
        22_000_000,
        5000,
        3.0,
        90.0,
        0.0,
        0.0,
        1,
    )
    return b"\xa3\x95\x89" + GPS_PACKED.pack(*told)


def ardupilot_log(readings):
    """The flight of `dataflash_flight`, a reading of the receiver after each of its first steps."""
    number, name, letters = ARDUPILOT_GPS
    fmt = dataflash_fmt(number, name, letters, GPS_COLUMNS, GPS_PACKED.size + 3)
    head, whole = dataflash_head(), dataflash_flight()
    size = (len(whole) - len(head)) // 40
    steps = [whole[at : at + size] for at in range(len(head), len(whole), size)]
    told = [*readings, *[b""] * (40 - len(readings))]
    return head + fmt + b"".join(step + reading for step, reading in zip(steps, told, strict=True))


def test_ardupilot_by_week_and_milliseconds(tmp_path):
    readings = [ardupilot_gps(START_US + i * 100_000, OF_WEEK_MS + i * 100) for i in range(20)]
    path = written(tmp_path / "a.bin", ardupilot_log(readings))
    assert utc_of(path) == (UTC_S * S, "satellites")
    plain = read_telemetry(written(tmp_path / "b.bin", dataflash_flight()))
    log = read_telemetry(path)
    assert (log.digest, log.counts) == (plain.digest, plain.counts)
    assert plain.utc is None


def test_ardupilot_as_pymavlink_tells_it(tmp_path):
    """Its own reader gives each record its time, leap seconds taken off."""
    readings = [ardupilot_gps(START_US + i * 100_000, OF_WEEK_MS + i * 100) for i in range(20)]
    path = written(tmp_path / "a.bin", ardupilot_log(readings))
    reader = DFReader_binary(str(path))
    try:
        first = reader.recv_match(type="XKF1")
        told_s, stamp_us = first._timestamp, first.TimeUS
    finally:
        reader.data_map.close()
        reader.filehandle.close()
    log = read_telemetry(path)
    assert stamp_us == START_US
    assert log.utc.at(log.velocities[0].stamp_ns) / S == pytest.approx(told_s, abs=1e-3)


def test_ardupilot_where_the_receiver_has_no_fix(tmp_path):
    readings = [ardupilot_gps(START_US + i * 100_000, OF_WEEK_MS, status=1) for i in range(9)]
    readings += [ardupilot_gps(START_US, 0, 0)]
    assert utc_of(written(tmp_path / "a.bin", ardupilot_log(readings))) is None


BOOT_MS = START_US // 1000


def told_by_autopilot(utc_s, boot_ms, received_us=RECEIVED_US, source=AUTOPILOT):
    """A flight of 4 s, and each second SYSTEM_TIME, whose clock says `utc_s` at its beginning."""
    parts = [tlog_part(received_us, heartbeat())]
    for i in range(40):
        now_us, now_ms = received_us + i * 100_000, boot_ms + i * 100
        parts.append(tlog_part(now_us, ned_message(now_ms, velocity(i))))
        if i % 10 == 0:
            told = mavlink.MAVLink_system_time_message(utc_s * 10**6 + i * 100_000, now_ms)
            parts.append(tlog_part(now_us, told, source))
    return b"".join(parts)


def test_a_tlog_by_the_autopilots_own_clock(tmp_path):
    path = written(tmp_path / "a.tlog", told_by_autopilot(UTC_S, BOOT_MS))
    assert utc_of(path) == (UTC_S * S, "autopilot")


def test_a_clock_that_does_not_say_when_it_was_costs_no_velocity(tmp_path):
    """Each such time would have begun another power-up."""
    plain = read_telemetry(written(tmp_path / "a.tlog", tlog_flight()))
    silent = mavlink.MAVLink_system_time_message(UTC_S * 10**6, 0)
    at = RECEIVED_US + 2_000_000
    head, tail = tlog_flight(20), tlog_flight(20, boot_ms=BOOT_MS + 2000, received_us=at)
    log = read_telemetry(written(tmp_path / "a.tlog", head + tlog_part(at, silent) + tail))
    assert (len(log.velocities), log.utc.clock) == (len(plain.velocities), "ground station")
    assert log.counts == plain.counts


@pytest.mark.parametrize("unset", [0, 12, 2**64 // 10**6 - UTC_S])
def test_a_tlog_by_the_ground_stations_clock_where_the_autopilots_is_not_set(tmp_path, unset):
    path = written(tmp_path / "a.tlog", told_by_autopilot(unset, BOOT_MS))
    assert utc_of(path) == (RECEIVED_US * 1000, "ground station")


def test_what_a_ground_station_says_of_its_own_clock_is_not_the_autopilots(tmp_path):
    path = written(tmp_path / "a.tlog", told_by_autopilot(UTC_S, BOOT_MS, source=GROUND))
    assert utc_of(path) == (RECEIVED_US * 1000, "ground station")


def test_a_tlog_without_a_clock_of_the_autopilot(tmp_path):
    assert utc_of(written(tmp_path / "a.tlog", tlog_flight())) == (RECEIVED_US * 1000, "ground station")


def test_a_tlog_of_a_clock_that_was_not_set(tmp_path):
    assert utc_of(written(tmp_path / "a.tlog", tlog_flight(received_us=10**9))) is None


def test_a_reboot_within_a_tlog_keeps_the_time(tmp_path):
    """The clock of the autopilot starts anew 40 s later; both parts tell the same time of day."""
    second = told_by_autopilot(UTC_S + 40, 1000, RECEIVED_US + 40 * 10**6)
    log = read_telemetry(written(tmp_path / "a.tlog", told_by_autopilot(UTC_S, BOOT_MS) + second))
    assert log.counts["reboots inside the log"] == 1
    assert (log.utc.ns_at_zero, log.utc.clock) == (UTC_S * S, "autopilot")


GPS_ROWS = np.stack(
    [np.linspace(48, 48.0002, 54), np.full(54, 11.0), np.full(54, 500.0), np.full(54, 7.0), np.full(54, 7.0)],
    axis=1,
)


def gopro(tmp_path, payloads):
    return add_gpmf(make_video(tmp_path / "v.mp4", range(0, 3000, 40)), payloads)


def gpsu(second):
    return klv("GPSU", "U", 16, 1, f"2605010930{second:06.3f}".encode())


def test_a_gopro_by_gpsu(tmp_path):
    """The second payload begins 1 s after the first picture, at 9:30:01.250."""
    payloads = [gps5_payload(GPS_ROWS[i * 18 : i * 18 + 18], beside=gpsu(i + 0.25)) for i in range(3)]
    log = read_gpmf(gopro(tmp_path, payloads))
    assert (log.utc.ns_at_zero, log.utc.clock) == (UTC_S * S + 250 * MS, "satellites")


@pytest.mark.parametrize("told", [b"000000000000.000", b"2605010930??.250", b"260531", b"\0" * 16])
def test_a_gopro_whose_time_is_none(tmp_path, told):
    beside = klv("GPSU", "U", len(told), 1, told)
    payloads = [gps5_payload(GPS_ROWS[i * 18 : i * 18 + 18], beside=beside) for i in range(3)]
    assert read_gpmf(gopro(tmp_path, payloads)).utc is None


def test_a_gopro_without_a_fix_takes_the_time_of_payloads_with_one(tmp_path):
    fixes = [(0, 1000.0), (3, 1.25), (3, 2.25)]
    payloads = [
        gps5_payload(GPS_ROWS[i * 18 : i * 18 + 18], fix=fix, beside=gpsu(second % 60))
        for i, (fix, second) in enumerate(fixes)
    ]
    assert read_gpmf(gopro(tmp_path, payloads)).utc.ns_at_zero == UTC_S * S + 250 * MS


def test_a_gopro_by_gps9(tmp_path):
    """9,617 days from 1 January 2000 to 1 May 2026: 26 years, 7 leap days and 120 days."""
    times = np.arange(54) / 18
    more = np.stack(
        [np.full(54, 26 * 365 + 7 + 120.0), 34_200.25 + times, np.full(54, 1.5), np.full(54, 3)], axis=1
    )
    rows = np.concatenate([GPS_ROWS, more], axis=1)
    log = read_gpmf(gopro(tmp_path, [gps9_payload(rows[i * 18 : i * 18 + 18]) for i in range(3)]))
    assert log.utc.clock == "satellites"
    assert abs(log.utc.ns_at_zero - (UTC_S * S + 250 * MS)) <= MS  # the format rounds to a millisecond


def test_a_karma_alone_tells_none(tmp_path):
    rows = [(1000 + 100 * i, 1.0, 2.0, 3.0) for i in range(10)]
    assert read_gpmf(gopro(tmp_path, [lned_payload(rows)])).utc is None
    assert KARMA_LATE_NS  # its own clock is none of the day


def test_a_gpx_track(tmp_path):
    path = tmp_path / "a.gpx"
    path.write_text(gopro2gpx(points((3.0, 1.0, 0.0))))
    log = read_telemetry(path)
    begun = log.utc.ns_at_zero - UTC_S * S
    assert log.utc.clock == "track"
    assert log.places.stamps_ns[0] == -begun  # the first point was at 9:30
    assert 0 <= begun <= 2 * S


@pytest.mark.parametrize("write", [write_ros1, lambda path, messages: write_ros2(path, messages, "MCAP")])
def test_ros_by_the_stamps(tmp_path, write):
    path = tmp_path / "a.bag"
    write(path, odometry_flight("ros1" if write is write_ros1 else "cdr"))
    assert utc_of(path) == (START_NS, "computer")


def test_ros_of_a_simulation_tells_none(tmp_path, monkeypatch):
    monkeypatch.setattr("tests_recordings.START_NS", 5 * S)
    path = tmp_path / "a.bag"
    write_ros1(path, odometry_flight("ros1"))
    assert utc_of(path) is None


def test_px4s_messages_in_ros(tmp_path):
    path = write_px4_mcap(tmp_path / "a.mcap", [position(i) for i in range(40)])
    assert utc_of(path) == (START_NS, "computer")


def dated(csv_text, rows, column, text_of):
    """A flight record with each row's own time of day in a column."""
    header, *lines = csv_text.splitlines()
    at = header.split(",").index(column)
    made = []
    for line, row in zip(lines, rows, strict=True):
        cells = line.split(",")
        cells[at] = text_of(row.time_s)
        made.append(",".join(cells))
    return "\n".join([header, *made]) + "\n"


def whole_seconds(time_s):
    """As the flight began at 9:29:59.500."""
    return f"{datetime.fromtimestamp(int(UTC_S - 0.5 + time_s + 1e-6), UTC):%Y-%m-%d %H:%M:%S}"


@pytest.mark.parametrize("write", [airdata, litchi])
def test_a_flight_record_by_its_column_of_utc(tmp_path, write):
    """Whole seconds in rows of a tenth: the first row of each second tells it."""
    rows = record(seconds=60.0)
    path = tmp_path / "a.csv"
    path.write_text(dated(write(rows), rows, "datetime(utc)", whole_seconds))
    log = read_telemetry(path)
    first_s = log.velocities[0].stamp_ns / S  # time 0 is the first velocity's
    assert log.utc.clock == "app"
    at_row_0 = log.places.stamps_ns[0]
    assert first_s == 0
    assert log.utc.at(int(at_row_0)) == pytest.approx(UTC_S * S - S // 2, abs=S // 10)


@pytest.mark.parametrize("write", [airdata, flight_reader, txt_log, litchi])
def test_a_flight_record_whose_clock_stands_or_is_local_tells_none(tmp_path, write):
    path = tmp_path / "a.csv"
    path.write_text(write(record()), encoding="utf-8")
    assert utc_of(path) is None


def test_subtitles_have_local_time_of_an_unknown_zone(tmp_path):
    path = tmp_path / "a.srt"
    path.write_text(cues((3.0, 0.0, 0.0), mavic_3))
    assert utc_of(path) is None


def test_parrots_metadata_tell_none(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(parrot_csv((3.0, 0.0, 0.0)))
    assert utc_of(path) is None


def csv_log(path, cells):
    rows = [f"{i / 10:.1f},0,3,0,{cell}" for i, cell in enumerate(cells)]
    path.write_text("\n".join(["time_s,vn_m_s,ve_m_s,vd_m_s,utc_ns", *rows]) + "\n")
    return path


def test_a_csv_by_its_column(tmp_path):
    """To the nanosecond, which a float would round to 256."""
    cells = ["", UTC_S * S + 100 * MS + 7, UTC_S * S + 200 * MS + 7, ""]
    log = read_telemetry(csv_log(tmp_path / "a.csv", cells))
    assert log.utc == UniversalTime(UTC_S * S + 7, "column")
    assert "ignored" not in log.name


@pytest.mark.parametrize("cell", ["1777627800", "1777627800.5e9", "yesterday", "-1", "9" * 19])
def test_a_csv_whose_column_is_no_nanoseconds_is_refused_with_its_line(tmp_path, cell):
    with pytest.raises(BadInput, match=r"line 3.*whole nanoseconds since 1970"):
        read_telemetry(csv_log(tmp_path / "a.csv", ["", cell]))


@pytest.fixture
def flown(tmp_path):
    """A video with a log that knows UTC: that of each frame by its stamp."""
    video = make_video(tmp_path / "v.mp4", range(0, 3000, 40))
    readings = [px4_gps(START_US + i * 200_000, UTC_S * 10**6 + i * 200_000) for i in range(20)]
    log = written(tmp_path / "a.ulg", ulog_flight(gps=readings))

    def call(**options):
        with open_flight(video, log, hfov_deg=80, **options) as flight:
            return {f.stamp_ns: flight.utc.at(f.stamp_ns) for f in flight if isinstance(f, Frame)}

    return call


@pytest.mark.parametrize(("start_s", "end_s"), [(0.5, None), (None, 1.7), (1.0, 2.0)])
def test_a_frames_time_does_not_depend_on_where_the_run_begins_or_ends(flown, start_s, end_s):
    whole, part = flown(), flown(start_s=start_s, end_s=end_s)
    assert 5 < len(part) < len(whole)
    assert part.items() <= whole.items()


@pytest.mark.parametrize("offset_s", [-1.5, 0.25, 0.000000001, 1])
def test_a_frames_time_moves_by_the_offset(flown, offset_s):
    """Added to the log's times: what the log tells at 0 was filmed so much later, so that frames are earlier."""
    plain, moved = flown(), flown(telemetry_offset_s=offset_s)
    assert plain[0] == UTC_S * S
    assert {plain[stamp] - moved[stamp] for stamp in plain} == {round(offset_s * S)}


def test_the_video_and_the_log_are_only_taken_to_begin_together(tmp_path):
    video = make_video(tmp_path / "v.mp4", range(0, 3000, 40))
    log = written(tmp_path / "a.ulg", ulog_flight(gps=[px4_gps(START_US, UTC_S * 10**6)]))
    with open_flight(video, log, hfov_deg=80) as flight:
        assert flight.begun_together
    with open_flight(video, log, hfov_deg=80, telemetry_offset_s=-0.5) as flight:
        assert not flight.begun_together


def test_a_flight_without_a_log_tells_none(tmp_path):
    video = make_video(tmp_path / "v.mp4", range(0, 400, 40))
    with open_flight(video, speed_m_s=5, hfov_deg=80) as flight:
        assert flight.utc is None and not flight.begun_together


def logs_that_tell():
    """Bytes of logs that know the time, by what they are called."""
    px4 = [px4_gps(START_US + i * 200_000, UTC_S * 10**6 + i * 200_000) for i in range(20)]
    pilot = [ardupilot_gps(START_US + i * 100_000, OF_WEEK_MS + i * 100) for i in range(20)]
    return {
        "ulg": ulog_flight(gps=px4),
        "bin": ardupilot_log(pilot),
        "tlog": told_by_autopilot(UTC_S, BOOT_MS),
    }


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", ["ulg", "bin", "tlog"])
def test_trash_is_refused_or_tells_a_time_that_can_be(tmp_path, kind, seed):
    rng = np.random.default_rng(seed)
    data = bytearray(logs_that_tell()[kind])
    for at in rng.integers(len(data) // 8, len(data), 40).tolist():
        data[at] = int(rng.integers(256))
    path = written(tmp_path / "a.log", bytes(data[: int(rng.integers(len(data) // 2, len(data)))]))
    try:
        log = read_telemetry(path)
    except BadInput:
        return
    # A few damaged times do not move the median, but time 0 may be that of a later record, of 4 s.
    assert log.utc is None or log.utc.clock == "ground station" or abs(log.utc.ns_at_zero - UTC_S * S) < 5 * S
