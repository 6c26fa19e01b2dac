"""`flightdepth run` of the sample flight with a log in other axes: told, and not followed."""

import csv

import numpy as np
import pytest

from flightdepth.cli import main
from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO
from flightdepth.outputs import FlightFolder

SECONDS = "0.9"


def east_north_up(row):
    north, east, down = (row[f"v{axis}_m_s"] for axis in "ned")
    return row | {"vn_m_s": east, "ve_m_s": north, "vd_m_s": str(-float(down))}


def run(folder, log, capsys):
    """The flight's folder, and what was said and warned of."""
    given = ["--camera", str(CALIBRATION), "--telemetry", str(log), "--network", "motion-tiny"]
    given += ["--ranges", "1", "--end", SECONDS]
    assert main(["run", str(VIDEO), *given, "--out", str(folder)]) == 0
    return FlightFolder(folder), *(" ".join(text.split()) for text in capsys.readouterr())


def test_axes_that_the_pictures_deny(tmp_path, capsys):
    """East, north, up for north, east, down: it gave 50 % of error with a confidence of 0.8, and no word."""
    with LOG.open(newline="") as file:
        rows = list(csv.DictReader(file))
    with (tmp_path / "enu.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(map(east_north_up, rows))
    right, said_right, warned_right = run(tmp_path / "right", LOG, capsys)
    wrong, said_wrong, warned_wrong = run(tmp_path / "wrong", tmp_path / "enu.csv", capsys)
    assert "deny" not in said_right + warned_right
    assert right.record.notes == wrong.record.notes == ()
    assert "warning: the pictures deny the log's direction of motion, and are followed" in warned_wrong
    assert "`run --telemetry-offset auto` seeks it" in warned_wrong  # `live` says the same, and takes no auto
    assert "deny" not in said_wrong
    *before, warning = wrong.record.source.warnings
    assert tuple(before) == right.record.source.warnings
    frames = int(warning.rsplit("(", maxsplit=1)[1].split()[0])
    assert frames > len(wrong.rows) / 2
    one, other = (each.depth_m(len(right.rows) - 1) for each in (right, wrong))
    known = np.isfinite(one) & np.isfinite(other)
    assert known.sum() > 0.9 * np.isfinite(one).sum()
    assert np.median(other[known] / one[known]) == pytest.approx(1, abs=0.02)
