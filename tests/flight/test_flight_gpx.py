"""GPX tracks: by whom they were written, and what they may lack."""

import subprocess
import sys

import numpy as np
import pytest
from flight_files import make_video
from pymavlink.dialects.v20 import common as mavlink

from flightdepth.errors import BadInput
from flightdepth.flight.open import open_flight
from flightdepth.flight.telemetry import is_log, read_telemetry
from tests_gpx import GPX_LAYOUTS, START, exiftool, gopro2gpx, points
from tests_logs import heartbeat, tlog_part, written
from tests_recordings import place

NED_M_S = (4.0, -3.0, -0.5)
START_S = int(START.timestamp())
HEAD = '<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1">'


def read(tmp_path, text, encoding="utf-8"):
    return read_telemetry(written(tmp_path / "track.log", text.encode(encoding)))


def velocities(log):
    return np.array([sample.velocity for sample in log.velocities])


def flight(*segments):
    """A GPX of segments, each of the marks of its points."""
    return f"{HEAD}<trk>{''.join(f'<trkseg>{each}</trkseg>' for each in segments)}</trk></gpx>\n"


def marks(ned=NED_M_S, *, times=range(12), inside="<ele>{height:.2f}</ele><time>{time}</time>"):
    """Points at seconds after 9:30."""
    parts = []
    for at_s in times:
        latitude, longitude = place(ned[0] * at_s, ned[1] * at_s)
        time = f"2026-05-01T09:{30 + at_s // 60:02d}:{at_s % 60:02d}Z"
        told = inside.format(height=50 - ned[2] * at_s, time=time)
        parts.append(f'<trkpt lat="{latitude:.7f}" lon="{longitude:.7f}">{told}</trkpt>')
    return "".join(parts)


@pytest.mark.parametrize("layout", GPX_LAYOUTS)
@pytest.mark.parametrize("rate", [1, 5, 18])
def test_what_programs_write_is_read(tmp_path, layout, rate):
    log = read(tmp_path, GPX_LAYOUTS[layout](points(NED_M_S, rate=rate)))
    assert len(log.velocities) == 12 * rate
    np.testing.assert_allclose(velocities(log), [NED_M_S] * len(log.velocities), atol=0.05)
    assert log.velocities[0].stamp_ns == 0
    assert log.span_ns[1] == pytest.approx(12e9 * (1 - 1 / 12 / rate), abs=1e7)
    assert {sample.frame for sample in log.velocities} == {"world"}
    assert log.counts == {}
    assert log.name == (
        f"GPX track.log: {12 * rate} velocities from positions; its time 0 is {START_S}.000 s of its clock"
    )
    assert log.places.at(10**9)[2] == pytest.approx(50.5, abs=0.01)
    assert not log.any_direction and log.true_north and not log.time_0_told
    assert not log.attitudes and not log.body_attitudes


def position(i):
    """GLOBAL_POSITION_INT at 5 Hz."""
    latitude, longitude = place(NED_M_S[0] * i / 5, NED_M_S[1] * i / 5)
    height_mm = round(50_000 - NED_M_S[2] * i * 200)
    return mavlink.MAVLink_global_position_int_message(
        i * 200, round(latitude * 1e7), round(longitude * 1e7), height_mm, 0, 0, 0, 0, 0
    )


def test_mavtogpx_of_pymavlink_tells_whole_seconds_and_the_first_of_each_counts(tmp_path):
    """It drops the fraction, so that five positions have one time."""
    parts = [tlog_part(START_S * 10**6 + i * 200_000, position(i)) for i in range(60)]
    path = written(tmp_path / "flight.tlog", tlog_part(START_S * 10**6, heartbeat()) + b"".join(parts))
    command = [sys.executable, "-m", "pymavlink.tools.mavtogpx", "--nofixcheck", path]
    subprocess.run(command, check=True, capture_output=True)
    log = read_telemetry(tmp_path / "flight.tlog.gpx")
    np.testing.assert_allclose(velocities(log), [NED_M_S] * 12, atol=0.05)
    assert log.counts == {"positions not later than the one before": 48}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_any_unicode_is_read(tmp_path, encoding):
    assert len(read(tmp_path, exiftool(points(NED_M_S)), encoding).velocities) == 12


def test_a_name_with_an_ampersand_costs_nothing(tmp_path):
    """No XML, and written by hand-made programs."""
    text = gopro2gpx(points(NED_M_S)).replace("exercise", "Tom & Jerry \x01")
    assert len(read(tmp_path, text).velocities) == 12


def test_entities_are_never_expanded(tmp_path):
    text = '<!DOCTYPE gpx [<!ENTITY e "<trkpt">]>' + flight("&e;" * 10 + marks())
    assert len(read(tmp_path, text).velocities) == 12


@pytest.mark.parametrize("times", ["-0700", "-07:00"])
def test_a_zone_counts(tmp_path, times):
    log = read(tmp_path, flight(marks()).replace("Z</time>", f"{times}</time>"))
    assert f"its time 0 is {START_S + 7 * 3600}.000 s" in log.name


def test_a_time_without_a_zone_is_utc(tmp_path):
    assert f"its time 0 is {START_S}.000 s" in read(tmp_path, flight(marks()).replace("Z<", "<")).name


def test_no_velocity_is_told_between_two_segments_that_lie_apart(tmp_path):
    log = read(tmp_path, flight(marks(times=range(6)), marks(times=range(60, 70))))
    assert "16 velocities from positions, 2 segments;" in log.name
    np.testing.assert_allclose(velocities(log), [NED_M_S] * 16, atol=0.05)
    assert [sample.stamp_ns // 10**9 for sample in log.velocities] == [*range(6), *range(60, 70)]


def test_segments_stand_in_any_order(tmp_path):
    parts = marks(times=range(60, 70)), marks(times=range(6))
    assert (
        velocities(read(tmp_path, flight(*parts))) == velocities(read(tmp_path, flight(*parts[::-1])))
    ).all()


def test_without_elevations_a_flight_is_taken_as_level(tmp_path):
    log = read(tmp_path, flight(marks(inside="<time>{time}</time>")))
    np.testing.assert_allclose(velocities(log), [(4, -3, 0)] * 12, atol=0.05)
    assert log.counts == {"positions without an altitude": 12}
    assert log.places.above is None


@pytest.mark.parametrize(
    "track",
    [
        flight(marks(inside="<ele>{height:.2f}</ele>")),
        flight(marks(inside="<time>yesterday</time>")),
        flight(marks(inside="<time>9999-01-01T00:00:00Z</time>")),
        flight("".join(f'<trkpt lat="48.{i}" lon="2"/>' for i in range(12))),
    ],
    ids=["none", "no times", "too late", "empty points"],
)
def test_without_times_it_is_refused(tmp_path, track):
    with pytest.raises(
        BadInput, match=r"with their times, got none \(12 positions without a time\)\. .*drawn on a map"
    ):
        read(tmp_path, track)


def test_a_point_without_a_time_is_left_out(tmp_path):
    log = read(tmp_path, flight(marks() + '<trkpt lat="48.7" lon="2.2"></trkpt>'))
    assert log.counts == {"positions without a time": 1}
    assert len(log.velocities) == 12


AFTER = '<wpt lat="48" lon="2"><ele>180</ele><time>2026-05-01T09:30:12Z</time></wpt>'


@pytest.mark.parametrize("last", ['<trkpt lat="48" lon="2"/>', '<trkpt lat="48" lon="2"></trkpt>'])
def test_what_stands_after_a_track_is_not_its_last_points(tmp_path, last):
    """A waypoint's time was taken for that of the point before it."""
    log = read(tmp_path, flight(marks() + last).replace("</gpx>", f"{AFTER}</gpx>"))
    np.testing.assert_allclose(velocities(log), [NED_M_S] * 12, atol=0.05)
    assert log.counts == {"positions without a time": 1}


def test_the_height_of_a_waypoint_is_not_that_of_the_track(tmp_path):
    """A track that stops telling its elevations took that of a waypoint, so that the drone seemed to climb."""
    silent = marks(times=range(6, 12), inside="<time>{time}</time>")
    log = read(tmp_path, flight(marks(times=range(6)) + silent).replace("</gpx>", f"{AFTER}</gpx>"))
    np.testing.assert_allclose(velocities(log)[7:], [[*NED_M_S[:2], 0]] * 5, atol=0.05)
    assert log.counts == {"positions without an altitude": 6}


def test_waypoints_and_routes_are_no_flight(tmp_path):
    inside = marks().replace("trkpt", "rtept")
    with pytest.raises(BadInput, match=r"expected a GPX track .*got none\. A route"):
        read(tmp_path, f'{HEAD}<wpt lat="48" lon="2"/><rte>{inside}</rte></gpx>')


@pytest.mark.parametrize(
    "point",
    [
        '<trkpt lat="0" lon="0"><time>2026-05-01T09:30:12Z</time></trkpt>',
        '<trkpt lat="480" lon="2"><time>2026-05-01T09:30:12Z</time></trkpt>',
        '<trkpt lat="48,7" lon="2,2"><time>2026-05-01T09:30:12Z</time></trkpt>',
        '<trkpt lon="2.2"><time>2026-05-01T09:30:12Z</time></trkpt>',
        '<trkpt lat="48.7" lon="2.2"><time>2026-05-01T09:30:12Z</time><fix>none</fix></trkpt>',
    ],
)
def test_no_place_on_earth_is_no_position(tmp_path, point):
    log = read(tmp_path, flight(marks() + point))
    assert log.counts == {"positions without a fix": 1}
    assert len(log.velocities) == 12


def test_a_clock_that_was_not_set_yet_does_not_move_time_0(tmp_path):
    early = '<trkpt lat="48.7" lon="2.2"><ele>50</ele><time>1970-01-01T00:00:09Z</time></trkpt>'
    log = read(tmp_path, flight(early + marks()))
    assert f"its time 0 is {START_S}.000 s" in log.name
    assert log.velocities[0].stamp_ns == 0


def test_what_came_before_a_cut_is_used_and_the_cut_is_told(tmp_path):
    text = gopro2gpx(points(NED_M_S))
    whole, last = velocities(read(tmp_path, text)), 0
    for end in range(text.index("<trkseg>"), len(text) - len("</gpx>\r\n"), 37):
        try:
            log = read(tmp_path, text[:end])
        except BadInput as error:
            assert "cut off" in str(error)
            continue
        np.testing.assert_allclose(velocities(log), whole[: len(log.velocities)], atol=0.05)
        assert any("cut off" in reason for reason in log.counts)
        assert len(log.velocities) >= last
        last = len(log.velocities)
    assert last == 12


def test_a_damaged_byte_costs_one_point(tmp_path):
    text = gopro2gpx(points(NED_M_S))
    at = text.index("</trkpt>", len(text) // 2)
    log = read(tmp_path, text[:at] + "#" + text[at + 1 :])
    assert log.counts == {"positions damaged or cut off": 1}
    assert len(log.velocities) == 11


def test_a_page_that_speaks_of_gpx_is_one_line(tmp_path):
    with pytest.raises(BadInput, match="expected a GPX track"):
        read(tmp_path, "<html><body><gpx ></body></html>")


def test_other_markup_is_no_gpx(tmp_path):
    path = written(tmp_path / "flight.gpx", b"<?xml version='1.0'?><kml><Document/></kml>")
    assert not is_log(path)
    with pytest.raises(BadInput, match=r"expected one of .*GPX, .*got something else"):
        read_telemetry(path)


def test_a_flight_by_a_track_beside_the_video(tmp_path):
    video = make_video(tmp_path / "DJI_0001.MP4", range(0, 12_000, 500))
    (tmp_path / "DJI_0001.gpx").write_text(gopro2gpx(points(NED_M_S)))
    with open_flight(video, hfov_deg=70) as opened:
        assert opened.telemetry_name.startswith("GPX DJI_0001.gpx")
        assert not opened.any_direction
        assert opened.places is not None
        assert opened.warnings == ()
