"""`flightdepth run` with a log that knows the time of day."""

import pytest
from command_flights import FRAMES, make_log, make_video

from flightdepth.cli import main
from flightdepth.outputs import FlightFolder
from tests_logs import START_US, px4_gps, ulog_flight, written

UTC_S = 1_777_627_800  # 1 May 2026, 9:30


@pytest.fixture
def run(tmp_path, save_difference_network, capsys):
    """Run the command; (what it said, output folder)."""
    network = save_difference_network()
    make_video(tmp_path / "flight.mp4")
    gps = [px4_gps(START_US + i * 200_000, UTC_S * 10**6 + i * 200_000) for i in range(20)]
    log = written(tmp_path / "log.ulg", ulog_flight(40, gps=gps))

    def call(*options, telemetry=log):
        out = tmp_path / "out"
        arguments = [
            "run",
            tmp_path / "flight.mp4",
            "--hfov",
            90,
            "--telemetry",
            telemetry,
            "--network",
            network,
        ]
        assert main([str(argument) for argument in [*arguments, "--out", out, *options]]) == 0
        return " ".join("".join(capsys.readouterr()).split()), FlightFolder(out)

    return call


def test_frames_have_the_time_at_which_they_were_taken(run):
    """The video began 2 s into the log, whose time 0 is 9:30:00."""
    said, flight = run("--telemetry-offset", -2)
    assert (
        "universal time of the first picture: 2026-05-01T09:30:02.000Z by the satellites, if the offset"
        in said
    )
    assert [row.utc_ns for row in flight.rows] == [(UTC_S + 2) * 10**9 + row.stamp_ns for row in flight.rows]
    assert len(flight.rows) == FRAMES
    assert all(pose.utc_ns == flight.rows[index].utc_ns for index, pose in flight.poses.items())
    assert flight.poses


def test_a_part_of_a_flight_has_the_same_times(run):
    whole = {row.stamp_ns: row.utc_ns for row in run("--telemetry-offset", -2)[1].rows}
    part = {
        row.stamp_ns: row.utc_ns
        for row in run("--telemetry-offset", -2, "--start", 0.2, "--end", 0.5)[1].rows
    }
    assert 0 < len(part) < len(whole)
    assert part.items() <= whole.items()


def test_an_offset_that_nobody_told_is_said(run):
    said, flight = run()
    assert "2026-05-01T09:30:00.000Z by the satellites, if video and log began together" in said
    assert flight.rows[0].utc_ns == UTC_S * 10**9


def test_a_log_without_the_time_of_day(run, tmp_path):
    said, flight = run(telemetry=make_log(tmp_path / "log.csv"))
    assert "universal time" not in said
    assert {row.utc_ns for row in flight.rows} == {None}
