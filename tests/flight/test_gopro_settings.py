import random

import numpy as np
import pytest
from flight_files import make_video
from gopro_files import POLY, angle_of, floats, gopro_video, settings, text

from flightdepth.flight.gopro_settings import read_gopro_settings
from flightdepth.runtimes.lens import undistort


def read(tmp_path, payload):
    return read_gopro_settings(gopro_video(tmp_path / "v.mp4", payload), "")


def test_model_mode_and_stabilisation(tmp_path):
    found = read(tmp_path, settings("HERO9 Black", "W", "Y", "HS Boost"))
    assert (found.model, found.mode, found.stabilised, found.stabilisation) == (
        "HERO9 Black",
        "W",
        True,
        "HS Boost",
    )


@pytest.mark.parametrize(
    ("eise", "eisa", "stabilised"),
    [("N", "N/A", False), (None, "N", False), (None, "Y", True), ("Y", "HS EIS", True), (None, None, None)],
)
def test_stabilisation_is_on_off_or_untold(tmp_path, eise, eisa, stabilised):
    assert read(tmp_path, settings(eise=eise, eisa=eisa)).stabilised is stabilised


def test_a_levelled_horizon_is_stabilisation(tmp_path):
    found = read(tmp_path, settings(more=[text("HCTL", "On")]))
    assert (found.stabilised, found.stabilisation) == (True, "horizon levelling")


def test_the_cameras_own_polynomial_becomes_a_lens_with_the_same_angles(tmp_path):
    lens = read(tmp_path, settings(mode="W", poly=POLY)).lens
    half_diagonal = np.hypot(1920, 1080) / 2
    shares = np.linspace(0.05, 0.95, 19)
    pixels = np.stack([lens.cx + shares * 0.8 * half_diagonal, lens.cy + shares * 0.6 * half_diagonal], -1)
    angles = np.arctan(np.linalg.norm(undistort(pixels, lens), axis=-1))
    assert np.degrees(np.abs(angles - angle_of(shares)).max()) < 0.1


def test_a_warp_has_no_lens(tmp_path):
    payload = settings(mode="S", poly=POLY, more=[floats("ARUW", [1.1429])])
    found = read(tmp_path, payload)
    assert found.lens is None
    assert found.warped


def test_zoom_is_told(tmp_path):
    assert read(tmp_path, settings(zoom=3)).zoomed
    assert not read(tmp_path, settings()).zoomed


def test_an_older_camera_is_known_by_its_firmware_only(tmp_path):
    video = make_video(tmp_path / "v.mp4", [0, 40])
    found = read_gopro_settings(video, "HD5.02.02.00.00")
    assert (found.model, found.mode, found.stabilised) == ("HERO5 Black", "", None)


def test_other_makers_files_say_nothing(tmp_path):
    assert read_gopro_settings(make_video(tmp_path / "v.mp4", [0, 40]), "V01.00.0800") is None
    assert read_gopro_settings(tmp_path / "none.mp4", "") is None


@pytest.mark.parametrize(
    "poly",
    [
        (0.0,) * 7,
        (0.0, -1.0, 0, 0, 0, 0, 0),
        (float("nan"),) * 7,
        (0.0, 9.0, 0, 0, 0, 0, 0),
        (0, 1, -2, 0, 0, 0, 0),
    ],
    ids=["zeros", "inward", "nan", "all around", "folded"],
)
def test_a_polynomial_that_is_no_lens_gives_none(tmp_path, poly):
    assert read(tmp_path, settings(poly=poly)).lens is None


def test_cut_and_trashed_files_are_read_or_say_nothing(tmp_path):
    rng = random.Random(0)
    sound = gopro_video(tmp_path / "v.mp4", settings(poly=POLY)).read_bytes()
    start = sound.index(b"GPMF")
    path = tmp_path / "bad.mp4"
    for _ in range(300):
        data = bytearray(sound[: rng.randrange(start - 60, len(sound))] if rng.random() < 0.3 else sound)
        for _ in range(rng.randrange(4)):
            data[rng.randrange(start - 60, min(start + 300, len(data)))] = rng.randrange(256)
        path.write_bytes(bytes(data))
        found = read_gopro_settings(path, "")
        assert found is None or isinstance(found.model, str)
