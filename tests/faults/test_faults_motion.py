"""Faults 8 to 11, 13 and 15: pictures and logs that are sound each, and would give wrong depth together."""

import math
import time

import cv2
import numpy as np
import pytest
from fault_flights import FPS, TEXTURE, film, fly, log, run, table, tree, view

from flightdepth.camera import Camera
from flightdepth.motion import rotation_from_euler
from flightdepth.outputs import FlightFolder
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.repeats import SAME_LEVELS, Repeats, difference
from flightdepth.runtimes.network import load_network

SPEED_M_S = 3.0
CAMERA = Camera.from_fov(128, 128, 90)
FRAME_NS = round(1e9 / FPS)


@pytest.fixture
def network(save_difference_network):
    return save_difference_network()


def kinds(results):
    """Reasons without their figures; "" where there is depth."""
    return {(result.reason or "").split(":")[0] for _, result in results}


def is_unknown(result):
    """No depth, and no bound that would make it far or near."""
    maps = (result.depth_m, result.farther_than_m, result.nearer_than_m)
    return all(np.isnan(each).all() for each in maps) and not result.confidence.any()


# Fault 8: frozen frames.


def test_fault_8_a_frozen_picture_is_unknown_not_far(tmp_path, network):
    hung = range(21, 55)  # with three key frames in it, which show the old picture anew
    video = film(tmp_path / "flight.mp4", 75, phase=lambda i: 20 if i in hung else i)
    log(tmp_path / "log.csv")
    results, _ = fly(video, network)
    frozen = [results[index] for index in hung]
    assert kinds(frozen[1:]) == {"frozen picture"}
    assert all(is_unknown(result) for _, result in frozen[1:])
    assert all(result.reason is None for _, result in results[2:20])
    assert all(result.reason is None for _, result in results[60:])  # and then it goes on


def test_fault_8_key_frames_of_a_picture_that_hangs_are_no_cadence():
    """Found in review: their distance was learnt as the usual one, and what hung between them had a depth."""
    repeats = Repeats()
    for index in range(80):
        level = 10 * index % 200 if index < 20 else 100 + index // 4 % 2  # a key frame every fourth picture
        repeats.add(index * FRAME_NS, np.full((40, 50, 3), level, np.uint8))
        assert not repeats.is_usual(FRAME_NS)


def test_fault_8_one_picture_that_hung_makes_no_long_wait_usual():
    """25 pictures a second in a file of 50, of which one was shown for a quarter of a second."""
    repeats = Repeats()
    for index, number in enumerate([*np.arange(20) // 2, *[9] * 10, *(20 + np.arange(6)) // 2]):
        repeats.add(index * 20_000_000, np.full((40, 50, 3), 10 * number, np.uint8))
    assert repeats.is_usual(30_000_000)
    assert not repeats.is_usual(60_000_000)


def test_fault_8_a_picture_of_another_size_is_new():
    """As bright, and cut out of the same."""
    repeats, repeated = Repeats(), []
    for index, rows in enumerate([40, 40, 20, 20, 40]):
        repeats.add(index * FRAME_NS, np.full((rows, 50, 3), 90, np.uint8))
        repeated.append(repeats.repeated)
    assert repeated == [False, True, False, True, False]
    assert repeats.shown_ns == 4 * FRAME_NS


def test_fault_8_the_written_depth_is_unknown_too(tmp_path, network):
    video = film(tmp_path / "flight.mp4", 20, group=30, phase=lambda i: min(i, 8))
    log(tmp_path / "log.csv")
    assert run(video, network, tmp_path / "out") == 0
    folder = FlightFolder(tmp_path / "out")
    assert all(np.isnan(folder.depth_m(index)).all() for index in range(10, 20))
    told = folder.record.counts.frames_without_depth
    assert sum(count for why, count in told.items() if why.startswith("frozen picture: the same for ")) >= 10


def test_fault_8_no_pair_is_made_with_a_frozen_picture(network):
    """Each picture tells by its red which it is; all are as bright (ITU-R BT.601)."""
    loaded, seen = load_network(network), []
    predict = loaded.predict
    loaded.predict = lambda previous, *rest: seen.append(list(previous)) or predict(previous, *rest)
    estimator, checked = MultiRangeEstimator(loaded, CAMERA), 0
    for index in range(60):
        estimator.add_velocity(index * FRAME_NS, (SPEED_M_S, 0, 0))
        shown = 20 if 20 <= index < 40 else index
        colour = (2 * shown, round((100 - 0.299 * 2 * shown) / 0.587), 0)
        result = estimator.add_frame(index * FRAME_NS, np.full((128, 128, 3), colour, np.uint8))
        for picture, shift in zip(seen.pop() if result.reason is None else [], result.shifts, strict=True):
            assert picture[0, 0, 0] == 2 * (index - shift)  # it was taken when the pair says
            checked += 1
    assert checked > 40


def test_fault_8_every_second_picture_repeated_costs_only_the_repeats(tmp_path, network):
    """15 pictures a second in a video of 30."""
    video = film(tmp_path / "flight.mp4", 40, phase=lambda i: i - i % 2)
    log(tmp_path / "log.csv")
    results, _ = fly(video, network)
    assert all(result.reason is None for _, result in results[4::2])


def test_fault_8_a_repeated_picture_is_of_the_time_when_it_was_new(network):
    """30 pictures a second in a video of 240, as ffmpeg makes it: repeats are taken for too far as long as they have
    not flown 0.05 m. Found in review: depth nearby was 9 % off, where it is 3."""
    loaded, checked = load_network(network), 0
    estimator = MultiRangeEstimator(loaded, CAMERA)
    for index in range(240):
        stamp_ns = index * 1_000_000_000 // 240
        estimator.add_velocity(stamp_ns, (SPEED_M_S, 0, 0))
        picture = np.full((128, 128, 3), 3 * (index // 8) + index // 8 % 2, np.uint8)
        result = estimator.add_frame(stamp_ns, picture)
        for shift, flown_m in zip(result.shifts, result.displacements_m, strict=True):
            pictures_between = index // 8 - (index - shift) // 8
            assert flown_m == pytest.approx(pictures_between * SPEED_M_S / 30, abs=1e-6)
            checked += 1
    assert checked > 100


@pytest.mark.parametrize(
    "shown", [(0, 0), (0, 0, 0, 1, 1), (0, 1, 1)], ids=["25 in 50", "24 in 60", "40 in 60"]
)
def test_fault_8_pictures_that_always_repeat_do_not_hang(network, shown):
    """Each repeat lost its depth as soon as 0.05 m were flown: half of the frames at 4 m/s, and all after a hang."""
    estimator, reasons, most = MultiRangeEstimator(load_network(network), CAMERA), [], max(shown) + 1
    for index in range(100):
        number = index // len(shown) * most + shown[index % len(shown)]
        hangs = 60 <= index < 80
        picture = np.full((128, 128, 3), 2 * (number % 100 if not hangs else 101), np.uint8)
        estimator.add_velocity(index * 20_000_000, (4.0, 0, 0))
        reasons.append(estimator.add_frame(index * 20_000_000, picture).reason)
    assert set(reasons[20:60]) == {None} == set(reasons[90:])
    assert all(str(reason).startswith("frozen picture") for reason in reasons[60 + len(shown) : 80])


def test_fault_8_a_repeated_picture_is_predicted_once_and_has_the_same_depth(network):
    """25 pictures a second in a file of 50 took twice the time."""
    loaded, asked, results = load_network(network), [], []
    predict = loaded.predict
    loaded.predict = lambda *pairs: asked.append(len(pairs)) or predict(*pairs)
    estimator = MultiRangeEstimator(loaded, CAMERA)
    for index in range(40):
        if index == 31:
            estimator.forget_frames()  # those before may be damaged
        estimator.add_velocity(index * 20_000_000, (4.0, 0, 0))
        picture = np.full((128, 128, 3), 4 * (index // 2), np.uint8)
        results.append(estimator.add_frame(index * 20_000_000, picture))
    known = [index for index in range(40) if results[index].reason is None]
    assert set(known) >= set(range(10, 31)) and results[31].reason is not None
    assert len(asked) == sum(index % 2 == 0 for index in known)
    for index in range(11, 30, 2):
        new, again = results[index - 1], results[index]
        np.testing.assert_array_equal(again.depth_m, new.depth_m)
        np.testing.assert_array_equal(again.displacements_m, new.displacements_m)
        np.testing.assert_array_equal(again.shifts, new.shifts + 1)


def test_fault_8_the_depth_of_a_repeated_picture_is_the_callers_own(network):
    """Found in review: who scaled the first one's depth in place had scaled the repeat's, too."""
    estimator, known = MultiRangeEstimator(load_network(network), CAMERA), {}
    for index in range(21):
        estimator.add_velocity(index * 20_000_000, (0, 4.0, 0))
        estimator.add_attitude(index * 20_000_000, (1, 0, 0, 0))
        picture = np.full((128, 128, 3), 4 * (index // 3), np.uint8)
        unusable = "turns" if index == 19 else None  # between the picture and its repeat
        result = estimator.add_frame(index * 20_000_000, picture, unusable=unusable)
        if index == 18:
            known = {name: each.copy() for name, each in arrays_of(result).items()}
            for each in arrays_of(result).values():
                each[:] = 7
    assert known.keys() == arrays_of(result).keys() >= {"depth_m", "range_depths_m", "farther_than_m"}
    for name, each in arrays_of(result).items():
        np.testing.assert_array_equal(each, known[name] + 2 * (name == "shifts"))


def arrays_of(result):
    return {name: each for name, each in vars(result).items() if isinstance(each, np.ndarray)}


def test_fault_8_a_repeated_picture_that_an_encoder_mends_is_no_new_one():
    """By 0.2 grey levels where the new one changed by 3: each counted as new, at a time that was not its own."""
    repeats, repeated = Repeats(), []
    for index in range(32):
        picture = np.full((40, 50, 3), 10 + 3 * (index // 8), np.uint8)
        picture[: 4 * (index % 8 > 2), :, :2] += 3  # a tenth of the picture, two of three colours
        repeats.add(index * 4_000_000, picture)
        repeated.append(repeats.repeated)
    assert [index for index in range(16, 32) if not repeated[index]] == [16, 24]


def test_fault_8_a_picture_that_stands_still_while_hovering_is_hovering(tmp_path, network):
    video = film(tmp_path / "flight.mp4", 30, phase=lambda _: 3)
    log(tmp_path / "log.csv", [(t / 10, 0.0, 0.0, 0.0) for t in range(15)])
    assert kinds(fly(video, network)[0]) == {"first frame", "first frames", "hovering"}


def test_fault_8_a_slow_flight_is_not_frozen():
    """A tenth of a pixel is enough, and a repeated picture is not."""
    assert difference(view(0), view(0.2)) > 2 * SAME_LEVELS
    assert difference(view(0), view(0)) == 0


# Fault 9: variable frame rate.


def test_fault_9_distances_follow_the_containers_times(tmp_path, network):
    stamps_s = [0.0, *np.cumsum(np.random.default_rng(3).uniform(0.015, 0.09, 29))]
    video = film(tmp_path / "flight.mp4", stamps_s=stamps_s, phase=lambda i: stamps_s[i] * FPS)
    log(tmp_path / "log.csv")
    results, _ = fly(video, network)
    assert np.allclose([frame.stamp_ns * 1e-9 for frame, _ in results], stamps_s, atol=1e-4)
    for frame, result in results[1:]:
        flown_s = [stamps_s[frame.index] - stamps_s[frame.index - shift] for shift in result.shifts]
        assert result.displacements_m == pytest.approx(SPEED_M_S * np.array(flown_s), abs=1e-3)
        assert result.reason is None


# Fault 10: doubled and backward stamps of a log.


def test_fault_10_doubled_and_backward_rows_of_a_log_are_dropped_and_counted(tmp_path, network):
    video = film(tmp_path / "flight.mp4", 20)
    clean = [(t / 10, 0.0, SPEED_M_S, 0.0) for t in range(20)]
    log(tmp_path / "log.csv", clean)
    expected, _ = fly(video, network)
    log(tmp_path / "log.csv", [*clean[:5], (0.4, 9.0, 0.0, 0.0), (0.1, 9.0, 0.0, 0.0), *clean[5:]])
    results, dropped = fly(video, network)
    assert dropped == {"velocities not later than the one before": 2}
    for (_, one), (_, other) in zip(results, expected, strict=True):
        assert np.array_equal(one.depth_m, other.depth_m, equal_nan=True)


def test_fault_10_an_estimator_drops_and_counts_them(network):
    estimator, dropped = MultiRangeEstimator(load_network(network), CAMERA), []
    for count, stamp in enumerate((0, 1, 2, 2, 1, 3)):
        estimator.add_velocity(stamp * FRAME_NS, (SPEED_M_S, 0, 0))
        result = estimator.add_frame(stamp * FRAME_NS, view(count))
        dropped.append((result.reason or "").startswith("dropped"))
    assert dropped == [False, False, False, True, True, False]
    assert estimator.dropped == {
        "frame not after the one before": 2,
        "velocity not after the one before": 2,
    }


# Fault 11: the wall clock is set.


def test_fault_11_the_wall_clock_may_step_by_an_hour(tmp_path, network, monkeypatch):
    """Each look at it is an hour later or earlier than the one before."""
    video = film(tmp_path / "flight.mp4", 15)
    log(tmp_path / "log.csv")
    assert run(video, network, tmp_path / "calm") == 0
    looks = []

    def stepping(clock, second):
        def look():
            looks.append(clock)
            return clock() + (-1) ** len(looks) * 3600 * second

        return look

    monkeypatch.setattr(time, "time", stepping(time.time, 1))
    monkeypatch.setattr(time, "time_ns", stepping(time.time_ns, 10**9))
    assert abs(time.time() - time.time()) > 7000
    assert run(video, network, tmp_path / "stepping") == 0
    files = [tree(tmp_path / name) for name in ("calm", "stepping")]
    for name in files[0]:
        if name.startswith(("depth", "confidence", "poses")):
            assert files[0][name] == files[1][name]
    rows = [table(tmp_path / name) for name in ("calm", "stepping")]
    assert all(0 <= float(row["latency_ms"]) < 60_000 for row in rows[1])
    assert [{**row, "latency_ms": ""} for row in rows[0]] == [{**row, "latency_ms": ""} for row in rows[1]]


# Fault 13: a gap in the telemetry.


def test_fault_13_no_pair_crosses_a_gap_and_depth_is_unknown_in_it(tmp_path, network):
    video = film(tmp_path / "flight.mp4", stamps_s=[i / 10 for i in range(60)], phase=lambda i: 3 * i)
    times = [t / 10 for t in range(62) if not 20 < t < 40]  # silent from 2.0 s to 4.0 s
    log(tmp_path / "log.csv", [(t, 0.0, SPEED_M_S, 0.0) for t in times])
    results, _ = fly(video, network)
    stamps_s = [frame.stamp_ns * 1e-9 for frame, _ in results]
    for (frame, result), stamp_s in zip(results, stamps_s, strict=True):
        if 2.55 < stamp_s < 3.95:  # the last velocity holds for half a second
            assert is_unknown(result)
            assert result.reason.startswith("no motion known")
        for shift in result.shifts:
            assert (stamps_s[frame.index - shift] < 2.55) == (stamp_s < 2.55)
    assert "gap in the motion" in kinds(results[40:])
    assert results[-1][1].reason is None


# Fault 15: hover, and rotation without flight.


def panned(degrees):
    """What a camera that turned to the right sees of a picture at infinity, drawn at a focal length of 128 px."""
    wide = np.array([[128.0, 0, 128], [0, 128.0, 64], [0, 0, 1]])
    turn = rotation_from_euler(0.0, math.radians(degrees), 0.0)
    warp = CAMERA.matrix @ turn @ np.linalg.inv(wide)
    return cv2.warpPerspective(TEXTURE, warp, (128, 128), borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize("speed_m_s", [0.0, 0.02])
def test_fault_15_hovering_is_unknown_not_far(tmp_path, network, speed_m_s):
    """The picture trembles, as those of a real gimbal do."""
    video = film(tmp_path / "flight.mp4", 30, phase=math.sin)
    log(tmp_path / "log.csv", [(t / 10, speed_m_s, 0.0, 0.0) for t in range(15)])
    results, _ = fly(video, network)
    assert all(is_unknown(result) for _, result in results)
    assert kinds(results) == {"first frame", "first frames", "hovering"}


@pytest.mark.parametrize("degrees_s", [2, 12, 60])
def test_fault_15_pure_rotation_is_unknown_not_far(tmp_path, network, degrees_s):
    video = film(tmp_path / "flight.mp4", 20, shown=lambda i: panned(degrees_s * (i - 10) / FPS))
    log(tmp_path / "log.csv", [(t / 10, 0.0, 0.0, 0.0) for t in range(10)])
    assert all(is_unknown(result) for _, result in fly(video, network)[0])


def test_fault_15_rotation_in_flight_is_unknown_not_near(tmp_path, network):
    """As fast as no one takes it out again."""
    video = film(tmp_path / "flight.mp4", 20, shown=lambda i: panned(60 * (i - 10) / FPS))
    log(tmp_path / "log.csv")
    later = [result for _, result in fly(video, network)[0][4:]]
    assert all(is_unknown(result) for result in later)
    assert all(result.reason.startswith(("turns", "the picture changes")) for result in later)
