import numpy as np
import pytest
from flight_files import add_gpmf, gyro_payload, klv, lned_payload, make_video, nest, trimmed

from flightdepth.errors import BadInput
from flightdepth.flight.gpmf_telemetry import payloads, read_gpmf
from flightdepth.flight.video import Video

MS = 1_000_000


@pytest.fixture
def plain(tmp_path):
    return make_video(tmp_path / "v.mp4", range(0, 3000, 40))


def karma_like(first_ms=10_000):
    """Three payloads of four samples, 250 ms apart, north faster and faster."""
    rows = [(first_ms + 250 * k, float(k), 0.0, 0.0) for k in range(12)]
    return [lned_payload(rows[4 * k : 4 * k + 4]) for k in range(3)]


def test_payloads_come_with_their_time(plain):
    found = list(payloads(add_gpmf(plain, karma_like())))
    assert [(interval.start_ns // MS, interval.end_ns // MS) for interval, _ in found] == [
        (0, 1000),
        (1000, 2000),
        (2000, 3000),
    ]
    assert [data for _, data in found] == karma_like()


def test_payloads_of_a_trimmed_video_keep_their_place(plain, tmp_path):
    """The cut lies within the first payload: it began so long before the first picture that is shown."""
    part = add_gpmf(trimmed(plain, tmp_path / "part.mp4", 640), karma_like(), begins_ms=640)
    starts = [interval.start_ns // MS for interval, _ in payloads(part)]
    assert starts == [-640, 360, 1360]


def test_the_video_is_still_readable(plain):
    with Video(add_gpmf(plain, karma_like())) as video:
        assert len(list(video.frames())) == 75


def test_velocities_are_world_velocities_in_order(plain):
    log = read_gpmf(add_gpmf(plain, karma_like()))
    assert [sample.velocity.tolist() for sample in log.samples] == [[k, 0, 0] for k in range(12)]
    assert {sample.frame for sample in log.samples} == {"world"}


def test_samples_keep_the_spacing_of_their_own_clock(plain):
    stamps = [sample.stamp_ns for sample in read_gpmf(add_gpmf(plain, karma_like())).samples]
    assert np.diff(stamps).tolist() == [250 * MS] * 11


def test_a_karmas_samples_are_taken_longer_before_they_arrive(plain):
    """Found on a real one: its log was 0.28 s behind its pictures, a tenth of the way where it speeds up."""
    stamps = [sample.stamp_ns for sample in read_gpmf(add_gpmf(plain, karma_like())).samples]
    arrived_ns, period_ns = 125 * MS, 250 * MS  # the first may have arrived from 0 to 250 ms
    assert stamps[0] == arrived_ns - period_ns - 280 * MS


def positioned(velocity, drift=(0.0, 0.0, 0.0), *, first_ms=10_000, speeds_up=1.5):
    """Samples every 250 ms of a drone that speeds up northwards, whose log's velocity is off by `drift`."""
    rows = []
    for k in range(12):
        t = k / 4
        true = np.array([velocity + speeds_up * t, -2.0, 0.1])
        place = np.array([velocity * t + speeds_up * t**2 / 2 - 30, 12 - 2.0 * t, 0.1 * t - 5])
        rows.append((first_ms + 250 * k, *place, *(true + drift)))
    return rows


def velocities_of(plain, rows):
    log = read_gpmf(add_gpmf(plain, [lned_payload(rows[at : at + 4]) for at in range(0, len(rows), 4)]))
    return np.array([sample.velocity for sample in log.samples])


@pytest.mark.parametrize("drift", [(0.0, 0.0, 0.0), (0.36, 0.13, 0.0), (-0.4, 0.2, 0.2)])
def test_a_velocity_that_its_own_positions_deny_is_set_right(plain, drift):
    """Found on a real Karma: 0.4 m/s too fast, 4 % of its way, and so of the depth. Ends and turns of speed stay."""
    found = velocities_of(plain, positioned(5.0, drift))
    np.testing.assert_allclose(found, np.array(positioned(5.0))[:, 4:], atol=1e-4)


def test_a_position_that_is_reset_moves_no_velocity(plain):
    """A filter that finds itself 4 m off moves its position at once; the drone did not fly there."""
    rows = positioned(5.0)
    rows = rows[:6] + [(ms, north + 4, *rest) for ms, north, *rest in rows[6:]]
    np.testing.assert_allclose(velocities_of(plain, rows), np.array(rows)[:, 4:], atol=1e-4)


def test_samples_are_not_later_than_their_payload(plain):
    stamps = [sample.stamp_ns for sample in read_gpmf(add_gpmf(plain, karma_like())).samples]
    assert all(stamp < (k // 4 + 1) * 1000 * MS for k, stamp in enumerate(stamps))


def test_samples_without_a_clock_spread_over_their_payload(plain):
    parts = [lned_payload([(0, 1.0, 2.0, 3.0)] * 4, clock=False)] * 2
    stamps = [sample.stamp_ns // MS for sample in read_gpmf(add_gpmf(plain, parts)).samples]
    assert stamps == [0, 250, 500, 750, 1000, 1250, 1500, 1750]


def test_the_name_says_what_was_found(plain):
    assert "Local Position NED of Karma, 12 velocities" in read_gpmf(add_gpmf(plain, karma_like())).name


def test_the_gyroscope_comes_along(plain):
    parts = [lned + gyro_payload([[0.0, 0.5, 0.0]] * 100) for lned in karma_like()]
    track = read_gpmf(add_gpmf(plain, parts)).gyroscope
    assert track.turn_rad(500 * MS, 600 * MS) == pytest.approx(0.05)


def test_a_video_without_the_track_has_no_telemetry(plain):
    assert read_gpmf(plain) is None


def test_a_track_without_velocity_is_no_telemetry(plain):
    assert read_gpmf(add_gpmf(plain, [gyro_payload([[0, 0, 0.1]])])) is None


def test_a_damaged_payload_is_dropped_and_counted(plain):
    parts = karma_like()
    parts[1] = b"DEVC" + b"\xff" * (len(parts[1]) - 4)
    log = read_gpmf(add_gpmf(plain, parts))
    assert len(log.samples) == 8
    assert log.counts == {"damaged telemetry payloads": 1}


@pytest.mark.parametrize("columns", [3, 5])
def test_samples_of_too_few_columns_are_dropped_and_counted(plain, columns):
    """They ended in an error of numpy's."""
    damaged = nest("DEVC", nest("STRM", klv("LNED", "f", 4 * columns, 2, bytes(8 * columns))))
    log = read_gpmf(add_gpmf(plain, [*karma_like(), damaged]))
    assert len(log.samples) == 12
    assert log.counts == {"damaged telemetry payloads": 1}


def test_a_velocity_that_is_no_number_is_dropped_and_counted(plain):
    parts = [*karma_like(), lned_payload([(13_000, float("nan"), 0.0, 0.0)])]
    log = read_gpmf(add_gpmf(plain, parts))
    assert log.counts == {"velocities that are not numbers": 1}
    assert len(log.samples) == 12


def test_a_sample_sent_twice_is_dropped_and_counted(plain):
    parts = karma_like()
    log = read_gpmf(add_gpmf(plain, [parts[0], parts[0], parts[1]]))
    assert log.counts == {"velocities not later than the one before": 4}


def test_only_velocities_that_are_no_numbers_are_refused(plain):
    parts = [lned_payload([(13_000, float("nan"), 0.0, 0.0)])]
    with pytest.raises(BadInput, match=r"got none \(1 velocities that are not numbers\)\. Give --telemetry"):
        read_gpmf(add_gpmf(plain, parts))


def test_cut_anywhere_it_reads_or_refuses(plain):
    whole = add_gpmf(plain, karma_like()).read_bytes()
    for size in range(len(whole) - 4000, len(whole), 61):
        plain.write_bytes(whole[:size])
        try:
            log = read_gpmf(plain)
        except BadInput:
            continue
        assert log is None or len(log.samples) <= 12
