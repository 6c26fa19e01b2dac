"""Commands that read a log beside a video take the recording of that video, as `run` does."""

from types import SimpleNamespace

import pytest
from flight_files import make_video

from flightdepth.cli import main
from flightdepth.commands.live_sources import recorded
from flightdepth.errors import BadInput
from flightdepth.flight import open_flight
from tests_dji_records import airdata, record
from tests_logs import ulog_flight

BOTH = ((5, 15), (30, 50))


@pytest.fixture
def video(tmp_path):
    """20 seconds."""
    return make_video(tmp_path / "DJI_0002.MP4", range(0, 20_000, 100), rate=10)


def live(video, log, offset=0.0):
    settings = SimpleNamespace(mavlink=None, telemetry=log, telemetry_offset=offset, camera=None, hfov=73.0)
    return recorded(settings, SimpleNamespace(paced=True, target=str(video), name="video"))[0]


@pytest.mark.parametrize(("offset", "first_s"), [(0.0, -30.05), (0.5, -29.55)])
def test_live_plays_the_recording(video, tmp_path, offset, first_s):
    log = tmp_path / "log.csv"
    log.write_text(airdata(record(recordings=BOTH)), encoding="utf-8")
    assert live(video, log, offset).samples[0].stamp_ns / 1e9 == pytest.approx(first_s)


def test_live_refuses_what_may_be_any(video, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(airdata(record(recordings=((5, 15), (30, 40)))), encoding="utf-8")
    with pytest.raises(BadInput, match=r"--telemetry-offset -30\.05"):
        live(video, log)
    assert live(video, log, -30.05).samples[0].stamp_ns / 1e9 == pytest.approx(-30.05)


def test_live_doubts_a_recording_of_another_length(video, tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_text(airdata(record(recordings=((5, 55),))), encoding="utf-8")
    live(video, log, -3.0)
    assert "recording of 50 s" not in capsys.readouterr().err
    live(video, log)
    said = " ".join(capsys.readouterr().err.split())
    assert "recording of 50 s, the video has 20 s" in said


def test_a_refusal_offers_what_the_command_takes(video, tmp_path, capsys):
    """`live` has no auto, `cameras` no offset, and who asked the pictures in vain need not ask again."""
    log = tmp_path / "log.csv"
    log.write_text(airdata(record(recordings=((5, 15), (30, 40)))), encoding="utf-8")
    given = [str(video), "--telemetry", str(log)]
    auto = [*given, "--hfov", "73", "--out", str(tmp_path / "out"), "--telemetry-offset", "auto"]
    assert main(["run", *auto]) == 2
    tried = " ".join(capsys.readouterr().err.split())
    assert "--telemetry-offset auto: unknown: turn rate: " in tried
    assert tried.endswith("Give the offset of the right one.")
    with pytest.raises(
        BadInput, match=r"Give the offset of the right one, or let run --telemetry-offset auto"
    ):
        live(video, log)
    assert main(["cameras", *given]) == 2
    assert capsys.readouterr().err.split()[-1].endswith(")")  # the list, and no word of an option


def test_a_run_is_refused_in_one_line(video, tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_text(airdata(record(recordings=((5, 15), (30, 40)))), encoding="utf-8")
    code = main(["run", str(video), "--telemetry", str(log), "--hfov", "73", "--out", str(tmp_path / "out")])
    assert code == 2
    said = capsys.readouterr().err
    assert said.count("error:") == 1
    assert "1: 10 s, --telemetry-offset -5.05; 2: 10 s, --telemetry-offset -30.05" in " ".join(said.split())


def test_live_tells_of_a_gap_in_the_log(video, tmp_path, capsys):
    """Nothing was said of it, nor of a log that tells a velocity seldom."""
    log = tmp_path / "log.csv"
    rows = [f"{k / 10},{1 + k / 100},0,0" for k in (*range(80), *range(120, 200))]
    log.write_text("\n".join(["time_s,vn_m_s,ve_m_s,vd_m_s", *rows, ""]), encoding="utf-8")
    live(video, log)
    said = " ".join(capsys.readouterr().err.split())
    assert "the log tells no velocity from 7.900 s to 12.000 s of the video" in said


@pytest.mark.parametrize(("seconds", "doubted"), [(60, True), (21, False), (5, True)])
def test_a_log_of_an_autopilot_and_a_video_of_another_length(video, tmp_path, capsys, seconds, doubted):
    """They were taken to begin together without a word, so depth came from another part of the flight."""
    log = tmp_path / "log.ulg"
    log.write_bytes(ulog_flight(seconds * 10 + 1))
    said = f"the log lasts {seconds} s, the video 20 s, and both are taken to begin together"
    live(video, log)
    assert (said in " ".join(capsys.readouterr().err.split())) == doubted
    live(video, log, 1.0)
    assert "begin together" not in " ".join(capsys.readouterr().err.split())
    for offset_s, told in ((0.0, doubted), (1.0, False)):
        with open_flight(video, log, hfov_deg=73, telemetry_offset_s=offset_s) as flight:
            assert any(said in line for line in flight.warnings) == told
