import json
from dataclasses import asdict

import numpy as np
import pytest
from flight_files import add_gpmf, gps5_payload, lned_payload, make_video

from flightdepth.camera import Camera
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight import AttitudeSample, Frame, VelocitySample, flight_log, open_flight, write_csv
from flightdepth.flight.offset import ClockOffset
from flightdepth.flight.open import merged
from flightdepth.flight.records import MAX_GAP_S, PositionSample, Telemetry, ViewTrack, by_time

MS = 1_000_000


@pytest.fixture
def video(tmp_path):
    return make_video(tmp_path / "v.mp4", range(0, 2000, 40))


def log(tmp_path, stamps_ms, *, attitude=False):
    path = tmp_path / "log.csv"
    samples = []
    for stamp in stamps_ms:
        samples.append(VelocitySample(stamp * MS, [1.0, 2.0, 3.0]))
        if attitude:
            samples.append(AttitudeSample(stamp * MS, [1, 0, 0, 0]))
    write_csv(path, samples)
    return path


def frame(stamp):
    return Frame(0, stamp, np.zeros((2, 2, 3), np.uint8))


def velocity(stamp):
    return VelocitySample(stamp, [0, 0, 1])


def order(items):
    return [(type(item).__name__[0], item.stamp_ns) for item in items]


def test_each_frame_follows_the_first_velocity_at_or_after_it():
    found = merged(
        iter([frame(0), frame(5), frame(10), frame(12)]), (velocity(3), velocity(10), velocity(20))
    )
    assert order(found) == [("V", 3), ("F", 0), ("V", 10), ("F", 5), ("F", 10), ("V", 20), ("F", 12)]


def test_an_attitude_with_the_velocitys_stamp_comes_before_the_frame():
    samples = (velocity(3), AttitudeSample(3, [1, 0, 0, 0]), velocity(9))
    assert order(merged(iter([frame(1)]), samples)) == [("V", 3), ("A", 3), ("F", 1)]


def test_each_frame_follows_the_first_attitude_after_it_that_is_no_gap_away():
    level, far = [1, 0, 0, 0], round((MAX_GAP_S + 1) * 1e9)
    samples = (AttitudeSample(1, level), velocity(3), AttitudeSample(5, level), velocity(8))
    samples += (velocity(11), AttitudeSample(far, level))
    found = merged(iter([frame(2), frame(10)]), samples)
    assert order(found) == [("A", 1), ("V", 3), ("A", 5), ("F", 2), ("V", 8), ("V", 11), ("F", 10)]


@pytest.mark.parametrize("until_s", [11, 100], ids=["after the last velocity", "in a gap"])
def test_attitudes_come_as_the_frames_do_where_no_velocity_is_told(until_s):
    """All up to the next came at once, more than whoever integrates keeps."""
    second, level = 10**9, [1, 0, 0, 0]
    velocities = [velocity(0), velocity(second), *([velocity(90 * second)] if until_s > 90 else [])]
    attitudes = [AttitudeSample(k * second // 10, level) for k in range(1000)]
    ahead, given_ns = [], 0
    for item in merged((frame(k * second) for k in range(until_s)), by_time(velocities, attitudes)):
        if isinstance(item, Frame):
            ahead.append(given_ns - item.stamp_ns)
        else:
            given_ns = item.stamp_ns
    assert len(ahead) == until_s
    assert max(ahead) <= MAX_GAP_S * second
    assert min(ahead) >= 0


def test_a_frame_after_the_last_velocity_follows_the_position_after_it():
    samples = (velocity(0), PositionSample(0, [0, 0, 0]), PositionSample(4, [0, 0, 0]))
    assert order(merged(iter([frame(2)]), samples)) == [("V", 0), ("P", 0), ("P", 4), ("F", 2)]


def test_frames_after_the_last_velocity_still_come():
    assert order(merged(iter([frame(1), frame(9)]), (velocity(3),))) == [("V", 3), ("F", 1), ("F", 9)]


def test_no_sample_comes_twice_or_is_left_out():
    samples = tuple(velocity(stamp) for stamp in range(0, 100, 7))
    found = list(merged((frame(stamp) for stamp in range(0, 90, 4)), samples))
    assert [item for item in found if isinstance(item, VelocitySample)] == list(samples[:14])


def test_what_a_log_tells_long_before_the_first_frame_is_left_out():
    """Of an hour before it the estimator kept what it could and counted the rest as dropped."""
    second = 10**9
    samples = tuple(velocity(k * second) for k in range(4000))
    found = order(merged(iter([frame(3600 * second), frame(3602 * second)]), samples))
    early = [("V", k * second) for k in range(3595, 3601)]
    later = [("V", 3601 * second), ("V", 3602 * second)]
    assert found == [*early, ("F", 3600 * second), *later, ("F", 3602 * second)]


def test_a_flight_with_a_log(video, tmp_path):
    with open_flight(video, log(tmp_path, range(0, 2100, 100), attitude=True), hfov_deg=60) as flight:
        items = list(flight)
    assert sum(isinstance(item, Frame) for item in items) == 50
    assert sum(isinstance(item, AttitudeSample) for item in items) == 21
    assert flight.counts == {}
    assert "log.csv" in flight.telemetry_name


def test_a_log_in_milliseconds_is_refused(video, tmp_path):
    """Taken for seconds its velocities are minutes apart; no frame had depth, and the log was not named."""
    with pytest.raises(BadInput, match=r"a velocity every 5\.000 s at least, got one in 100\.000 s.*unit"):
        open_flight(video, log(tmp_path, range(0, 2_100_000, 100_000)), hfov_deg=60)


def test_a_log_that_tells_a_velocity_seldom_is_taken_with_a_warning(video, tmp_path):
    with open_flight(video, log(tmp_path, range(0, 6100, 2000)), hfov_deg=60) as flight:
        told = " ".join(flight.warnings)
        assert "a velocity every 2.0 s only" in told
        assert f"more than {MAX_GAP_S:g} s between two are not bridged" in told
    with open_flight(video, log(tmp_path, range(0, 6100, 1000)), hfov_deg=60) as flight:
        assert "a velocity every" not in " ".join(flight.warnings)


@pytest.mark.parametrize(
    ("first_ms", "last_ms", "told"), [(0, 2000, True), (100, 2100, True), (600, 2600, False)]
)
def test_a_log_of_a_part_of_the_video_is_told(video, tmp_path, first_ms, last_ms, told):
    path = log(tmp_path, range(first_ms, last_ms, 100))
    with open_flight(video, path, hfov_deg=60) as flight:
        lines = [
            line for line in flight.warnings if "the log tells of 0.600 s to 2.500 s, the pictures" in line
        ]
        assert bool(lines) != told
    with open_flight(video, path, hfov_deg=60, start_s=0.7, end_s=1.5) as flight:
        assert "the log tells of" not in " ".join(flight.warnings)


def told_of_gaps(video, path, **part):
    with open_flight(video, path, hfov_deg=60, **part) as flight:
        return [line for line in flight.warnings if "tells no velocity" in line]


def test_a_gap_within_a_log_is_told_before_the_flight(tmp_path):
    """Nothing was said of it until frames had no depth."""
    video = make_video(tmp_path / "v.mp4", range(0, 12000, 500))
    path = log(tmp_path, [*range(0, 4000, 100), *range(8000, 12000, 100)])
    (line,) = told_of_gaps(video, path)
    assert "no velocity from 3.900 s to 8.000 s of the video: frames in there have no depth" in line
    assert told_of_gaps(video, path, end_s=4.3) == told_of_gaps(video, path, start_s=8.5) == []
    often = log(tmp_path, [*range(0, 2000, 100), *range(4000, 8000, 100), *range(11000, 12000, 100)])
    (line,) = told_of_gaps(video, often)
    assert "no velocity 2 times, for 5.200 s in all, the longest from 7.900 s to 11.000 s" in line


def test_a_flight_with_its_telemetry_inside(video):
    rows = [(5000 + 250 * k, 1.0, 0.0, 0.0) for k in range(8)]
    with open_flight(
        add_gpmf(video, [lned_payload(rows[:4]), lned_payload(rows[4:])]), hfov_deg=60
    ) as flight:
        assert "GPMF" in flight.telemetry_name
        assert sum(isinstance(item, VelocitySample) for item in flight) == 8


def test_a_flight_is_read_once(video):
    """Run again, a notebook's cell saw one frame, and no error."""
    with open_flight(video, speed_m_s=5.0, hfov_deg=80.0) as flight:
        assert sum(isinstance(event, Frame) for event in flight) == 50
        with pytest.raises(FlightDepthError, match="open it again"):
            next(iter(flight))
    closed = open_flight(video, speed_m_s=5.0, hfov_deg=80.0)
    closed.close()
    with pytest.raises(FlightDepthError, match="open it again"):
        next(iter(closed))


def test_a_flight_at_constant_speed(video):
    with open_flight(video, speed_m_s=7.5, hfov_deg=60) as flight:
        items = list(flight)
        assert "7.5 m/s" in flight.telemetry_name
    assert order(items)[:4] == [("V", 0), ("F", 0), ("V", 40 * MS), ("F", 40 * MS)]
    assert items[0].velocity.tolist() == [7.5, 0, 0]
    assert items[0].frame == "world"


def test_a_speed_stands_above_telemetry_inside(video):
    add_gpmf(video, [lned_payload([(5000, 1.0, 0.0, 0.0)])])
    with open_flight(video, speed_m_s=3, hfov_deg=60) as flight:
        assert "constant speed" in flight.telemetry_name


def test_a_log_of_the_videos_name_beside_it_is_found(video, tmp_path):
    """As DJI's cameras write them, and other files of that name are no matter."""
    (tmp_path / "v.jpg").write_bytes(b"no log")
    log(tmp_path, range(0, 2100, 100)).rename(tmp_path / "v.CSV")
    with open_flight(video, hfov_deg=60) as flight:
        assert "v.CSV" in flight.telemetry_name
    log(tmp_path, range(0, 2100, 100)).rename(tmp_path / "v.txt")
    with pytest.raises(BadInput, match=r"beside it v\.CSV, v\.txt.*--telemetry LOG"):
        open_flight(video, hfov_deg=60)


@pytest.mark.parametrize(("film", "name"), [("FLIGHT.MP4", "flight.csv"), ("Flight.mp4", "FLIGHT.CSV")])
def test_a_log_beside_the_video_may_be_written_in_another_case(video, tmp_path, film, name):
    """The camera's card and the autopilot's: "no log beside it whose name is FLIGHT"."""
    log(tmp_path, range(0, 2100, 100)).rename(tmp_path / name)
    with open_flight(video.rename(tmp_path / film), hfov_deg=60) as flight:
        assert name in flight.telemetry_name


def test_nor_does_it_matter_how_accents_are_stored(video, tmp_path):
    """Disks of older Macs store two characters for one letter with an accent."""
    log(tmp_path, range(0, 2100, 100)).rename(tmp_path / "Flu\u0308ge.csv")
    with open_flight(video.rename(tmp_path / "Fl\u00fcge.mp4"), hfov_deg=60) as flight:
        assert "ge.csv" in flight.telemetry_name


def test_a_track_without_a_velocity_leaves_the_log_beside_the_video(video, tmp_path):
    """A GoPro that never had a fix, on a drone whose log has the video's name."""
    add_gpmf(video, [gps5_payload([[48, 11, 500, 0, 0]] * 18, fix=0)] * 2)
    with pytest.raises(BadInput, match="GPS samples without a fix"):
        open_flight(video, hfov_deg=60)
    log(tmp_path, range(0, 2100, 100)).rename(tmp_path / "v.csv")
    with open_flight(video, hfov_deg=60) as flight:
        assert "v.csv" in flight.telemetry_name


@pytest.mark.parametrize(("inside_m_s", "doubted"), [(6.0, True), (1.0, True), (4.5, False)])
def test_a_log_that_flies_otherwise_than_the_track_inside_is_doubted(video, tmp_path, inside_m_s, doubted):
    """The log flies at 3.7 m/s."""
    rows = [(5000 + 250 * k, inside_m_s, 0.0, 0.0) for k in range(8)]
    add_gpmf(video, [lned_payload(rows[:4]), lned_payload(rows[4:])])
    said = f"the log flies at 3.7 m/s, the track inside the video at {inside_m_s:.1f}"
    with open_flight(video, log(tmp_path, range(0, 2100, 100)), hfov_deg=60) as flight:
        assert [line.startswith(said) for line in flight.warnings] == [True] * doubted


def test_a_track_inside_that_tells_nothing_contradicts_nothing(video, tmp_path):
    add_gpmf(video, [lned_payload([(5000, float("nan"), 0.0, 0.0)])])
    with open_flight(video, log(tmp_path, range(0, 2100, 100)), hfov_deg=60) as flight:
        assert flight.warnings == ()


def test_a_part_of_a_flight(video, tmp_path):
    path = log(tmp_path, range(0, 2100, 100))
    with open_flight(video, path, hfov_deg=60, start_s=0.5, end_s=1.0) as flight:
        stamps = [item.stamp_ns // MS for item in flight if isinstance(item, Frame)]
    assert (stamps[0], stamps[-1]) == (520, 960)


def test_the_field_of_view_gives_the_camera(video):
    with open_flight(video, speed_m_s=1, hfov_deg=60) as flight:
        assert flight.camera == Camera.from_fov(96, 64, 60)


def test_the_fields_of_view_move_with_the_log(video, monkeypatch):
    """Zoomed in after a second of the log, which begins half a second after the video."""
    view = ViewTrack(np.array([0, 500, 1000, 1500]) * MS, np.array([60.0, 60, 30, 30]))
    samples = tuple(velocity(stamp * MS) for stamp in range(0, 2000, 100))
    told = Telemetry("log", samples, {}, view=view)
    monkeypatch.setattr(flight_log, "read_telemetry", lambda path: told)
    monkeypatch.setattr(flight_log, "estimate_offset", lambda *_: ClockOffset(0.5, 0.01, 0.9, 0.0, "speed"))
    with open_flight(video, "log", telemetry_offset_s="auto") as flight:
        fields = {f.stamp_ns // MS: f.camera.horizontal_fov_deg for f in flight if isinstance(f, Frame)}
    assert fields[1200] == pytest.approx(60, rel=0.02)
    assert fields[1520] == pytest.approx(30, rel=0.02)


def test_a_calibration_is_brought_to_the_videos_size(video, tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(asdict(Camera.from_fov(960, 640, 60))))
    with open_flight(video, speed_m_s=1, camera=path) as flight:
        assert flight.camera == Camera.from_fov(960, 640, 60).resized(96, 64)


def test_hints_for_progress(video):
    with open_flight(video, speed_m_s=1, hfov_deg=60) as flight:
        assert flight.duration_s == pytest.approx(2.0, abs=0.1)
        assert flight.frame_count_hint == pytest.approx(50, abs=2)
        assert flight.gyroscope is None


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"hfov_deg": 60}, "--telemetry LOG or --speed"),
        ({"speed_m_s": 1}, "--hfov"),
        ({"speed_m_s": -1, "hfov_deg": 60}, "--speed"),
        ({"speed_m_s": float("nan"), "hfov_deg": 60}, "--speed"),
        ({"speed_m_s": 151, "hfov_deg": 60}, "0 to 150 m/s"),
        ({"speed_m_s": 1, "telemetry": "log.csv", "hfov_deg": 60}, "both"),
        ({"speed_m_s": 1, "hfov_deg": 60, "camera": Camera.from_fov(96, 64, 60)}, "both"),
        ({"speed_m_s": 1, "camera": Camera.from_fov(64, 96, 60)}, "96x64"),
        ({"speed_m_s": 1, "hfov_deg": 0}, "field of view"),
        ({"speed_m_s": 1, "hfov_deg": 60, "telemetry_offset_s": "auto"}, "a log to move, got --speed"),
        ({"speed_m_s": 1, "hfov_deg": 60, "telemetry_offset_s": -2.0}, "a log to move, got --speed"),
        ({"telemetry": "none.csv", "hfov_deg": 60}, "No such file"),
    ],
)
def test_what_cannot_be_flown_is_refused(video, options, said):
    with pytest.raises(BadInput, match=said):
        open_flight(video, **options)


def test_a_log_beside_the_video_that_is_not_known_is_named(video):
    """What is wrong with it is told where it is given."""
    table = video.with_suffix(".csv")
    table.write_text("time_s;vn_m_s\n0;1\n")
    with pytest.raises(BadInput, match=rf"{table.name} beside it is no log that is known: --telemetry"):
        open_flight(video, hfov_deg=60)
    with pytest.raises(BadInput, match="semicolons"):
        open_flight(video, table, hfov_deg=60)


def test_what_was_looked_for_is_told_where_there_is_no_log(video):
    """It said "none inside the video", and nothing of a log beside it."""
    said = r"none inside the video, and no log beside it whose name is v and an ending\. Give --telemetry LOG"
    with pytest.raises(BadInput, match=said):
        open_flight(video, hfov_deg=60)


def test_a_video_that_lost_its_track_takes_that_of_another_copy(video, tmp_path):
    original = add_gpmf(
        make_video(tmp_path / "original.mp4", range(0, 2000, 40)),
        [lned_payload([(0, 1.0, 2.0, 3.0)] * 4)] * 2,
    )
    with open_flight(video, original, hfov_deg=60) as flight:
        assert "GPMF in the video" in flight.telemetry_name
    with pytest.raises(BadInput, match="a video without telemetry inside"):
        open_flight(original, video, hfov_deg=60)


def test_a_log_of_another_time_is_refused_with_both_spans(video, tmp_path):
    with pytest.raises(BadInput, match=r"0\.000 s to (1\.9|2\.0).*got 5\.000 s to 6\.000 s"):
        open_flight(video, log(tmp_path, [5000, 6000]), hfov_deg=60)


def test_a_log_before_the_chosen_part_is_refused(video, tmp_path):
    with pytest.raises(BadInput, match=r"1\.000 s to"):
        open_flight(video, log(tmp_path, [0, 500]), hfov_deg=60, start_s=1)
