"""The focal length that a camera's turns tell: from points of benchmarks/turned_focal.py, and through files."""

import importlib
import json
import re
import sys
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.cli import main
from flightdepth.errors import BadInput
from flightdepth.flight import (
    AttitudeSample,
    Telemetry,
    VelocitySample,
    open_flight,
    read_telemetry,
    write_csv,
)
from flightdepth.flight.records import BodyAttitudeSample, GyroscopeTrack
from flightdepth.flight.signals import Signal
from flightdepth.flight.turn_verdict import doubted_by_turns, turns_deny
from flightdepth.flight.turned_focal import TurnPoints, TurnWatch, ideal_lenses, told_rates
from flightdepth.motion import quaternion_from_rotation
from flightdepth.outputs import FlightFolder
from flightdepth.ranges import MultiRangeEstimator, RangedDepth

sys.path.append(str(Path(__file__).parent))
from flight_files import make_video
from gopro_files import gopro_video, settings
from turning_videos import looking, write_video

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
simulated = importlib.import_module("turned_focal")
Case = simulated.Case
watched = cache(simulated.watched)  # the points of a flight stay as they are
PINHOLE, FISHEYE = simulated.PINHOLE, simulated.FISHEYE
LENSES = pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
HOVERING = Case(lasts_s=24.0)
FLYING = Case(lasts_s=30.0, speed_m_s=5.0)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("camera", "factor"),
    [
        (PINHOLE, 0.5),
        (FISHEYE, 2.0),
        slow(PINHOLE, 1.0),
        slow(PINHOLE, 2.0),
        slow(FISHEYE, 0.5),
        slow(FISHEYE, 1.0),
    ],
)
def test_a_turning_camera_that_hovers_tells_its_lens_whichever_is_tried_first(camera, factor):
    tried = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
    found = watched(replace(HOVERING, camera=camera), tried=tried).focal(ideal_lenses(tried))
    assert found.camera.model == camera.model
    assert found.camera.fx == pytest.approx(camera.fx, rel=0.005)
    assert found.share == pytest.approx(0.02, abs=0.005)


def test_it_says_by_how_much_the_camera_turned():
    watch = watched(HOVERING, seed=1)
    turned = simulated.angles(HOVERING, np.random.default_rng(1))[200:-200]
    fast = np.abs(np.gradient(turned[:, 2])) * simulated.GRID_HZ > np.radians(3)
    yawed_deg = np.degrees(np.abs(np.diff(turned[:, 2]))[fast[1:]].sum())
    assert watch.focal().turned_deg == pytest.approx(yawed_deg, rel=0.15)


@LENSES
@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
def test_what_flying_adds_is_within_the_error_bar(camera, seed):
    found = watched(replace(FLYING, camera=camera), seed).focal(ideal_lenses(camera))
    assert found.camera.model == camera.model
    assert abs(found.camera.fx / camera.fx - 1) < 2 * found.share < 0.1


@pytest.mark.parametrize(
    "case",
    [
        replace(FLYING, lag_s=0.1),
        replace(FLYING, readout_s=0.03),
        replace(FLYING, shake_deg=0.5),
        replace(FLYING, attitude_hz=10.0),
        Case(Camera.from_fov(160, 90, 20.0), lasts_s=24.0, turn_deg=10.0),
    ],
    ids=["a late clock", "rolling shutter", "a drone that shakes", "attitudes of the camera", "a long lens"],
)
def test_it_stays_exact_with(case):
    found = watched(case).focal()
    assert found.camera.fx == pytest.approx(case.camera.fx, rel=0.025)


@pytest.mark.parametrize(
    ("case", "reason"),
    [
        (replace(HOVERING, turn_deg=0.0), "hardly turns"),
        (replace(HOVERING, lag_s=0.3), "is the log's clock the video's"),
        slow(replace(HOVERING, lag_s=10.0), "do not fit|is the log's clock"),
        (replace(HOVERING, attitude_hz=2.0), "0 degrees only where the log tells it often enough"),
        (replace(HOVERING, attitude_hz=0.4), "does not tell how the camera turns"),
        (replace(HOVERING, smoothed_s=0.15), "more smoothly"),
        slow(replace(HOVERING, smoothed_s=0.3), "more smoothly|do not fit"),
        (replace(HOVERING, smoothed_s=1.0), "do not fit|more smoothly"),
        slow(replace(FLYING, smoothed_s=0.3, shake_deg=0.5), "do not fit|more smoothly"),
        slow(replace(HOVERING, follows_s=0.2), "more smoothly|is the log's clock"),
        (replace(HOVERING, follows_s=1.0), "do not fit|more smoothly|is the log's clock"),
        (replace(HOVERING, zoom=2.0), "a zoom"),
    ],
)
def test_it_says_why_turns_tell_nothing(case, reason):
    watch = watched(case)
    found = watch.focal(ideal_lenses(watch.camera))
    assert found.camera is None
    assert re.search(reason, found.reason), found.reason


def test_the_lens_given_keeps_its_distortion():
    bent = replace(PINHOLE, distortion=(-0.2, 0.03, 0.0, 0.0))
    tried = replace(bent, fx=1.3 * bent.fx, fy=1.3 * bent.fy)
    found = watched(replace(HOVERING, camera=bent), tried=tried).focal()
    assert found.camera.distortion == bent.distortion
    assert found.camera.fx == pytest.approx(bent.fx, rel=0.01)


def test_attitudes_of_the_drone_tell_nothing():
    bodies = tuple(BodyAttitudeSample(k * 10**8, np.array([1.0, 0, 0, 0])) for k in range(99))
    watch = TurnWatch(Telemetry("a log", (VelocitySample(0, [1.0, 0, 0]),), body_attitudes=bodies), PINHOLE)
    assert "does not tell how the camera turns" in watch.focal().reason


def test_trash_is_no_turn():
    rng = np.random.default_rng(4)
    watch = simulated.watched(Case(lasts_s=2.0))
    for k in range(60):
        points = rng.uniform(-1e4, 1e4, (2, 30, 2))
        watch.add(*points, 10**9 + k * 10**8, 11 * 10**8 + k * 10**8)
    assert watch.focal(ideal_lenses(PINHOLE)).camera is None


def test_pictures_are_kept_near_turns_only():
    watch = watched(HOVERING)
    assert not watch.wants(-2 * 10**9)
    assert watch.wants(2 * 10**9)
    assert 0.0 <= watch.busiest_s(0.0, 24.0, 4.0) < 22


def turning(*whiles_s):
    """A log that turns by 10 degrees a second in each of some whiles, told 20 times a second."""
    at_s = np.arange(0, 200, 0.05)
    turns = np.any([(at_s >= first_s) & (at_s <= last_s) for first_s, last_s in whiles_s], axis=0)
    track = GyroscopeTrack((at_s * 1e9).astype(np.int64), np.radians(10) * turns[:, None] * [0.0, 1, 0])
    return Telemetry("a log", (VelocitySample(0, [1.0, 0, 0]),), gyroscope=track)


@pytest.mark.parametrize(
    ("at_s", "wanted"), [(19.2, False), (19.4, True), (21, True), (22.6, True), (22.8, False)]
)
def test_pictures_are_wanted_up_to_0_7_s_from_a_turn(at_s, wanted):
    watch = TurnWatch(turning((20, 22)), PINHOLE)
    assert watch.wants(round(at_s * 1e9)) == wanted
    points = np.random.default_rng(0).uniform(0, 90, (2, 30, 2))
    watch.add(*points, round((at_s - 0.1) * 1e9), round(at_s * 1e9))
    assert len(watch.points) == wanted


@pytest.mark.parametrize(
    ("first_s", "last_s", "length_s", "start_s"),
    [
        (0, 200, 10, 49.3),
        (0, 200, 30, 79.3),
        (0, 30, 10, 19.3),
        (60, 200, 10, 79.3),
        (60, 70, 10, 60),
        (50, 200, 10, 50),
    ],
    ids=[
        "the longest",
        "two that are near",
        "before a time",
        "after one",
        "none",
        "not before what is asked",
    ],
)
def test_the_part_in_which_it_turns_most_begins_where_its_first_turn_does(first_s, last_s, length_s, start_s):
    """For 2, 5, 3 and 3 s; a little before the turn flying is seen."""
    watch = TurnWatch(turning((20, 22), (50, 55), (80, 83), (105, 108)), PINHOLE)
    assert watch.busiest_s(first_s, last_s, length_s) == pytest.approx(start_s, abs=0.06)


def test_a_turn_slower_than_three_degrees_a_second_is_none():
    log = turning((20, 22))
    slow = replace(log, gyroscope=replace(log.gyroscope, rates_rad_s=0.28 * log.gyroscope.rates_rad_s))
    assert not TurnWatch(slow, PINHOLE).wants(21 * 10**9)


def points_of(count, seed=0):
    return np.random.default_rng(seed).uniform(0, 90, (2, count, 2))


@pytest.mark.parametrize(
    ("count", "apart_ns", "kept"),
    [(9, 10**8, False), (10, 10**8, True), (10, 25 * 10**7, True), (10, 26 * 10**7, False)],
    ids=["few points", "enough", "a quarter of a second", "longer"],
)
def test_a_pair_has_ten_points_and_is_short(count, apart_ns, kept):
    points = TurnPoints(PINHOLE)
    assert points.add(*points_of(count), 10**9, 10**9 + apart_ns) == kept
    assert len(points) == kept


def test_more_than_eighty_points_of_a_pair_are_not_kept():
    points = TurnPoints(PINHOLE)
    assert points.add(*points_of(100), 0, 10**8)


def test_the_newest_pairs_are_kept():
    """Of 12 of 20 pairs turns are told; of 11 it is said that there are none."""
    for most, said in ((11, "hardly turns"), (12, "turns by 0 degrees only")):
        points = TurnPoints(PINHOLE, most=most)
        for k in range(20):
            points.add(*points_of(20, k), k * 10**8, (k + 1) * 10**8)
        assert len(points) == most
        assert said in points.focal(Signal(np.arange(-1, 5, 0.05), np.zeros((120, 3)))).reason


def test_of_the_drones_attitudes_and_the_gyroscope_the_latter_tells_as_it_stands():
    """Not smoothed, as for the clock of a log; its axes may be any."""
    rates = np.random.default_rng(0).normal(size=(40, 3))
    track = GyroscopeTrack(np.arange(40) * 10**7, rates)
    bodies = tuple(BodyAttitudeSample(k * 10**8, np.array([1.0, 0, 0, 0])) for k in range(99))
    told = told_rates(
        Telemetry("a log", (VelocitySample(0, [1.0, 0, 0]),), gyroscope=track, body_attitudes=bodies)
    )
    assert not told.axes
    np.testing.assert_array_equal(told.values, rates)
    np.testing.assert_allclose(told.at_s, np.arange(40) / 100)


@pytest.mark.parametrize(("count", "enough"), [(11, False), (12, True)])
def test_a_log_of_few_rates_tells_no_turns(count, enough):
    track = GyroscopeTrack(np.arange(count) * 10**7, np.zeros((count, 3)))
    told = told_rates(Telemetry("a log", (VelocitySample(0, [1.0, 0, 0]),), gyroscope=track))
    assert (told is not None) == enough


def test_ideal_lenses_have_the_size_and_the_focal_length_of_the_camera():
    bent = Camera(640, 360, 400, 410, 310, 170, (-0.2, 0.03, 0.0, 0.0))
    pinhole, fisheye = ideal_lenses(bent)
    assert pinhole == replace(bent, distortion=pinhole.distortion) and pinhole.is_ideal
    assert fisheye == replace(pinhole, model="fisheye")


@pytest.mark.parametrize(("factor", "denied"), [(1.05, False), (1.25, True), (0.8, True)])
def test_a_camera_is_denied_beyond_a_tenth(factor, denied):
    large = PINHOLE.resized(640, 360)
    said = turns_deny(watched(HOVERING).focal(), replace(large, fx=factor * large.fx, fy=factor * large.fy))
    assert (said is not None) == denied
    if said is not None:
        assert f"{factor:.2f} times" in said and "70" in said


@pytest.mark.parametrize(
    ("camera", "distortion"),
    [
        (PINHOLE, (-0.3, 0.1, 0.0, 0.0)),
        (FISHEYE, (0.2, 0.0, 0.0, 0.0)),
        slow(PINHOLE, (0.2, 0.0, 0.0, 0.0)),
        slow(FISHEYE, (-0.3, 0.1, 0.0, 0.0)),
    ],
)
def test_a_right_camera_is_not_doubted_because_no_ideal_lens_is_like_it(camera, distortion):
    bent = replace(camera, distortion=distortion)
    assert doubted_by_turns(watched(replace(FLYING, camera=bent)), bent) is None


@pytest.fixture(scope="module", params=[PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def turning_video(request, tmp_path_factory):
    """A video of a far landscape through a turning camera, and its log."""
    case = Case(request.param.resized(320, 180), lasts_s=10.0)
    turned = simulated.angles(case, np.random.default_rng(8))
    folder = tmp_path_factory.mktemp("turned")
    write_video(folder / "flight.mp4", case.camera, lambda at_s: looking(case, turned, at_s))
    samples = []
    for at_s in np.arange(0, 10, 0.05):
        stamp_ns = round(at_s * 1e9)
        attitude = quaternion_from_rotation(looking(case, turned, at_s))
        samples += [VelocitySample(stamp_ns, [0.5, 0, 0]), AttitudeSample(stamp_ns, attitude)]
    write_csv(folder / "log.csv", samples)
    return folder / "flight.mp4", folder / "log.csv", case.camera


ABOVE_ALL_PINHOLE = pytest.mark.parametrize(
    "turning_video", [PINHOLE, slow(FISHEYE)], ids=["pinhole", "fisheye"], indirect=True
)


def test_a_flight_without_a_camera_takes_the_one_that_its_turns_tell(turning_video):
    video, told, camera = turning_video
    with open_flight(video, told) as flight:
        assert flight.camera.model == camera.model
        assert flight.camera.fx == pytest.approx(camera.fx, rel=0.03)
        assert "turned by" in flight.camera_source
        assert flight.turns is None


@ABOVE_ALL_PINHOLE
def test_a_part_of_a_flight_is_seen_through_the_lens_that_the_whole_tells(turning_video):
    video, told, _ = turning_video
    with open_flight(video, told) as whole, open_flight(video, told, start_s=4.0, end_s=4.3) as part:
        assert part.camera == whole.camera


@ABOVE_ALL_PINHOLE
def test_of_a_log_whose_time_is_sought_too_the_lens_is_told_after_it(turning_video):
    """By itself a log that is 0.6 s late tells no lens."""
    video, told, camera = turning_video
    late = told.with_name("late.csv")
    log = read_telemetry(told).later_by(600_000_000)
    write_csv(late, [sample for sample in log.samples if sample.stamp_ns >= 0])
    with open_flight(video, late, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s == pytest.approx(-0.6, abs=0.05)
        assert flight.camera.model == camera.model
        assert flight.camera.fx == pytest.approx(camera.fx, rel=0.04)
    with pytest.raises(BadInput, match="of its turns"):
        open_flight(video, late)


@pytest.fixture
def without_depth(monkeypatch):
    """Of no matter to what turns tell, and slow."""
    none = RangedDepth.unknown(180, 320, "not asked for", 0.0)
    monkeypatch.setattr(MultiRangeEstimator, "add_frame", lambda *_, **__: none)


@pytest.mark.usefixtures("without_depth")
@ABOVE_ALL_PINHOLE
@pytest.mark.parametrize("factor", [1.0, 1.4])
def test_run_warns_of_a_camera_that_the_turns_deny(
    turning_video, tmp_path, capsys, factor, save_difference_network
):
    video, told, camera = turning_video
    network = save_difference_network()
    given = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
    (tmp_path / "camera.json").write_text(json.dumps(asdict(given)))
    options = ["--telemetry", told, "--camera", tmp_path / "camera.json", "--network", network]
    options += ["--end", "6"]
    assert main(["run", str(video), *map(str, options), "--out", str(tmp_path / "out")]) == 3
    doubts = [line for line in FlightFolder(tmp_path / "out").record.source.warnings if "turns tell" in line]
    assert len(doubts) == (factor != 1.0)
    assert ("turns tell" in " ".join(capsys.readouterr().err.split())) == (factor != 1.0)


@ABOVE_ALL_PINHOLE
def test_cameras_says_what_turns_tell(turning_video, capsys):
    video, told, camera = turning_video
    assert main(["cameras", str(video), "--telemetry", str(told)]) == 0
    said = capsys.readouterr().out
    assert "turned by" in said and ("fisheye" in said) == (camera.model == "fisheye")


@ABOVE_ALL_PINHOLE
def test_the_refusal_says_why_turns_do_not_help(turning_video, tmp_path):
    video, _, _ = turning_video
    write_csv(tmp_path / "log.csv", [VelocitySample(k * 10**8, [1.0, 0, 0]) for k in range(100)])
    with pytest.raises(BadInput, match="of its turns: the log does not tell how the camera turns"):
        open_flight(video, tmp_path / "log.csv")


def test_a_video_that_does_not_tell_its_length_is_not_asked_about_what_comes_after_it(tmp_path):
    """The log turns most a minute after the last picture: a stream as it was written, cut or not."""
    video = make_video(tmp_path / "v.mkv", range(0, 2000, 100), options={"live": "1"})
    at_s = np.arange(0, 90, 0.1)
    turned = np.sin(at_s) * (at_s > 60)
    samples = [
        sample
        for at, yaw in zip(at_s, turned, strict=True)
        for sample in (
            VelocitySample(round(at * 1e9), [5, 0, 0]),
            AttitudeSample(round(at * 1e9), [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]),
        )
    ]
    write_csv(tmp_path / "log.csv", samples)
    with pytest.raises(BadInput, match=r"of its turns: the camera hardly turns.*--hfov DEGREES"):
        open_flight(video, tmp_path / "log.csv")


def test_a_stabilised_video_is_not_asked(turning_video, tmp_path):
    _, told, _ = turning_video
    video = gopro_video(tmp_path / "v.mp4", settings("HERO10 Black", "L", "Y", "HS EIS"))
    with open_flight(video, told, hfov_deg=80) as flight:
        assert flight.turns is None and flight.lens_doubt() is None
