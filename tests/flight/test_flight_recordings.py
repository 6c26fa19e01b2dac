"""Which recording of a log a video is, and what is said where nobody knows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flight_files import make_video

from flightdepth.errors import BadInput
from flightdepth.flight import open_flight
from flightdepth.flight.recordings import at_recording, doubted_length, recordings_in, searched_s
from flightdepth.flight.records import NS_PER_S, Recording, Telemetry, VelocitySample
from tests_dji_records import airdata, flight_reader, record

S = NS_PER_S


def told(*recordings, length_s=600):
    samples = tuple(VelocitySample(second * S, np.array((1.0, 0, 0))) for second in range(length_s))
    return Telemetry("log", samples, recordings=recordings)


def flag(text):
    """Recordings of a flag with a row a second."""
    up = np.array([letter == "#" for letter in text])
    return [
        (each.start_ns / S, each.end_ns / S, each.start_told, each.end_told)
        for each in recordings_in(np.arange(len(up)) * S, up)
    ]


def test_a_recording_begins_and_ends_between_two_rows():
    assert flag("..###...##..") == [(1.5, 4.5, True, True), (7.5, 9.5, True, True)]


def test_what_the_log_did_not_see_begin_or_end_is_told():
    assert flag("###...##") == [(0, 2.5, False, True), (5.5, 7, True, False)]
    assert flag("####") == [(0, 3, False, False)]
    assert flag("....") == flag("") == []


def test_flickers_are_no_recordings():
    stamps = np.arange(200) * S // 10
    up = np.zeros(200, dtype=bool)
    up[20:100], up[60:63], up[150:152] = True, False, True
    assert recordings_in(stamps, up) == (Recording(1_950_000_000, 9_950_000_000),)


def test_a_flicker_ends_no_recording_that_the_log_did_not_see_end():
    up = np.ones(200, dtype=bool)
    up[:20] = up[60:63] = False
    assert recordings_in(np.arange(200) * S // 10, up) == (
        Recording(1_950_000_000, 19_900_000_000, end_told=False),
    )


@pytest.mark.parametrize(("end_told", "duration_s"), [(False, 700), (True, 0)])
def test_where_the_log_did_not_see_a_recording_end_or_the_video_has_no_length_it_began_with_the_log(
    end_told, duration_s
):
    log = told(Recording(5 * S, 599 * S, start_told=False, end_told=end_told))
    assert at_recording(log, duration_s * S).samples[0].stamp_ns == -5 * S


def test_the_recording_as_long_as_the_video_is_taken():
    log = told(Recording(10 * S, 40 * S), Recording(100 * S, 284 * S), Recording(300 * S, 330 * S))
    moved = at_recording(log, 185 * S)
    assert moved.samples[0].stamp_ns == -100 * S
    assert moved.recordings == (Recording(0, 184 * S),)
    assert moved.name == (
        "log; time 0 is the start of recording 2 of 3, 184 s long, 100.0 s after its first velocity"
    )
    assert doubted_length(moved, 185 * S) == ()


@pytest.mark.parametrize("duration_s", [30, 100, 0])
def test_none_or_several_that_fit_are_refused_with_the_offset_of_each(duration_s):
    log = told(Recording(10 * S, 40 * S), Recording(100 * S, 284 * S), Recording(300 * S, 330 * S))
    with pytest.raises(BadInput) as refused:
        at_recording(log, duration_s * S)
    assert "3 (1: 30 s, --telemetry-offset -10.00; 2: 184 s, --telemetry-offset -100.00; 3: 30 s" in str(
        refused.value
    )
    assert "auto" in str(refused.value)
    assert at_recording(log, duration_s * S, offset_given=True) is log


@pytest.mark.parametrize(("apart_s", "fits"), [(-2.1, False), (-1.9, True), (1.9, True), (2.1, False)])
def test_a_recording_fits_a_video_that_is_up_to_two_seconds_longer_or_shorter(apart_s, fits):
    log, duration_ns = (
        told(Recording(10 * S, 40 * S), Recording(100 * S, 284 * S)),
        round((184 + apart_s) * S),
    )
    moved = at_recording(log, duration_ns, offset_given=True)
    assert (moved is not log) == fits
    alone = at_recording(told(Recording(100 * S, 284 * S)), duration_ns)
    assert (doubted_length(alone, duration_ns) == ()) == fits
    assert searched_s(alone, duration_ns) == (3.0 if fits else None)


def test_a_recording_of_which_the_log_saw_a_part_fits_every_longer_video_where_no_whole_one_does():
    log = told(Recording(0, 50 * S, start_told=False), Recording(100 * S, 284 * S))
    assert at_recording(log, 48_100_000_000).samples[0].stamp_ns == -1_900_000_000
    assert at_recording(log, 47_900_000_000, offset_given=True) is log
    assert at_recording(log, 185 * S).samples[0].stamp_ns == -100 * S


def test_nobody_knows_how_far_off_a_log_is_whose_video_tells_no_length():
    log = told(Recording(10 * S, 40 * S))
    assert searched_s(at_recording(log, 0), 0) is None
    assert searched_s(told(), 30 * S) is None


def test_of_a_video_without_a_length_no_part_of_a_recording_is_taken_for_it():
    """Of 1.5 s that the log saw the end of, beside 300 s that it saw whole."""
    with pytest.raises(BadInput, match=r"one recording \(the video tells no length\), got 2"):
        at_recording(told(Recording(0, 3 * S // 2, start_told=False), Recording(20 * S, 320 * S)), 0)


def test_an_offset_that_a_refusal_names_counts_as_given():
    """0.00 was none."""
    log = told(Recording(0, 30 * S, start_told=False), Recording(50 * S, 80 * S))
    with pytest.raises(BadInput, match=r"got 2 \(1: at least 30 s, --telemetry-offset 0.01; 2: 30 s"):
        at_recording(log, 0)


def test_of_many_recordings_nine_are_listed():
    log = told(*(Recording(20 * k * S, (20 * k + 10) * S) for k in range(11)))
    with pytest.raises(
        BadInput, match=r"got 11 \(1: 10 s, .*; 9: 10 s, --telemetry-offset -160.00; and 2 more\)"
    ):
        at_recording(log, 10 * S)
    with pytest.raises(BadInput, match=r"\(the video tells no length\)"):
        at_recording(log, 0)


@pytest.mark.parametrize(("apart_s", "doubted"), [(-2.1, True), (-1.9, False), (1.9, False), (2.1, True)])
def test_a_log_that_knows_of_no_video_is_doubted_where_it_is_of_another_length(apart_s, doubted):
    log, duration_ns = replace(told(length_s=101), time_0_told=False), round((100 + apart_s) * S)
    assert bool(doubted_length(log, duration_ns)) == doubted
    assert doubted_length(log, 0) == ()


def test_a_recording_begun_before_the_log_is_placed_by_its_end():
    log = told(Recording(0, 50 * S, start_told=False), Recording(100 * S, 130 * S))
    moved = at_recording(log, 60 * S)
    assert moved.samples[0].stamp_ns == 10 * S
    assert "recording 1 of 2, at least 50 s long, -10.0 s after" in moved.name
    assert at_recording(log, 30 * S).samples[0].stamp_ns == -100 * S


def test_the_only_recording_is_taken_and_doubted_where_its_length_differs():
    log = told(Recording(10 * S, 330 * S))
    moved = at_recording(log, 100 * S)  # trimmed, or split by the camera
    assert moved.samples[0].stamp_ns == -10 * S
    [doubt] = doubted_length(moved, 100 * S)
    assert "recording of 320 s, the video has 100 s" in doubt
    assert "--telemetry-offset auto" in doubt
    assert doubted_length(at_recording(log, 321 * S), 321 * S) == ()
    assert doubted_length(at_recording(log, 0), 0) == ()


def test_a_recording_that_never_begins_or_ends_is_doubted():
    log = told(Recording(0, 599 * S, start_told=False, end_told=False))
    assert "recorded when the log began" in doubted_length(at_recording(log, 700 * S), 700 * S)[0]


@pytest.mark.parametrize(("start_told", "end_told"), [(False, True), (True, False)])
def test_a_recording_of_which_the_log_saw_little_is_doubted(start_told, end_told):
    """A part of 100 s, cut from the one of 184 s, was taken for the last seconds of the flight without a word."""
    partly = Recording(300 * S, 310 * S, start_told, end_told)
    moved = at_recording(told(Recording(100 * S, 284 * S), partly), 100 * S)
    [doubt] = doubted_length(moved, 100 * S)
    assert "recording of at least 10 s, the video has 100 s" in doubt
    assert doubted_length(at_recording(told(partly), 19 * S), 19 * S) == ()


def test_a_log_without_recordings_stays_as_it_is():
    log = told()
    assert at_recording(log, 5 * S) is log
    assert doubted_length(log, 5 * S) == ()


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """20 seconds."""
    return make_video(tmp_path_factory.mktemp("video") / "DJI_0002.MP4", range(0, 20_000, 100), rate=10)


def first_stamp_s(flight):
    return next(iter(flight._telemetry.samples)).stamp_ns / S


def opened(video, log, text, **options):
    log.write_text(text, encoding="utf-8")
    return open_flight(video, log, hfov_deg=73, **options)


def test_a_flight_takes_the_recording_of_the_video(video, tmp_path):
    text = airdata(record(recordings=((5, 15), (30, 50))))
    with opened(video, tmp_path / "log.csv", text) as flight:
        assert first_stamp_s(flight) == pytest.approx(-30.05)
        assert "recording 2 of 2, 20 s long" in flight.telemetry_name
        assert not any("recording" in line for line in flight.warnings)


def test_a_number_of_seconds_is_added_to_the_recording_s_times(video, tmp_path):
    text = airdata(record(recordings=((5, 15), (30, 50))))
    with opened(video, tmp_path / "log.csv", text, telemetry_offset_s=0.25) as flight:
        assert first_stamp_s(flight) == pytest.approx(-29.8)


def test_the_offset_that_the_refusal_names_picks_the_recording(video, tmp_path):
    text = flight_reader(record(recordings=((5, 15), (30, 40))))
    with pytest.raises(
        BadInput, match=r"2 \(1: 10 s, --telemetry-offset -5.05; 2: 10 s, --telemetry-offset -30"
    ):
        opened(video, tmp_path / "log.csv", text)
    with opened(video, tmp_path / "log.csv", text, telemetry_offset_s=-30.05) as flight:
        assert first_stamp_s(flight) == pytest.approx(-30.05)


def test_an_offset_that_no_picture_tells_picks_no_recording(video, tmp_path):
    text = airdata(record(recordings=((5, 15), (30, 40))))
    with pytest.raises(BadInput, match="expected one recording of 20 s"):
        opened(video, tmp_path / "log.csv", text, telemetry_offset_s="auto")


def test_a_video_of_another_length_is_doubted_unless_an_offset_is_given(video, tmp_path):
    text = airdata(record(recordings=((5, 55),)))
    with opened(video, tmp_path / "log.csv", text) as flight:
        assert any("recording of 50 s, the video has 20 s" in line for line in flight.warnings)
    with opened(video, tmp_path / "log.csv", text, telemetry_offset_s=-3.0) as flight:
        assert not any("recording" in line for line in flight.warnings)


def test_who_asked_the_pictures_in_vain_need_not_ask_again(video, tmp_path):
    """The next warning told him to try `--telemetry-offset auto`."""
    text = airdata(record(recordings=((5, 55),)))
    with opened(video, tmp_path / "log.csv", text, telemetry_offset_s="auto") as flight:
        [doubt] = (line for line in flight.warnings if "recording of 50 s, the video has 20 s" in line)
    assert doubt.endswith("time 0 may be elsewhere: give the seconds, as --telemetry-offset S")


def test_without_a_recording_time_0_is_the_first_velocity(video, tmp_path):
    text = airdata(record(recordings=(), start_s=100))
    with opened(video, tmp_path / "log.csv", text) as flight:
        assert first_stamp_s(flight) == 0
        assert "time 0 is its first velocity, 100.000 s of its clock" in flight.telemetry_name
        assert any("the video 20 s, and both are taken to begin together" in line for line in flight.warnings)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="stands for a file that may not be read")
def test_a_file_of_the_video_s_name_that_cannot_be_read_is_no_log(tmp_path):
    """It ended the run, though nobody had named it."""
    path = make_video(tmp_path / "DJI_0003.MP4", range(0, 20_000, 100), rate=10)
    (tmp_path / "DJI_0003.csv").write_text(airdata(record(recordings=((5, 25),))), encoding="utf-8")
    (tmp_path / "DJI_0003.LRF").symlink_to("/proc/self/mem")
    with open_flight(path, hfov_deg=73) as flight:
        assert first_stamp_s(flight) == pytest.approx(-5.05)


def test_a_log_of_the_video_s_name_beside_it_is_found(tmp_path):
    path = make_video(tmp_path / "DJI_0003.MP4", range(0, 20_000, 100), rate=10)
    (tmp_path / "DJI_0003.csv").write_text(airdata(record(recordings=((5, 25),))), encoding="utf-8")
    with open_flight(path, hfov_deg=73) as flight:
        assert first_stamp_s(flight) == pytest.approx(-5.05)
