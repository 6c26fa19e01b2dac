"""`flightdepth evaluate tracks` on the forward leg of the sample flight."""

import re

import pytest

from flightdepth import cli
from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO


def test_the_slopes_of_a_flight_straight_ahead_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--telemetry", str(LOG), "--camera", str(CALIBRATION), "--network", "motion-tiny"]
    options += ["--ranges", "1", "--end", "1.5", "--least-span", "2"]
    assert cli.main(["evaluate", "tracks", str(VIDEO), *options]) == 0
    said = capsys.readouterr().out
    found = re.search(r"began\s+all:\s+(-?[\d.]+)\s+\[(-?[\d.]+), (-?[\d.]+)\]\s+(\d+) points", said)
    assert found is not None
    assert re.search(r"OpenVINO .*, weights [0-9a-f]{16}, commit \w+", said)
    median, low, high, points = map(float, found.groups())
    assert low <= median <= high
    assert points >= 20


@pytest.mark.parametrize("metres", ["nan", "-3", "inf"])
def test_a_span_that_is_no_length_is_refused_before_the_flight(capsys, metres) -> None:
    assert cli.main(["evaluate", "tracks", str(VIDEO), "--least-span", metres]) == 2
    assert "--least-span: expected 0 m or more" in capsys.readouterr().err
