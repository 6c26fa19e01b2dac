import json

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion
from tests_recordings import parrot_csv, parrot_json

VELOCITY = (3.0, -4.0, 0.5)


def read(tmp_path, text):
    path = tmp_path / "flight.txt"
    path.write_text(text)
    return read_telemetry(path)


def folded_csv(velocity, *, protobuf):
    """What `vmeta_json_to_csv.py` makes of the JSON: nested names joined, cells between commas."""
    rows = json.loads(parrot_json(velocity, protobuf=protobuf))["frame"]

    def folded(value, name):
        if isinstance(value, dict):
            return [pair for key, inner in value.items() for pair in folded(inner, [*name, key])]
        return [("_".join(name), "" if isinstance(value, list) else str(value))]

    table = [dict(folded(row, [])) for row in rows]
    return "\n".join([",".join(table[0]), *(",".join(row.values()) for row in table)]) + "\n"


TEXTS = {
    "version 3 CSV": parrot_csv(VELOCITY),
    "version 3 CSV, no location": parrot_csv(VELOCITY, located=False),
    "version 3 JSON": parrot_json(VELOCITY),
    "version 3 JSON, pretty": parrot_json(VELOCITY, indent=2),
    "protobuf JSON": parrot_json(VELOCITY, protobuf=True),
    "version 3 JSON as CSV": folded_csv(VELOCITY, protobuf=False),
    "protobuf JSON as CSV": folded_csv(VELOCITY, protobuf=True),
}


@pytest.mark.parametrize("layout", TEXTS)
def test_velocity_and_attitude_come_back(tmp_path, layout):
    telemetry = read(tmp_path, TEXTS[layout])
    velocities = telemetry.velocities
    assert np.array([sample.velocity for sample in velocities]).tolist() == [list(VELOCITY)] * 10
    assert [sample.stamp_ns for sample in velocities] == [33_333_000 * index for index in range(10)]
    attitude = telemetry.attitudes[0]
    axes = rotation_from_quaternion(attitude.world_from_camera)
    assert np.allclose(axes, [[-1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-4)  # right south, down, forward east
    assert [body.world_from_body.tolist() for body in telemetry.body_attitudes] == [[1, 0, 0, 0]] * 10
    assert telemetry.counts == {}


def test_version_1_gives_velocity_only(tmp_path):
    header = (
        "time drone_attitude_yaw speed_x speed_y speed_z frame_quat_w frame_quat_x frame_quat_y frame_quat_z"
    )
    telemetry = read(tmp_path, f"{header}\n0 0.1 1.5 0.0 -0.5 1.0 0.0 0.0 0.0\n")
    assert len(telemetry.samples) == 1
    assert telemetry.samples[0].velocity.tolist() == [1.5, 0, -0.5]


def test_the_one_altitude_of_older_libraries_is_above_the_sea(tmp_path):
    """Before the library told two heights it called the one `altitude`, "ASL": it was not read."""
    cells = [line.split() for line in parrot_csv(VELOCITY).splitlines()]
    at = cells[0].index("location_altitude_wgs84ellipsoid")
    older = [[*row[:at], "location_altitude", *row[at + 4 :]] for row in cells[:1]]
    older += [[*row[:at], "100.00", *row[at + 4 :]] for row in cells[1:]]
    telemetry = read(tmp_path, "\n".join(map(" ".join, older)) + "\n")
    assert telemetry.places.above == SEA_LEVEL
    assert telemetry.places.places[0].tolist() == [48.7, 2.2, 100]
    assert telemetry.velocities[0].velocity.tolist() == list(VELOCITY)


def test_rows_that_lost_a_cell_are_counted(tmp_path):
    header, first, *others = parrot_csv(VELOCITY).splitlines()
    short = first.replace("25.00 ", "")
    assert read(tmp_path, "\n".join([header, short, *others]) + "\n").counts == {
        "rows without a time, a speed or a sound view": 1
    }


@pytest.mark.parametrize(
    ("column", "value"),
    [("time", "-1"), ("time", "1e30"), ("speed_north", "151.0"), ("speed_down", "-151.0")],
)
def test_rows_beyond_reason_are_counted(tmp_path, column, value):
    rows = [line.split() for line in parrot_csv(VELOCITY).splitlines()]
    rows[3][rows[0].index(column)] = value
    telemetry = read(tmp_path, "\n".join(map(" ".join, rows)) + "\n")
    assert len(telemetry.velocities) == 9
    assert telemetry.counts == {"rows beyond reason": 1}


def test_a_table_that_was_cut_off_loses_its_last_row(tmp_path):
    telemetry = read(tmp_path, parrot_csv(VELOCITY).rstrip("\n"))
    assert len(telemetry.velocities) == 9
    assert telemetry.counts == {"rows cut off at the end": 1}


def test_a_list_that_was_cut_off_between_two_frames_is_counted(tmp_path):
    text = parrot_json(VELOCITY)
    telemetry = read(tmp_path, text[: text.rindex("]")])
    assert len(telemetry.velocities) == 10
    assert telemetry.counts == {"lists of frames cut off": 1}


def test_the_name_counts_what_is_used(tmp_path):
    header, first, *others = parrot_csv(VELOCITY).splitlines()
    telemetry = read(tmp_path, "\n".join([header, first, first, *others]) + "\n")
    assert telemetry.counts["velocities not later than the one before"] == 1
    assert ": 10 velocities" in telemetry.name


def test_metadata_without_a_speed_is_refused(tmp_path):
    with pytest.raises(BadInput, match="Parrot metadata with a speed"):
        read(tmp_path, '{"session": {}, "frame": [{"time": 0, "metadata": {}}]}')


def test_a_frame_nested_too_deep_costs_only_itself(tmp_path):
    """From Python 3.12 on its JSON is read, however deep, and what joined the names of a frame's parts gave up."""
    deep = '{"a": ' * 1400 + "1" + "}" * 1400
    text = parrot_json(VELOCITY).replace('"metadata": {', f'"metadata": {{"deep": {deep}, ', 1)
    telemetry = read(tmp_path, text)
    assert len(telemetry.velocities) == 9
    assert telemetry.counts == {"damaged or cut frames": 1}


@pytest.mark.parametrize("text", [parrot_csv(VELOCITY), parrot_json(VELOCITY)], ids=["csv", "json"])
def test_utf16_is_read(tmp_path, text):
    """Its reader knew it, what recognises it did not."""
    path = tmp_path / "flight.txt"
    path.write_text(text, encoding="utf-16")
    assert len(read_telemetry(path).velocities) == 10
