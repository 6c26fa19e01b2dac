"""The commands and the snippet of the docs' page on cameras."""

import re
import shlex
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from flightdepth import cli
from flightdepth.flight.camera_file import read_camera
from flightdepth.flight.lenses import find_lens

TEXT = (Path(__file__).parents[1] / "docs" / "cameras.md").read_text("utf-8")
(CALIBRATE,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def test_the_table_is_listed(capsys):
    assert "flightdepth cameras  " in TEXT
    assert cli.main(["cameras"]) == 0
    assert "gopro-hero11-wide" in capsys.readouterr().out


def test_the_names_in_the_page_are_in_the_table():
    names = re.findall(r"--camera ((?:gopro|dji|parrot)-[a-z0-9-]+)", TEXT)
    assert len(names) >= 2
    assert all(find_lens(name) for name in names)


def test_the_options_in_the_page_exist(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert cli.main(["run", "--help"]) == 0
    known = capsys.readouterr().out
    options = {word for line in TEXT.splitlines() for word in re.findall(r"--[a-z][a-z-]+", line)}
    assert [option for option in options if option not in known] == []
    assert all(shlex.split(line)[0] == "flightdepth" for line in re.findall(r"^flightdepth .*$", TEXT, re.M))


def board_views(focal, size):
    """A chessboard of 10x7 squares from several sides, through an ideal lens."""
    squares = np.kron((np.indices((7, 10)).sum(0) % 2) * 255, np.ones((40, 40))).astype(np.uint8)
    page = cv2.copyMakeBorder(squares, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    matrix = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    for turn in (
        (0.4, 0, 0),
        (-0.4, 0.2, 0),
        (0, 0.5, 0.1),
        (0.3, -0.4, 0.2),
        (0, -0.5, 0),
        (-0.3, 0.4, -0.2),
    ):
        rotation, _ = cv2.Rodrigues(np.array(turn))
        centred = np.array([[1, 0, -page.shape[1] / 2], [0, 1, -page.shape[0] / 2], [0, 0, 1.0]])
        plane = np.column_stack([rotation[:, 0], rotation[:, 1], (0, 0, 800)]) @ centred
        yield cv2.warpPerspective(page, matrix @ plane, size, borderValue=128)


def test_the_snippet_calibrates_a_camera(tmp_path, monkeypatch, capsys):
    size, focal = (640, 360), 520.0
    with av.open(str(tmp_path / "board.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for view in board_views(focal, size):
            for _ in range(10):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(view, format="gray8")))
        container.mux(stream.encode(None))
    monkeypatch.chdir(tmp_path)
    exec(CALIBRATE, {})
    assert "6 views" in capsys.readouterr().out
    assert read_camera(tmp_path / "camera.yaml").fx == pytest.approx(focal, rel=0.02)
