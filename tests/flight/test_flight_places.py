"""Where on Earth a drone was: the track between fixes, and what each format tells of it."""

import json
import struct
from collections import Counter

import numpy as np
import pytest
from flight_files import add_gpmf, gps5_payload, gps9_payload, klv, lned_payload, make_video, nest
from hypothesis import given
from hypothesis import strategies as st
from px4_files import global_position, of_ros, write_px4
from px4_files import position as px4_velocity
from pymavlink.dialects.v20 import common as mavlink
from pyproj import Geod

from flightdepth.flight.gpmf_telemetry import KARMA_LATE_NS, read_gpmf
from flightdepth.flight.places import ELLIPSOID, SEA_LEVEL, PlaceTrack
from flightdepth.flight.positions import place_track
from flightdepth.flight.telemetry import read_telemetry
from tests_dji_records import airdata, flight_reader, record, txt_log
from tests_logs import (
    DATAFLASH,
    LOCAL_POSITION,
    RECEIVED_US,
    START_US,
    dataflash_fmt,
    dataflash_head,
    heartbeat,
    local_position,
    ned_message,
    tlog_part,
    ulog_bytes,
    velocity,
    written,
    xkf1,
)
from tests_recordings import (
    DJI_LAYOUTS,
    Messages,
    cues,
    mavic_3,
    mavic_pro,
    parrot_csv,
    parrot_json,
    place,
    write_mcap,
)

S = 10**9
COUNT = 30
NORTH_M_S, EAST_M_S = 3.0, -4.0
ALTITUDE_M = 312.5


def where(i):
    """Latitude, longitude and altitude at i / 10 s."""
    return (*place(NORTH_M_S * i / 10, EAST_M_S * i / 10), ALTITUDE_M + i / 8)


def tells(track, above, *, altitudes=True, start_ns=0, degrees=2e-7):
    """Whether a track is the flight above, `degrees` off at most: 1e-7 are 1 cm."""
    assert track is not None
    assert track.above == (above if altitudes else None)
    for i in range(2, COUNT - 2):
        latitude, longitude, altitude = track.at(start_ns + i * S // 10)
        assert (latitude, longitude) == pytest.approx(where(i)[:2], abs=degrees)
        if altitudes:
            assert altitude == pytest.approx(where(i)[2], abs=0.01)
        else:
            assert np.isnan(altitude)


# The track


def track_of(*rows, above=SEA_LEVEL):
    stamps, *columns = zip(*rows, strict=True)
    return PlaceTrack(np.array(stamps, dtype=np.int64), np.array(columns, dtype=float).T, above)


def test_between_two_fixes_it_goes_straight():
    track = track_of((0, 48.0, 11.0, 500.0), (S, 48.001, 11.002, 510.0))
    assert track.at(S // 4) == pytest.approx((48.00025, 11.0005, 502.5))
    assert track.at(S) == pytest.approx((48.001, 11.002, 510.0))


def test_beyond_its_ends_and_across_a_long_gap_nothing_is_known():
    track = track_of((S, 48.0, 11.0, 500.0), (7 * S, 48.1, 11.1, 500.0))
    assert all(np.isnan(track.at(stamp_ns)).all() for stamp_ns in (0, 4 * S, 8 * S))


def test_the_date_line_is_crossed_the_short_way():
    """As numbers, the middle of 179.999 and -179.999 is 0: on the other side of the Earth."""
    track = track_of((0, -17.0, 179.9995, 5.0), (S, -17.0, -179.9985, 5.0))
    assert track.at(S // 10)[1] == pytest.approx(179.9997)
    assert track.at(S // 2)[1] == pytest.approx(-179.9995)


@given(st.integers(-(2**60), 2**60), st.integers(0, S))
def test_a_clock_that_is_moved_moves_all(offset_ns, stamp_ns):
    track = track_of((0, 48.0, 11.0, 500.0), (S, 48.001, 11.002, 510.0))
    assert track.later_by(offset_ns).at(stamp_ns + offset_ns) == pytest.approx(track.at(stamp_ns))


def told(places_deg, altitudes_m=None, *, rate=10, counts=None):
    places_deg = np.asarray(places_deg, dtype=float)
    stamps = [i * S // rate for i in range(len(places_deg))]
    altitudes = np.full(len(places_deg), 5.0) if altitudes_m is None else np.asarray(altitudes_m)
    return place_track(stamps, places_deg, altitudes, SEA_LEVEL, Counter() if counts is None else counts)


def test_positions_that_repeat_until_the_next_fix_do_not_lag():
    """A camera writes the last fix with each picture: half a second late on the mean, where fixes come each second."""
    steps = [(48 + i // 10 * 1e-5, 11.0) for i in range(60)]
    track = told(steps)
    assert track.at(25 * S // 10)[0] == pytest.approx(48 + 2.5e-5, abs=1e-9)


def test_no_place_on_earth_is_left_out_and_one_that_jumps_counted():
    way = [(48 + i * 1e-6, 11.0) for i in range(20)]
    way[0], way[5], way[9], way[13] = (0, 0), (np.nan, 11), (91, 11), (49, 11)
    counts = Counter()
    track = told(way, counts=counts)
    assert len(track.stamps_ns) == 16
    assert counts == {"positions that jump": 1}
    assert track.at(5 * S // 10)[0] == pytest.approx(48 + 5e-6, abs=1e-9)


@pytest.mark.parametrize("way", [[], [(48, 11)], [(0, 0)] * 9, [(np.nan, np.nan)] * 9])
def test_fewer_than_two_fixes_are_no_track(way):
    assert told(np.reshape(way, (-1, 2))) is None


def test_an_altitude_that_is_told_now_and_then_counts_from_where_it_counts():
    way = [(48 + i * 1e-6, 11.0) for i in range(20)]
    track = told(way, [np.nan] * 19 + [5.0])
    assert track.above == SEA_LEVEL
    assert np.isfinite(track.places[:, 2]).tolist() == [False] * 19 + [True]


def test_an_altitude_that_is_never_told_counts_from_nowhere():
    assert told([(48 + i * 1e-6, 11) for i in range(9)], np.full(9, np.nan)).above is None


def test_the_helper_of_these_tests_agrees_with_pyproj():
    geod = Geod(ellps="WGS84")
    (lat, lon), (there_lat, there_lon) = place(0, 0), place(9, -12)
    azimuth, _, distance = geod.inv(lon, lat, there_lon, there_lat)
    assert (distance, azimuth) == pytest.approx((15, np.degrees(np.arctan2(-12, 9))), abs=1e-3)


# The formats


GLOBAL = (
    "vehicle_global_position:uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;float alt;"
    "float alt_ellipsoid;"
)
VALID = GLOBAL + "bool lat_lon_valid;bool alt_valid;uint8_t[6] _padding0;"


@pytest.mark.parametrize("newer", [False, True])
def test_px4(tmp_path, newer):
    data = []
    for i in range(COUNT):
        stamp = START_US + i * 100_000
        bad = newer and i in (11, 12)  # what PX4 itself does not trust
        body = struct.pack("<QQdd2f", stamp + 900, stamp, *((1, 1, 1) if bad else where(i)), 0)
        data += [
            (0, local_position(stamp, velocity(i))),
            (1, body + (bytes([not bad] * 2) if newer else b"")),
        ]
    topics = [(0, 0, "vehicle_local_position"), (0, 1, "vehicle_global_position")]
    log = read_telemetry(
        written(tmp_path / "a.ulg", ulog_bytes([LOCAL_POSITION, VALID if newer else GLOBAL], topics, data))
    )
    tells(log.places, SEA_LEVEL)
    assert log.true_north
    assert log.counts == ({"positions marked invalid": 2} if newer else {})


def test_a_position_before_the_first_velocity_moves_no_clock(tmp_path):
    data = [(1, struct.pack("<QQdd2f", START_US - 700_000, START_US - 700_000, *where(-7), 0))]
    for i in range(COUNT):
        stamp = START_US + i * 100_000
        data += [(0, local_position(stamp, velocity(i)))]
        data += [(1, struct.pack("<QQdd2f", stamp, stamp, *where(i), 0))]
    topics = [(0, 0, "vehicle_local_position"), (0, 1, "vehicle_global_position")]
    log = read_telemetry(written(tmp_path / "a.ulg", ulog_bytes([LOCAL_POSITION, GLOBAL], topics, data)))
    assert log.samples[0].stamp_ns == 0
    tells(log.places, SEA_LEVEL)


def test_ardupilot(tmp_path):
    letters, columns = "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"
    parts = [dataflash_head(list(DATAFLASH)), dataflash_fmt(0x90, "POS", letters, columns)]
    for i in range(COUNT):
        stamp, (latitude, longitude, altitude) = START_US + i * 100_000, where(i)
        packed = struct.pack(
            "<Qiifff", stamp, round(latitude * 1e7), round(longitude * 1e7), altitude, 12, 12
        )
        parts += [xkf1(stamp, velocity(i)), b"\xa3\x95\x90" + packed]
    log = read_telemetry(written(tmp_path / "a.bin", b"".join(parts)))
    tells(log.places, SEA_LEVEL)
    assert log.counts == {}


def global_message(i, *, fixed=True, ned=(3.0, -4.0, 0.5)):
    latitude, longitude, altitude = where(i) if fixed else (0, 0, 0)
    return mavlink.MAVLink_global_position_int_message(
        7000 + i * 100,
        *(round(degrees * 1e7) for degrees in (latitude, longitude)),
        round(altitude * 1000),
        12_000,
        *(round(metres * 100) for metres in ned),
        65535,
    )


def tlog(*messages_at):
    """`messages_at` give the messages of i / 10 s."""
    parts = [tlog_part(RECEIVED_US, heartbeat())]
    for i in range(COUNT):
        parts += [tlog_part(RECEIVED_US + i * 100_000, message(i)) for message in messages_at]
    return b"".join(parts)


def test_mavlink(tmp_path):
    better = tlog(lambda i: ned_message(7000 + i * 100, velocity(i)), global_message)
    log = read_telemetry(written(tmp_path / "a.tlog", better))
    tells(log.places, SEA_LEVEL)
    assert [tuple(sample.velocity) for sample in log.velocities] == [velocity(i) for i in range(COUNT)]
    assert log.counts == {}


def test_mavlink_where_nothing_better_tells_the_velocity(tmp_path):
    """A GCS often asks for this message alone: such a log was refused."""
    log = read_telemetry(
        written(tmp_path / "a.tlog", tlog(lambda i: global_message(i, ned=(3 + i / 100, -4, 0.5))))
    )
    expected = [(3 + i / 100, -4, 0.5) for i in range(COUNT)]
    np.testing.assert_allclose([sample.velocity for sample in log.velocities], expected, atol=1e-9)
    assert "GLOBAL_POSITION_INT of vehicle 1" in log.name
    tells(log.places, SEA_LEVEL)


def test_mavlink_before_the_first_fix(tmp_path):
    """ArduPilot writes zeros then, velocities too."""
    data = tlog(lambda i: global_message(i, fixed=i > 1, ned=(3 + i / 100, -4, 0.5)))
    log = read_telemetry(written(tmp_path / "a.tlog", data))
    assert len(log.velocities) == COUNT - 2
    assert log.counts == {"positions without a fix": 2}


STRAIGHT = (NORTH_M_S, EAST_M_S, -1.25)


@pytest.mark.parametrize("layout", DJI_LAYOUTS)
def test_dji_subtitles(tmp_path, layout):
    """Their heights above the start are no altitude; `abs_alt` is, as DJI has it."""
    body, rate, fixes = DJI_LAYOUTS[layout]
    text = cues(STRAIGHT, body, seconds=6, rate=rate, fixes_per_s=fixes)
    track = read_telemetry(written(tmp_path / "a.srt", text.encode())).places
    for i in (20, 35):
        assert track.at(i * S // 10)[:2] == pytest.approx(where(i)[:2], abs=1.2e-6)  # written to 6 decimals
    above = {mavic_3: 150.0, DJI_LAYOUTS["Matrice 30"][0]: 110.0, DJI_LAYOUTS["comma decimals"][0]: 150.0}
    start_m = above.get(body, np.nan)
    assert track.above == (SEA_LEVEL if body in above else None)
    np.testing.assert_allclose(track.at(2 * S)[2], start_m + 2 * 1.25, atol=0.01)


def test_subtitles_that_jump_are_counted_once(tmp_path):
    text = cues(STRAIGHT, mavic_pro, seconds=20, rate=1, fixes_per_s=1)
    latitude = place(NORTH_M_S * 9, 0)[0]
    log = read_telemetry(written(tmp_path / "a.srt", text.replace(f"{latitude:.6f}", "48.900000").encode()))
    assert log.counts == {"positions that jump": 1}
    assert log.places.at(9 * S)[0] == pytest.approx(latitude, abs=1e-6)


@pytest.mark.parametrize(("layout", "altitude"), [(airdata, None), (flight_reader, 300.1), (txt_log, None)])
def test_dji_records(tmp_path, layout, altitude):
    rows = record()
    log = read_telemetry(written(tmp_path / "a.csv", layout(rows).encode()))
    row = rows[300]
    latitude, longitude, height = log.places.at(round(row.time_s * S) - round(rows[0].time_s * S))
    assert (latitude, longitude) == pytest.approx((row.lat, row.lon), abs=1e-6)
    assert log.places.above == (SEA_LEVEL if altitude else None)
    np.testing.assert_allclose(height, altitude * 0.3048 if altitude else np.nan, rtol=1e-6)


def gopro_rows(part):
    rows = [(*where(i), 5.0, 5.0) for i in np.arange(part * 10, part * 10 + 10)]
    return np.array(rows)


@pytest.mark.parametrize(
    ("kind", "above"), [("GPS5", ELLIPSOID), ("GPS5 by the sea", SEA_LEVEL), ("GPS9", ELLIPSOID)]
)
def test_gopro(tmp_path, kind, above):
    video = make_video(tmp_path / "v.mp4", range(0, 3000, 40))
    parts = []
    for part in range(3):
        if kind == "GPS9":
            parts.append(gps9_payload(np.c_[gopro_rows(part), np.tile([8000.0, 3600, 1.5, 3], (10, 1))]))
        else:
            mark = klv("GPSA", "F", 4, 1, b"MSLV") if "sea" in kind else b""
            parts.append(gps5_payload(gopro_rows(part), beside=mark))
    log = read_gpmf(add_gpmf(video, parts))
    tells(log.places, above)


def glpi_payload(rows):
    """A Karma's own: rows of (own time ms, latitude, longitude, altitude), as its files describe them."""
    scale = [1000, 10**7, 10**7, 1000, 1000, 100, 100, 100, 100]
    raw = []
    for ms, latitude, longitude, altitude in rows:
        degrees = (round(latitude * 1e7), round(longitude * 1e7))
        raw.append(struct.pack(">Lllll3hH", ms, *degrees, round(altitude * 1000), 12_000, 0, 0, 0, 0))
    return nest(
        "DEVC",
        klv("DVNM", "c", 1, 5, b"Karma"),
        nest(
            "STRM",
            klv("UNIT", "c", 3, 9, b"s\0\0degdegm\0\0m\0\0m/sm/sm/sdeg"),
            klv("TYPE", "c", 1, 9, b"LllllsssS"),
            klv("SCAL", "l", 4, 9, struct.pack(">9l", *scale)),
            klv("GLPI", "?", 28, len(rows), b"".join(raw)),
        ),
    )


def test_a_karmas_own_place_comes_before_its_cameras(tmp_path):
    """It is the drone's GLOBAL_POSITION_INT: altitudes above mean sea level."""
    video = make_video(tmp_path / "v.mp4", range(0, 3000, 40))
    parts = []
    for part in range(3):
        tenths = range(part * 10, part * 10 + 10)
        parts.append(
            lned_payload([(i * 100, 1, 2, 3 + i / 9) for i in tenths])
            + glpi_payload([(i * 100, *where(i)) for i in tenths])
            + gps5_payload(gopro_rows(part + 9))
        )
    log = read_gpmf(add_gpmf(video, parts))
    # The clock of its samples, as for its velocities.
    tells(log.places, SEA_LEVEL, start_ns=-S // 20 - KARMA_LATE_NS)


def test_gopro_beside_a_karmas_velocity(tmp_path):
    """The drone tells the velocity, the camera's receiver the place."""
    video = make_video(tmp_path / "v.mp4", range(0, 3000, 40))
    parts = [
        lned_payload([(part * 1000 + i * 100, 1, 2, 3) for i in range(10)]) + gps5_payload(gopro_rows(part))
        for part in range(3)
    ]
    log = read_gpmf(add_gpmf(video, parts))
    assert "Karma" in log.name
    tells(log.places, ELLIPSOID)


def moved_parrot(text):
    """Each row at its own place: the writers of these tests stand still."""
    rows = text.splitlines()
    for i, row in enumerate(rows[1:]):
        latitude, longitude, altitude = where(i)
        told = f"{latitude:.8f} {longitude:.8f} {altitude + 48:.2f} {altitude:.3f}"
        moved = row.replace("48.70000000 2.20000000 150.00 100.00", told)
        rows[i + 1] = f"{100_000 * i} {moved.partition(' ')[2]}"
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("altitudes", [True, False])
def test_csv_of_ones_own(tmp_path, altitudes):
    """A cell may stay empty, as where the receiver had no fix yet."""
    rows = ["time_s,speed_m_s,latitude_deg,longitude_deg" + ",altitude_m" * altitudes]
    rows += [
        f"{i / 10},5,{','.join(f'{number:.9f}' for number in where(i)[: 2 + altitudes])}"
        for i in range(COUNT)
    ]
    rows[1] = "0,5" + "," * (2 + altitudes)
    read = read_telemetry(written(tmp_path / "a.csv", ("\n".join(rows) + "\n").encode()))
    assert "ignored" not in read.name
    tells(read.places, SEA_LEVEL, altitudes=altitudes)


def test_parrot(tmp_path):
    text = moved_parrot(parrot_csv((1, 2, 3), rows=COUNT))
    tells(read_telemetry(written(tmp_path / "a.csv", text.encode())).places, SEA_LEVEL)


def test_parrot_where_only_the_ellipsoid_is_told(tmp_path):
    text = moved_parrot(parrot_csv((1, 2, 3), rows=COUNT))
    text = text.replace("altitude_wgs84ellipsoid", "x").replace(
        "altitude_egm96amsl", "altitude_wgs84ellipsoid"
    )
    tells(read_telemetry(written(tmp_path / "a.csv", text.encode())).places, ELLIPSOID)


@pytest.mark.parametrize("protobuf", [False, True])
def test_parrots_json(tmp_path, protobuf):
    content = json.loads(parrot_json((1, 2, 3), rows=COUNT, protobuf=protobuf))
    for i, frame in enumerate(content["frame"]):
        told = dict(zip(("latitude", "longitude", "altitude_egm96amsl"), map(float, where(i)), strict=True))
        inside = frame["metadata"]["drone"] if protobuf else frame["metadata"]
        inside["location"], frame["time"] = told, 100_000 * i
    tells(read_telemetry(written(tmp_path / "a.json", json.dumps(content).encode())).places, SEA_LEVEL)


def test_parrot_without_a_location(tmp_path):
    text = parrot_csv((1, 2, 3), rows=COUNT, located=False)
    assert read_telemetry(written(tmp_path / "a.csv", text.encode())).places is None


MADE = Messages("cdr")


def fix(i, status=0):
    kind = MADE.types["NavSatFix"]
    latitude, longitude, altitude = map(float, where(i))
    header, state = MADE.header(i / 10, "gps"), MADE.types["NavSatStatus"](status, 1)
    return "sensor_msgs/msg/NavSatFix", kind(header, state, latitude, longitude, altitude, np.zeros(9), 0)


@pytest.mark.parametrize(
    ("topic", "north"), [("/odom", False), ("/mavros/local_position/odom", True), (None, True)]
)
def test_ros(tmp_path, topic, north):
    """The map of an odometry begins in any direction; MAVROS's and the slopes of fixes have the Earth's north."""
    messages = [("/gps/fix", i / 10, fix(i)) for i in range(COUNT)]
    if topic:
        messages += [(topic, i / 10, MADE.odometry(i / 10, (1, 2, 3 + i))) for i in range(COUNT)]
    log = read_telemetry(write_mcap(tmp_path / "a.mcap", messages))
    tells(log.places, ELLIPSOID)
    assert log.true_north is north


def test_ros_with_px4s_place(tmp_path):
    """What PX4 flies by comes before what its receiver measures."""
    messages = []
    for i in range(COUNT):
        told = dict(zip(("lat", "lon", "alt"), map(float, where(i)), strict=True))
        messages.append(px4_velocity(i))
        messages.append(global_position(i, **told))
        messages.append(of_ros("/gps/fix", i / 10, fix(i + 40)))
    log = read_telemetry(write_px4(tmp_path / "a", messages))
    tells(log.places, SEA_LEVEL)
    assert log.true_north
