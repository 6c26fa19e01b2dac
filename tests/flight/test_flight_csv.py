import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.errors import BadInput
from flightdepth.flight.records import AttitudeSample, VelocitySample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.telemetry_csv import read_csv, write_csv
from flightdepth.motion import rotation_from_quaternion
from tests_recordings import place

WORLD = "time_s,vn_m_s,ve_m_s,vd_m_s\n"
ANGLES = "camera_yaw_deg,camera_pitch_deg,camera_roll_deg"
GOOD = WORLD + "0,1,2,3\n0.5,4,5,6\n"


def read(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text(text)
    return read_csv(path)


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        "\ufeff" + GOOD,
        "\ufeff" + GOOD.replace("\n", "\r\n"),
    ],
)
def test_a_log_that_a_spreadsheet_wrote_is_one(tmp_path, text):
    """Windows line ends, those of Excel's "CSV (Macintosh)" and a mark in front made it "something else"."""
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    assert [sample.velocity.tolist() for sample in read_telemetry(path).samples] == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (GOOD.replace(",", ";").encode(), "got a table with semicolons"),
        (GOOD.replace(",", "\t").encode(), "got a table with tabs"),
        (GOOD.encode("utf-16"), "UTF-16: save it as UTF-8"),
        (b"hello world\n", "got something else"),
    ],
)
def test_what_is_no_log_is_told_as_what_it_is(tmp_path, data, said):
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    with pytest.raises(BadInput, match=said):
        read_telemetry(path)


def test_a_velocity_that_no_drone_has_is_refused(tmp_path):
    """Most likely all of the log is in cm/s."""
    with pytest.raises(BadInput, match=r"line 3: expected at most 150 m/s, got 877.*in m/s"):
        read(tmp_path, WORLD + "0,100,0,0\n0.5,400,500,600\n")


number = st.floats(-80, 80)


@given(
    st.lists(
        st.tuples(st.integers(0, 10**12), number, number, number), min_size=1, unique_by=lambda row: row[0]
    ),
    st.sampled_from(["world", "camera"]),
    st.one_of(st.none(), st.floats(0, 10)),
    st.booleans(),
)
def test_what_is_written_is_read_back(tmp_path_factory, rows, frame, sigma, has_attitude):
    samples = []
    for stamp_ns, *velocity in sorted(rows):
        samples.append(VelocitySample(stamp_ns, velocity, frame, sigma))
        if has_attitude:
            samples.append(AttitudeSample(stamp_ns, [1, *velocity]))
    path = tmp_path_factory.getbasetemp() / "round.csv"
    write_csv(path, samples)
    back = read_csv(path).samples
    assert [sample.stamp_ns for sample in back] == [sample.stamp_ns for sample in samples]
    for new, old in zip(back, samples, strict=True):
        if isinstance(old, VelocitySample):
            assert (new.velocity == old.velocity).all()
            assert (new.frame, new.sigma) == (old.frame, old.sigma)
        else:
            assert np.allclose(new.world_from_camera, old.world_from_camera, atol=1e-15)


def test_seconds_become_nanoseconds(tmp_path):
    assert [sample.stamp_ns for sample in read(tmp_path, GOOD).samples] == [0, 500_000_000]


def test_columns_may_stand_in_any_order(tmp_path):
    sample = read(tmp_path, "vd_m_s, vn_m_s ,stamp_ns,ve_m_s\n3,1,77,2\n").samples[0]
    assert (sample.stamp_ns, sample.velocity.tolist(), sample.frame) == (77, [1, 2, 3], "world")


def test_camera_columns_give_camera_velocity(tmp_path):
    sample = read(tmp_path, "time_s,vx_camera_m_s,vy_camera_m_s,vz_camera_m_s\n1,0,0,5\n").samples[0]
    assert (sample.frame, sample.velocity.tolist()) == ("camera", [0, 0, 5])


def test_an_empty_sigma_is_none(tmp_path):
    samples = read(tmp_path, "time_s,vn_m_s,ve_m_s,vd_m_s,sigma_m_s\n0,1,2,3,\n1,1,2,3,0.5\n").samples
    assert [sample.sigma for sample in samples] == [None, 0.5]


def test_ignored_columns_are_named(tmp_path):
    assert "ignored columns: note" in read(tmp_path, WORLD.replace("\n", ",note\n") + "0,1,2,3,hello\n").name


def test_blank_lines_and_a_byte_order_mark_do_not_matter(tmp_path):
    assert len(read(tmp_path, "\ufeff" + GOOD + "\n\n").samples) == 2


NED_M_S = np.array([4.0, -3.0, -0.5])
PLACES = "time_s,latitude_deg,longitude_deg,altitude_m\n"


def placed(ned, altitude=True):
    latitude, longitude = place(*ned[:2])
    return f"{latitude:.8f},{longitude:.8f}" + f",{500 - ned[2]:.2f}" * altitude


def flown(rows=40, **options):
    return [f"{i / 10},{placed(NED_M_S * i / 10, **options)}" for i in range(rows)]


def test_positions_alone_tell_the_velocity(tmp_path):
    """As a receiver's logger writes them; they were refused, while those of subtitles and of ROS were taken."""
    log = read(tmp_path, PLACES + "\n".join(flown()) + "\n")
    assert log.name == "CSV log.csv: velocity by its positions"
    assert [sample.frame for sample in log.velocities] == ["world"] * 40
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=0.02)
    assert all(0 < sample.sigma < 0.2 for sample in log.velocities)
    assert log.places.at(10**9)[2] == pytest.approx(500.5)
    assert not log.any_direction and log.true_north and log.counts == {}


def test_without_altitudes_a_flight_is_taken_as_level(tmp_path):
    header = PLACES.replace(",altitude_m", "")
    log = read(tmp_path, header + "\n".join(flown(altitude=False)) + "\n")
    assert np.allclose([sample.velocity for sample in log.velocities], (4, -3, 0), atol=0.02)
    assert log.counts == {"positions without an altitude": 40}


def test_an_attitude_beside_positions_is_the_cameras(tmp_path):
    rows = [f"{row},90,-30,0" for row in flown()]
    log = read(tmp_path, PLACES.replace("\n", f",{ANGLES}\n") + "\n".join(rows) + "\n")
    assert (len(log.velocities), len(log.attitudes)) == (40, 40)


def test_positions_that_tell_nothing_are_left_out_and_counted(tmp_path):
    rows = flown()
    rows[0], rows[7], rows[11] = "0.0,,,", "0.7,0,0,0", f"1.1,{placed(NED_M_S + np.array([900, 0, 0]))}"
    log = read(tmp_path, PLACES + "\n".join([*rows, rows[-1]]) + "\n")
    assert np.allclose([sample.velocity for sample in log.velocities], NED_M_S, atol=0.02)
    assert log.counts == {
        "positions without a fix": 2,
        "positions that jump": 1,
        "velocities not later than the one before": 1,
    }


def test_a_velocity_that_is_told_comes_before_that_of_positions(tmp_path):
    log = read(
        tmp_path, PLACES.replace("\n", ",speed_m_s\n") + "\n".join(f"{row},7" for row in flown()) + "\n"
    )
    assert {sample.velocity[0] for sample in log.velocities} == {7}


@pytest.mark.parametrize("rows", [flown(1), ["0,,,", "1,,,"]])
def test_fewer_than_two_positions_tell_no_velocity(tmp_path, rows):
    with pytest.raises(BadInput, match="expected a velocity, or positions that tell one, got none"):
        read(tmp_path, PLACES + "\n".join(rows) + "\n")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "an empty file"),
        ("time,latitude,longitude\n", "or latitude_deg, longitude_deg"),
        (WORLD, "only the header"),
        ("a,b\n1,2\n", "one time column"),
        ("time_s,stamp_ns,vn_m_s,ve_m_s,vd_m_s\n", "one time column"),
        ("time_s,vn_m_s,ve_m_s\n0,1,2\n", "no vd_m_s"),
        (WORLD.replace("\n", ",qw,qx,qy\n"), "no qz"),
        (WORLD.replace("\n", ",camera_pitch_deg\n"), "no camera_yaw_deg, camera_roll_deg"),
        (
            WORLD.replace("\n", f",{ANGLES},qw,qx,qy,qz\n"),
            "expected one attitude, got a quaternion and angles",
        ),
        (
            WORLD.replace("\n", f",{ANGLES}\n") + "0,1,2,3,0,nan,0\n",
            "line 2.*a finite number for camera_pitch_deg",
        ),
        (WORLD.replace("\n", ",latitude_deg\n"), "no longitude_deg"),
        (
            WORLD.replace("\n", ",latitude_deg,longitude_deg\n") + "0,1,2,3,473977000,85455000\n",
            "line 2.*a latitude within 90 degrees",
        ),
        ("time_s,speed_m_s\n0,-1\n", "line 2.*a speed of 0 m/s or more, got -1"),
        ("time_s,speed_m_s\n0,160\n", "line 2.*at most 150 m/s"),
        (WORLD.replace("\n", ",speed_m_s\n"), "one set of velocity columns"),
        ("time_s,time_s,vn_m_s,ve_m_s,vd_m_s\n", "each column once"),
        (GOOD + "1,2,3\n", "line 4.*4 cells.*got 3"),
        (GOOD + "1,nan,3,4\n", "line 4.*finite number for vn_m_s.*'nan'"),
        (GOOD + "1,,3,4\n", "line 4.*vn_m_s"),
        (GOOD + "1,inf,3,4\n", "line 4.*vn_m_s"),
        (GOOD.replace("time_s", "stamp_ns"), "line 3.*whole number"),
        (GOOD + "1e30,2,3,4\n", "line 4.*a time within"),
        (GOOD + "1e300,2,3,4\n", "line 4.*a time within"),
        (GOOD.replace("\n0,", "\n-1e30,"), "line 2.*a time within"),
        (GOOD.replace("time_s", "stamp_ns").replace("0.5", "9" * 20), "line 3.*a time within"),
        ("time_s,north_m,east_m,down_m\n0,0,0,0\n1,-1e308,0,0\n", "line 3.*within 1e\\+08 m, got 1e\\+308"),
        (WORLD.replace("\n", ",sigma_m_s\n") + "0,1,2,3,-1\n", "line 2.*sigma"),
        (WORLD.replace("\n", ",qw,qx,qy,qz\n") + "0,1,2,3,0,0,0,0\n", "line 2.*quaternion"),
        (
            WORLD.replace("\n", ",qw,qx,qy,qz\n") + "0,1,2,3,0,-90,0,90\n",
            "line 2.*of length 1, got 0, -90, 0, 90",
        ),
        ("note," + WORLD + '"two\nlines",0,1,2,3\n,1,x,2,3\n', "line 4.*vn_m_s"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, said):
    with pytest.raises(BadInput, match=said):
        read(tmp_path, text)


@pytest.mark.parametrize(("time_s", "kept_s"), [("0.5", 0.5), ("-1", 0.5), ("0.4", 0.5)])
def test_of_two_lines_in_the_wrong_order_one_goes_and_is_counted(tmp_path, time_s, kept_s):
    telemetry = read(tmp_path, GOOD + f"{time_s},7,7,7\n0.6,1,2,3\n")
    assert [sample.stamp_ns * 1e-9 for sample in telemetry.samples] == pytest.approx([0, kept_s, 0.6])
    assert telemetry.counts == {"velocities not later than the one before": 1}


def test_a_last_line_that_was_cut_off_is_counted(tmp_path):
    telemetry = read(tmp_path, GOOD + "1.0,12.5,2,3")
    assert len(telemetry.samples) == 2
    assert telemetry.counts == {"last lines without an end: cut off": 1}


def test_a_missing_log_is_refused(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        read_csv(tmp_path / "none.csv")


def test_a_binary_log_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(BadInput, match="a CSV file"):
        read_csv(path)


def test_cut_and_trashed_logs_read_or_refuse(tmp_path):
    path = tmp_path / "log.csv"
    rng = random.Random(0)
    for size in range(len(GOOD)):
        data = bytearray(GOOD.encode()[: size + 1])
        data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            assert len(read_csv(path).samples) <= 4
        except BadInput:
            continue


def test_two_frames_cannot_be_written(tmp_path):
    samples = [VelocitySample(0, [0, 0, 1], "world"), VelocitySample(1, [0, 0, 1], "camera")]
    with pytest.raises(BadInput, match="one frame"):
        write_csv(tmp_path / "log.csv", samples)


def test_an_attitude_without_its_velocity_cannot_be_written(tmp_path):
    samples = [VelocitySample(0, [0, 0, 1]), AttitudeSample(1, [1, 0, 0, 0])]
    with pytest.raises(BadInput, match="an attitude at each"):
        write_csv(tmp_path / "log.csv", samples)


@pytest.mark.parametrize(
    ("angles", "right", "ahead"),
    [
        ("0,0,0", (0, 1, 0), (1, 0, 0)),
        ("90,0,0", (-1, 0, 0), (0, 1, 0)),  # east is ahead, south to the right
        ("0,-90,0", (0, 1, 0), (0, 0, 1)),  # straight down
        ("0,0,90", (0, 0, 1), (1, 0, 0)),  # on its right side
        ("90,-90,0", (-1, 0, 0), (0, 0, 1)),
    ],
)
def test_angles_of_the_camera_say_where_it_looks(tmp_path, angles, right, ahead):
    """Right and ahead of the picture, in north, east, down."""
    text = WORLD.replace("\n", f",{ANGLES}\n") + f"0,1,2,3,{angles}\n0.5,1,2,3,{angles}\n"
    log = read(tmp_path, text)
    turn = rotation_from_quaternion(log.attitudes[0].world_from_camera)
    assert np.allclose(turn[:, 0], right, atol=1e-12)
    assert np.allclose(turn[:, 2], ahead, atol=1e-12)
    assert (len(log.attitudes), "ignored" in log.name) == (2, False)


def test_a_speed_alone_tells_no_direction(tmp_path):
    log = read(tmp_path, "time_s,speed_m_s,sigma_m_s\n0,3,0.2\n0.5,4,\n")
    assert log.any_direction and log.later_by(10).any_direction
    assert [(np.linalg.norm(v.velocity), v.sigma) for v in log.velocities] == [(3, 0.2), (4, None)]
    assert not read(tmp_path, GOOD).any_direction


@pytest.mark.parametrize("speed_m_s", [0, 150])
def test_a_speed_may_be_none_and_as_fast_as_a_drone_flies(tmp_path, speed_m_s):
    log = read(tmp_path, f"time_s,speed_m_s\n0,{speed_m_s}\n0.5,{speed_m_s}\n")
    assert [np.linalg.norm(sample.velocity) for sample in log.samples] == [speed_m_s] * 2


def test_an_attitude_beside_a_speed_turns_no_direction(tmp_path):
    log = read(tmp_path, f"time_s,speed_m_s,{ANGLES}\n0,3,10,0,0\n0.5,4,10,0,0\n")
    assert not log.attitudes
    assert log.name == f"CSV log.csv: speed, any direction, ignored columns: {ANGLES.replace(',', ', ')}"


def test_angles_are_told_not_to_be_an_attitude(tmp_path):
    text = "time_s,vn_m_s,ve_m_s,vd_m_s,roll_deg,note\n0,1,2,3,4,5\n1,1,2,3,4,5\n"
    assert (
        "ignored columns: roll_deg, note (an attitude is read from qw, qx, qy, qz"
        f" or {ANGLES.replace(',', ', ')})" in read(tmp_path, text).name
    )
    assert "attitude" not in read(tmp_path, text.replace("roll_deg", "other")).name
