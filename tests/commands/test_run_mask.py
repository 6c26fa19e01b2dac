"""`flightdepth run --mask`: what the files say of a masked part, and who notices another mask."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_flights import FRAMES, SIZE, make_video

from flightdepth.cli import main
from flightdepth.outputs import FlightFolder

sys.path.append(str(Path(__file__).parents[1] / "flight"))
from flight_files import turn_video

SHOWN = np.ones((SIZE, SIZE), np.bool_)
SHOWN[90:, :60] = False
LAST = FRAMES - 1


def save(path, shown=SHOWN, size=(SIZE, SIZE)):
    cv2.imwrite(str(path), cv2.resize(shown * np.uint8(255), size, interpolation=cv2.INTER_NEAREST))


@pytest.fixture
def work(tmp_path, save_difference_network, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_difference_network()
    make_video(tmp_path / "one.mp4")
    save(tmp_path / "mask.png")
    return tmp_path


@pytest.fixture
def run(work, capsys):
    def call(*arguments, flights=("one.mp4",)):
        code = main(
            ["run", *flights, "--hfov", "90", "--speed", "3", "--network", "difference.onnx", *arguments]
        )
        return code, *capsys.readouterr()

    return call


def known(path, index=LAST):
    """Where some file of a frame says something."""
    flags = np.isfinite(FlightFolder(path).depth_m(index))
    for name in ("confidence", "farther_than", "nearer_than", "sigma"):
        file = path / name / f"{index:06d}.png"
        if file.exists():
            flags |= cv2.imread(str(file), cv2.IMREAD_UNCHANGED) > 0
    return flags


def test_no_file_says_anything_of_what_is_masked_and_all_else_is_as_without(run, work):
    assert run("--out", "plain")[0] == 0
    code, stdout, _ = run("--out", "masked", "--mask", "mask.png")
    assert code == 0
    assert "mask: mask.png, black in 13.9% of the picture" in " ".join(stdout.split())
    plain, masked = work / "plain", work / "masked"
    assert known(plain)[~SHOWN].mean() > 0.9
    for index in range(FRAMES):
        assert not known(masked, index)[~SHOWN].any()
    np.testing.assert_array_equal(known(masked)[SHOWN], known(plain)[SHOWN])
    depths_m = [FlightFolder(path).depth_m(LAST)[:70] for path in (masked, plain)]
    np.testing.assert_allclose(*depths_m, rtol=0.02)


def test_a_mask_of_another_size_fits_and_that_of_a_turned_video_is_of_the_picture_as_shown(run, work):
    turn_video(work / "one.mp4")
    save(work / "mask.png", size=(512, 512))
    assert run("--mask", "mask.png")[0] == 0
    flags = known(work / "out")
    assert not flags[~SHOWN].any()
    assert flags[SHOWN].mean() > 0.9


def test_the_record_tells_one_mask_from_another(run, work):
    digests = []
    for shown in (SHOWN, SHOWN[::-1]):
        save(work / "mask.png", shown)
        run("--mask", "mask.png")
        source = FlightFolder(work / "out").record.source
        assert source.settings["mask"] == "mask.png"
        digests.append(source.mask_digest)
    assert digests[0] != digests[1]
    run()
    assert FlightFolder(work / "out").record.source.mask_digest is None


def test_flights_that_stand_are_run_again_through_another_mask_of_the_same_name(run, work):
    for name in ("one.mp4", "two.mp4"):
        make_video(work / name, frames=8)
    both = {"flights": ("one.mp4", "two.mp4")}
    assert "2 flights: 2 done" in run("--mask", "mask.png", **both)[1]
    assert "2 flights: 2 finished before" in run("--mask", "mask.png", **both)[1]
    save(work / "mask.png", SHOWN[::-1])
    assert "2 flights: 2 done" in run("--mask", "mask.png", **both)[1]
    assert "2 flights: 2 done" in run(**both)[1]


@pytest.mark.parametrize(
    ("shown", "size", "words"),
    [
        (None, None, "expected a picture, got No such file or directory"),
        (SHOWN, (SIZE, 72), "expected a picture of 128x128, or of its shape, got 128x72"),
        (SHOWN & False, (SIZE, SIZE), "expected white where the scene is seen, got black alone"),
    ],
    ids=["none", "another shape", "black"],
)
def test_what_is_no_mask_of_this_video_is_refused_in_one_line(run, work, shown, size, words):
    (work / "mask.png").unlink()
    if shown is not None:
        save(work / "mask.png", shown, size)
    code, _, stderr = run("--mask", "mask.png")
    assert code == 2
    assert stderr.splitlines() == [f"error: --mask mask.png: {words}"]
    assert not (work / "out").exists()
