"""Burned-in text in pictures that turn: the offset and the lens that they tell, with a mask and without."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.cli import main
from flightdepth.errors import BadInput
from flightdepth.flight import AttitudeSample, VelocitySample, open_flight, write_csv
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler

sys.path.append(str(Path(__file__).parent))
from turning_videos import write_video

CAMERA = Camera.from_fov(320, 180, 70.0)
LASTS_S, LATE_S, TEXT_ROWS = 12, 0.7, 48


def yaw_rad(at_s):
    """It turns to and fro, unevenly."""
    return 0.35 * np.sin(0.9 * at_s) * np.sin(0.31 * at_s + 1) + 0.1 * np.sin(2.3 * at_s)


def attitude(at_s):
    return rotation_from_euler(0, 0, yaw_rad(at_s)) @ NED_FROM_CAMERA


def text():
    """White letters on black, sharper than all else."""
    picture = np.zeros((TEXT_ROWS, CAMERA.width, 3), np.uint8)
    for y, line in (
        (13, "BAT 15.2V 1842mAh LQ 98 GPS 14"),
        (29, "ALT 23m HOME 182m SPD 5.4"),
        (45, "REC 00:12"),
    ):
        cv2.putText(picture, line, (2, y), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 2)
    return picture


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With a video, its log, a log that is late, and a mask that hides the text to the pixel."""
    folder = tmp_path_factory.mktemp("text")
    write_video(folder / "flight.mp4", CAMERA, attitude, lasts_s=LASTS_S, text=text())
    for name, late_s in (("log.csv", 0.0), ("late.csv", LATE_S)):
        samples = []
        for at_s in np.arange(0, LASTS_S, 0.05):
            stamp_ns = round((at_s + late_s) * 1e9)
            turned = quaternion_from_rotation(attitude(at_s))
            samples += [VelocitySample(stamp_ns, [0.5, 0, 0]), AttitudeSample(stamp_ns, turned)]
        write_csv(folder / name, samples)
    shown = np.full((CAMERA.height, CAMERA.width), 255, np.uint8)
    shown[:TEXT_ROWS] = 0
    cv2.imwrite(str(folder / "mask.png"), shown)
    return folder


@pytest.fixture
def opened(folder):
    def call(log, *, masked, **options):
        mask = folder / "mask.png" if masked else None
        return open_flight(folder / "flight.mp4", folder / log, mask=mask, **options)

    return call


def test_the_offset_is_told_by_what_is_not_masked(opened):
    with opened("late.csv", masked=False, camera=CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s is None
    with opened("late.csv", masked=True, camera=CAMERA, telemetry_offset_s="auto") as flight:
        assert flight.clock.offset_s == pytest.approx(-LATE_S, abs=0.04)
        assert flight.clock.witness == "turn rate"


def test_the_lens_is_told_by_what_is_not_masked(opened):
    with pytest.raises(BadInput, match="of its turns: its turns and the pictures' do not fit"):
        opened("log.csv", masked=False)
    with opened("log.csv", masked=True) as flight:
        assert "turned by" in flight.camera_source
        assert flight.camera.fx == pytest.approx(CAMERA.fx, rel=0.02)


def test_a_mask_of_another_size_is_taken_at_that_of_the_pictures(folder, tmp_path):
    mask = cv2.resize(cv2.imread(str(folder / "mask.png")), (1280, 720), interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    with open_flight(
        folder / "flight.mp4", speed_m_s=1.0, camera=CAMERA, mask=tmp_path / "mask.png"
    ) as flight:
        assert flight.mask.shown.shape == (CAMERA.height, CAMERA.width)
        assert not flight.mask.shown[: TEXT_ROWS - 1].any() and flight.mask.shown[TEXT_ROWS + 1 :].all()


def test_cameras_takes_the_mask(folder, capsys):
    mask = ["--mask", str(folder / "mask.png")]
    assert main(["cameras", str(folder / "flight.mp4"), "--telemetry", str(folder / "log.csv"), *mask]) == 0
    assert "field of view of 70" in " ".join(capsys.readouterr().out.split())
    assert main(["cameras", *mask]) == 2
    assert "--mask: expected a VIDEO beside it" in capsys.readouterr().err


@pytest.mark.slow
def test_run_takes_the_mask(folder, capsys, tmp_path, save_difference_network):
    given = ["--telemetry", folder / "late.csv", "--mask", folder / "mask.png", "--hfov", "70", "--end", "8"]
    out = ["--network", save_difference_network(), "--out", tmp_path / "out"]
    command = ["run", folder / "flight.mp4", *given, *out, "--telemetry-offset", "auto"]
    assert main([str(part) for part in command]) in (0, 3)
    assert "offset between video and log: -0.7" in " ".join(capsys.readouterr().out.split())
