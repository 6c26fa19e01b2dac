"""`flightdepth evaluate tracks` on the forward leg of the sample flight."""

import re

import cv2
import numpy as np
import pytest

from flightdepth import cli, flight, ranges
from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO
from flightdepth.errors import BadInput


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


class Asked(BadInput):
    """Ends a command once it asked for what a test wants to know."""

    def __init__(self) -> None:
        super().__init__("enough", expected="no more", got="seen")


@pytest.mark.parametrize("command", ["tracks", "baselines"])
def test_clock_and_mount_are_told_as_to_run(monkeypatch, command) -> None:
    def opened(*_, **options):
        assert (options["telemetry_offset_s"], options["mount_pitch_deg"]) == (-1.5, -20.0)
        raise Asked

    monkeypatch.setattr(flight, "open_flight", opened)
    told = ["--telemetry-offset", "-1.5", "--mount-pitch", "-20"]
    assert cli.main(["evaluate", command, str(VIDEO), *told]) == Asked.exit_code


def test_what_a_mask_hides_moves_no_camera(monkeypatch, tmp_path) -> None:
    mask = np.full((360, 640), 255, np.uint8)
    mask[300:] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    seen = []

    def made(network, camera, *, ranges, mask):
        seen.append(mask)
        raise Asked

    monkeypatch.setattr(ranges, "MultiRangeEstimator", made)
    options = ["--telemetry", LOG, "--camera", CALIBRATION, "--mask", tmp_path / "mask.png"]
    assert cli.main(["evaluate", "tracks", str(VIDEO), *map(str, options)]) == Asked.exit_code
    assert np.array_equal(seen[0], mask > 0)
