"""`flightdepth run` with the log of an autopilot that was powered before the camera."""

import numpy as np
import pytest
from command_flights import FRAMES, make_video

from flightdepth.cli import main
from flightdepth.outputs import FlightFolder
from tests_logs import dataflash_flight, tlog_flight, ulog_flight, velocity, written


@pytest.fixture
def run(tmp_path, save_difference_network, capsys):
    """Run the command on a log; (exit code, stderr, output folder)."""
    network = save_difference_network()
    make_video(tmp_path / "flight.mp4")

    def call(data, *options):
        log, out = written(tmp_path / "log", data), tmp_path / "out"
        arguments = ["run", tmp_path / "flight.mp4", "--hfov", 90, "--telemetry", log, "--network", network]
        code = main([str(argument) for argument in [*arguments, "--out", out, *options]])
        return code, capsys.readouterr().err, out

    return call


@pytest.mark.parametrize("flight", [ulog_flight, dataflash_flight, tlog_flight])
def test_a_log_that_began_before_the_video(run, flight):
    code, _, out = run(flight(40), "--telemetry-offset", -2)
    assert code == 0
    folder = FlightFolder(out)
    assert folder.record.counts.frames_with_depth > FRAMES / 2
    # Velocity rises evenly, so its mean between two pictures is that of the moment half way: 2 s into the
    # log at the first picture, 10 records and 30 pictures a second.
    last = folder.rows[-1]
    half_way = 20 + (FRAMES - 1 - last.shifts[0] / 2) / 3
    flown_m = np.linalg.norm(velocity(half_way)) * last.shifts[0] / 30
    assert last.displacements_m[0] == pytest.approx(flown_m, rel=1e-3)


def test_a_log_that_began_elsewhere_is_refused_in_one_line(run):
    code, stderr, out = run(ulog_flight(40), "--telemetry-offset", 60)
    assert code == 2
    assert len(stderr.splitlines()) == 1 and "--telemetry-offset" in stderr
    assert not out.exists()


def test_a_damaged_log_tells_what_was_left_out(run):
    code, _, out = run(tlog_flight(40)[:-9])
    assert code == 0
    assert "bytes skipped: damaged or cut off" in FlightFolder(out).record.counts.dropped
