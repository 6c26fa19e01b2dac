"""Prometheus text: every line by the format's grammar, values in base units."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.flight.turned_focal import TurnedFocal
from flightdepth.live.metrics import prometheus
from flightdepth.live.obstacles import SECTORS, Sectors
from flightdepth.live.status import FrameCounts, Health, LiveStatus, SinkCounts, State

SAMPLE = re.compile(r'[a-z_]+(\{([a-z_]+="([^"\\\n]|\\["\\n])*",?)*\})? -?\d+(\.\d+)?(e[+-]?\d+)?')
STATUS = LiveStatus(
    stamp_ns=10,
    health=Health(State.DEGRADED, "hovering", 0),
    age_ms=41.5,
    age_p95_ms=58.0,
    frames=FrameCounts(3_000_001, 2990, {'a "newer" one\ncame': 11}),
    ranges=2,
    shifts=(3, 12),
    displacements_m=(0.25, 1.5),
    fps_in=29.97,
    fps=29.5,
    telemetry_hz=30.0,
    telemetry_age_ms=12.0,
    uptime_s=100.25,
    reconnects=1,
    sinks={"page": SinkCounts(100, 3, 0)},
)


def values(text: str) -> dict[str, float]:
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return {line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in lines}


def test_every_line_is_of_the_format():
    text = prometheus(STATUS, Sectors.unknown())
    assert text.endswith("\n")
    for line in text.splitlines():
        assert re.match(r"# (HELP|TYPE) flightdepth_[a-z0-9_]+ \S", line) or SAMPLE.fullmatch(
            line.replace("p95", "p")
        ), line


def test_each_family_is_told_once_and_before_its_samples():
    told: list[str] = []
    for line in prometheus(STATUS, Sectors.unknown()).splitlines():
        if line.startswith("# TYPE "):
            told.append(line.split()[2])
        elif not line.startswith("#"):
            assert re.split(r"[{ ]", line)[0] == told[-1]
    assert len(told) == len(set(told)) > 15


def test_values_in_seconds_and_metres():
    found = values(prometheus(STATUS))
    assert found["flightdepth_age_seconds"] == 0.0415
    assert found["flightdepth_age_p95_seconds"] == 0.058
    assert found["flightdepth_frames_received_total"] == 3_000_001
    assert found['flightdepth_displacement_metres{range="2"}'] == 1.5
    assert found['flightdepth_shift_frames{range="1"}'] == 3
    assert found['flightdepth_frames_dropped_total{reason="a \\"newer\\" one\\ncame"}'] == 11
    assert found['flightdepth_sink_results_total{sink="page",outcome="missed"}'] == 3


def test_whose_clock_the_age_counts_from():
    assert values(prometheus(STATUS))["flightdepth_age_from_sender"] == 0
    assert values(prometheus(replace(STATUS, age_from="sender")))["flightdepth_age_from_sender"] == 1


def test_one_state_at_a_time():
    found = values(prometheus(STATUS))
    states = {state: found[f'flightdepth_health{{state="{state.value}"}}'] for state in State}
    assert states == {State.OK: 0, State.DEGRADED: 1, State.LOST: 0}


@pytest.mark.parametrize(
    ("verdict", "denied"),
    [
        (TurnVerdict(TurnedFocal(None), doubt="focal length 390 px"), 1.0),
        (TurnVerdict(TurnedFocal(None, share=0.02), off=0.01), 0.0),
        (TurnVerdict(TurnedFocal(None)), None),
        (None, None),
    ],
)
def test_whether_turns_deny_the_lens(verdict, denied):
    assert values(prometheus(replace(STATUS, lens=verdict))).get("flightdepth_lens_denied") == denied


def test_what_is_not_known_is_left_out():
    text = prometheus(LiveStatus(0, Health(State.LOST, "no stream", 0)))
    assert "age_seconds" not in text and "obstacle" not in text


def test_the_nearest_obstacle():
    sectors = Sectors.unknown()
    assert "obstacle_nearest_metres" not in prometheus(STATUS, sectors)
    sectors.obstacle_m[3], sectors.obstacle_m[9] = 12.5, 8.25
    sectors.clear_m[20:30] = 40.0
    found = values(prometheus(STATUS, sectors))
    assert found["flightdepth_obstacle_nearest_metres"] == 8.25
    assert found["flightdepth_obstacle_sectors"] == 2 and found["flightdepth_known_sectors"] == 12
    assert np.isnan(sectors.obstacle_m).sum() == SECTORS - 2
