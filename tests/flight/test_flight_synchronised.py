"""A video and a log that are off by a known time, through real files: `auto` finds it, says so, and warns."""

import json
import re
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

import flightdepth
from flightdepth.camera import Camera
from flightdepth.cli import main
from flightdepth.errors import BadInput
from flightdepth.flight import AttitudeSample, VelocitySample, flight_log, open_flight, write_csv
from flightdepth.flight.flight_log import clock_warnings
from flightdepth.flight.telemetry_csv import read_csv
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler
from tests_dji_records import airdata, record, steady

SAMPLE = Path(flightdepth.__file__).parent / "sample"
CAMERA = Camera.from_fov(192, 128, 70.0)
VIDEO_S, RATE_HZ = 12.0, 15
OFFSETS_S = [-3.0, -0.4, 0.0, 1.37, 240.0]


def yaw_rad(at_s):
    """A heading that wanders by some degrees."""
    waves = [(0.09, 0.11, 0.4), (0.06, 0.23, 2.0), (0.04, 0.37, 5.0), (0.02, 0.61, 1.0), (0.01, 1.1, 3.0)]
    return sum(size * np.sin(2 * np.pi * hertz * at_s + phase) for size, hertz, phase in waves)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A far landscape, seen by a camera that turns, with some noise in the pictures."""
    path = tmp_path_factory.mktemp("turning") / "video.mp4"
    rng = np.random.default_rng(3)
    noise = rng.uniform(0, 255, (256, 384, 3)).astype(np.float32)
    smooth = sum(cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (2, 5, 12))
    scene = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    centred = np.array([[1, 0, -96], [0, 1, -64], [0, 0, 1.0]])
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE_HZ, options={"crf": "18"})
        stream.width, stream.height, stream.pix_fmt = CAMERA.width, CAMERA.height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, RATE_HZ)
        for number in range(round(VIDEO_S * RATE_HZ)):
            now_from_north = cv2.Rodrigues(np.array([0, -yaw_rad(number / RATE_HZ), 0]))[0]
            warp = CAMERA.matrix @ now_from_north @ np.linalg.inv(CAMERA.matrix) @ centred
            image = cv2.warpPerspective(scene, warp, (CAMERA.width, CAMERA.height)).astype(np.int16)
            image = (image + rng.normal(0, 3, image.shape)).clip(0, 255).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


def log_of(path, *, off_s=0.0, turning=True):
    """A CSV of 20 Hz whose times are `off_s` too small, of a flight at an even speed; a little faster from 2 s on."""
    samples = []
    for at_s in np.arange(-6.0, VIDEO_S + 6, 0.05):
        stamp = round((at_s - off_s) * 1e9)
        turn = rotation_from_euler(0, 0, yaw_rad(at_s) if turning else 0.0) @ NED_FROM_CAMERA
        speed_m_s = 4.0 if at_s < 1.99 else 4.01
        samples += [
            VelocitySample(stamp, [speed_m_s, 0, 0]),
            AttitudeSample(stamp, quaternion_from_rotation(turn)),
        ]
    write_csv(path, samples)
    return path


def faster_from_ns(flight):
    """Time of the first velocity after the change that `log_of` makes."""
    velocities = (item for item in flight if isinstance(item, VelocitySample))
    return next(item.stamp_ns for item in velocities if item.velocity[0] > 4.005)


@pytest.fixture(scope="module")
def seen():
    return {}


@pytest.fixture
def seen_once(seen, monkeypatch):
    """How the pictures of a camera move is the same whatever the log: the first flight alone follows points in them."""
    follow = flight_log.apparent_motion

    def motion(frames, camera, mask):
        if camera not in seen:
            seen[camera] = follow(frames, camera, mask)
        return seen[camera]

    monkeypatch.setattr(flight_log, "apparent_motion", motion)


@pytest.mark.usefixtures("seen_once")
@pytest.mark.parametrize("off_s", OFFSETS_S)
def test_the_pictures_tell_the_offset(video, tmp_path, off_s):
    log = log_of(tmp_path / "log.csv", off_s=off_s)
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s == pytest.approx(off_s, abs=0.04)
        assert flight.clock.witness == "turn rate"
        assert faster_from_ns(flight) == pytest.approx(2e9, abs=0.04e9)


@pytest.mark.usefixtures("seen_once")
def test_a_log_that_tells_no_turn_moves_nothing_and_warns(video, tmp_path):
    log = log_of(tmp_path / "log.csv", off_s=1.0, turning=False)
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s is None
        assert any("unknown" in line and "taken as they are" in line for line in flight.warnings)
        assert faster_from_ns(flight) == 1_000_000_000


@pytest.mark.usefixtures("seen_once")
def test_a_log_of_another_time_that_tells_no_turn_is_refused_with_both_reasons(video, tmp_path):
    log = log_of(tmp_path / "log.csv", off_s=240.0, turning=False)
    with pytest.raises(BadInput, match=r"auto: unknown: turn rate: .*even within.*; telemetry .*got -246"):
        open_flight(video, log, CAMERA, telemetry_offset_s="auto")


@pytest.mark.usefixtures("seen_once")
def test_times_of_the_file_itself_are_doubted_aloud(video, tmp_path):
    log = log_of(tmp_path / "log.csv", off_s=1.0)
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert "contradicts" in clock_warnings(flight.clock, inside=True)[0]
        assert flight.warnings == clock_warnings(flight.clock, inside=False) == ()


def test_an_offset_that_is_given_is_taken(video, tmp_path):
    with open_flight(
        video, log_of(tmp_path / "log.csv", off_s=1.0), CAMERA, telemetry_offset_s=0.25
    ) as flight:
        assert flight.clock is None
        assert faster_from_ns(flight) == 1_250_000_000


@pytest.mark.usefixtures("seen_once")
@pytest.mark.parametrize("off_s", [-2.0, 0.0, 1.37])
@pytest.mark.parametrize("attitudes", [True, False])
def test_the_sample_flight_tells_it_by_its_direction(tmp_path, off_s, attitudes):
    """Ahead for five seconds, then to the left, without a turn and at an even speed: it was unknown."""
    kept = (AttitudeSample, VelocitySample) if attitudes else VelocitySample
    log = read_csv(SAMPLE / "telemetry.csv").later_by(round(-off_s * 1e9))
    write_csv(tmp_path / "log.csv", [sample for sample in log.samples if isinstance(sample, kept)])
    with open_flight(
        SAMPLE / "flight.mp4", tmp_path / "log.csv", SAMPLE / "camera.json", telemetry_offset_s="auto"
    ) as flight:
        assert flight.clock.witness == "direction"
        assert flight.clock.offset_s == pytest.approx(off_s, abs=0.1)


@pytest.mark.slow
def test_run_shows_it(video, tmp_path, capsys):
    log = log_of(tmp_path / "log.csv", off_s=-0.7)
    given = ["--telemetry", str(log), "--hfov", "70", "--end", "8", "--telemetry-offset", "auto"]
    # 3: no frame has depth, as it should be of a landscape at infinity; a pixel or two may have.
    assert main(["run", str(video), *given, "--network", "motion", "--out", str(tmp_path / "out")]) in (0, 3)
    assert re.search(r"offset between video and log: -0\.(69|70)", capsys.readouterr().out)
    clock = json.loads((tmp_path / "out" / "flight.json").read_text())["source"]["clock"]
    assert clock["offset_s"] == pytest.approx(-0.7, abs=0.04)
    assert clock["correlation"] > 0.8 and clock["sigma_s"] < 0.1


@pytest.mark.parametrize("text", ["soon", "", "nan"])
def test_an_offset_that_is_none(video, tmp_path, capsys, text):
    log = log_of(tmp_path / "log.csv")
    given = [
        "--telemetry",
        str(log),
        "--hfov",
        "70",
        "--telemetry-offset",
        text,
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(["run", str(video), *given]) == 2
    assert "--telemetry-offset" in capsys.readouterr().err


def dji_log(path, recordings):
    """A DJI flight record of a minute, whose second 20 is the video's first picture."""
    flown = record(
        steady((4.0, 0.0, 0.0)),
        recordings=recordings,
        yaw_at=lambda at_s: np.rad2deg(yaw_rad(at_s - 20)),
        gimbal_pitch=0.0,
    )
    path.write_text(airdata(flown), encoding="utf-8")
    return path


@pytest.mark.usefixtures("seen_once")
@pytest.mark.parametrize("late_s", [0.0, 0.6])
def test_the_pictures_tell_how_late_an_app_heard_of_a_recording(video, tmp_path, late_s):
    log = dji_log(tmp_path / "log.csv", ((5, 10), (20 + late_s, 32 + late_s)))
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s == pytest.approx(late_s + 0.05, abs=0.05)
        assert flight.warnings == ()


@pytest.mark.usefixtures("seen_once")
def test_pictures_are_not_asked_about_times_far_from_the_recording(video, tmp_path):
    """A whole flight holds other turns and speeds that fit as well."""
    log = dji_log(tmp_path / "log.csv", ((30, 42),))
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s is None or abs(flight.clock.offset_s) <= 3
    log = dji_log(tmp_path / "log.csv", ((25, 50),))  # not as long as the video: it may be anywhere
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s == pytest.approx(5.05, abs=0.05)


@pytest.mark.usefixtures("seen_once")
def test_pictures_pick_one_of_several_recordings(video, tmp_path):
    log = dji_log(tmp_path / "log.csv", ((5, 17), (20, 32)))
    with open_flight(video, log, CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s == pytest.approx(-20, abs=0.05)
