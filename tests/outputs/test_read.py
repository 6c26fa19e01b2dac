import random

import cv2
import numpy as np
import pytest
from output_samples import HEIGHT, SOURCE, WIDTH, frame, known

from flightdepth.errors import BadInput
from flightdepth.outputs import FlightFolder, FlightWriter, Preview, read_confidence, read_depth


@pytest.fixture
def folder(tmp_path):
    with FlightWriter(tmp_path / "out", SOURCE, Preview(WIDTH, HEIGHT)) as writer:
        writer.add(frame(0), known(10))
    return tmp_path / "out"


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        FlightFolder(tmp_path / "nowhere")


def test_a_missing_frame_is_refused(folder):
    with pytest.raises(BadInput, match=r"000007\.png"):
        FlightFolder(folder).depth_m(7)


def test_an_8_bit_depth_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "depth.png"), np.zeros((4, 4), np.uint8))
    with pytest.raises(BadInput, match="16-bit"):
        read_depth(tmp_path / "depth.png")


def test_a_colour_confidence_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "confidence.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(BadInput, match="8-bit"):
        read_confidence(tmp_path / "confidence.png")


def test_a_record_with_an_unknown_field_is_refused(folder):
    path = folder / "flight.json"
    path.write_text(path.read_text().replace('"flightdepth"', '"flightdeath"'))
    with pytest.raises(BadInput, match="flight folder"):
        FlightFolder(folder)


@pytest.mark.parametrize("name", ["flight.json", "frames.csv"])
@pytest.mark.parametrize("seed", range(20))
def test_trash_in_the_texts_is_refused_or_read(folder, name, seed):
    data = bytearray((folder / name).read_bytes())
    rng = random.Random(seed)
    for _ in range(3):
        data[rng.randrange(len(data))] = rng.randrange(256)
    (folder / name).write_bytes(data)
    try:
        rows = FlightFolder(folder).rows
    except BadInput:
        return
    assert len(rows) <= 2


@pytest.mark.parametrize("suffix", [".png", ".npz"])
@pytest.mark.parametrize("size", [0, 1, 7, 60, 200])
def test_a_cut_depth_file_is_refused(tmp_path, suffix, size):
    depth_format = suffix[1:]
    ramp = np.arange(HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH) / 50
    with FlightWriter(tmp_path / "out", SOURCE, Preview(WIDTH, HEIGHT), depth_format=depth_format) as writer:
        writer.add(frame(0), known(ramp))
    path = tmp_path / "out" / "depth" / f"000000{suffix}"
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(BadInput):
        read_depth(path)
