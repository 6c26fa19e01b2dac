"""`flightdepth view`: a recording that Rerun's own tool reads, and the viewer in a real browser."""

import errno
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from flown_folder import FRAMES, RED, STEP_M, WALL_M, write_flown

from flightdepth.cli import main
from flightdepth.outputs.pictures import layout_of
from tests_browser import chromium

pytest.importorskip("rerun", reason="needs flightdepth[view]")
SOFTWARE_GL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_flown(tmp_path_factory.mktemp("view") / "out").folder


@pytest.fixture(scope="module")
def saved(folder):
    recording = folder.with_name("saved.rrd")
    assert main(["view", str(folder), "--save", str(recording)]) == 0
    return recording


def test_a_saved_recording_holds_everything(saved):
    rerun = [sys.executable, "-m", "rerun", "rrd"]
    verified = subprocess.run([*rerun, "verify", saved], capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stderr
    printed = subprocess.run([*rerun, "print", saved], capture_output=True, text=True, check=True)
    for entity in (
        *("world/camera/picture", "world/camera/picture/depth", "world/camera/picture/confidence"),
        *("world/way_flown", "displacement/range_2", "shift/range_1", "known/depth"),
    ):
        assert f"/{entity}" in printed.stdout


def test_a_folders_name_may_be_any(tmp_path, capfd):
    """Rerun warned of names with umlauts or brackets, and showed others."""
    folder = write_flown(tmp_path / "Flug (über Äcker) 1.5").folder
    assert main(["view", str(folder), "--save", str(tmp_path / "a.rrd")]) == 0
    assert "WARN" not in "".join(capfd.readouterr())
    assert folder.name.encode() in (tmp_path / "a.rrd").read_bytes()


def images_of(recording: Path, entity: str, decoded: int) -> list[np.ndarray]:
    """The pictures that a recording holds of an entity, in the order of their times; `decoded` as cv2.imread has it."""
    from rerun.chunk import RrdReader

    batches = [c.to_record_batch() for c in RrdReader(recording).stream() if c.entity_path == entity]
    blobs = {
        time: blob[0]
        for batch in batches
        for name in batch.schema.names
        if name.endswith(":blob")
        for time, blob in zip(batch["flight"].to_pylist(), batch[name].to_pylist(), strict=True)
    }
    packed = [np.frombuffer(bytes(blobs[time]), np.uint8) for time in sorted(blobs)]
    return [cv2.imdecode(data, decoded) for data in packed]


@pytest.mark.parametrize("ranges", [0, 2])
def test_depth_has_the_colours_of_the_preview(tmp_path, ranges):
    """Found in review: near was blue here and bright there."""
    flight = write_flown(tmp_path / "out", frames=3, ranges=ranges)
    assert main(["view", str(flight.folder), "--save", str(tmp_path / "a.rrd")]) == 0
    shown = images_of(tmp_path / "a.rrd", "/world/camera/picture/depth/colours", cv2.IMREAD_COLOR_RGB)
    layout = layout_of(flight)
    x, y = layout.corner(1)
    with av.open(str(flight.folder / "preview.mp4")) as film:
        for ours, frame in zip(shown, film.decode(video=0), strict=True):
            theirs = frame.to_ndarray(format="rgb24")[y : y + layout.height, x : x + layout.width]
            assert np.abs(ours.mean(axis=(0, 1)) - theirs.mean(axis=(0, 1))).max() < 6


def test_the_cursor_tells_metres(saved):
    stored = images_of(saved, "/world/camera/picture/depth", cv2.IMREAD_UNCHANGED)
    told_m = [WALL_M - STEP_M * i for i in range(1, FRAMES)]
    assert [depth[10, 10] / 100 for depth in stored] == [0, *told_m]


def test_only_its_own_older_recording_is_replaced(folder, tmp_path, capsys):
    target = tmp_path / "flight.rrd"
    target.write_bytes(b"RRF2 of another program")
    assert main(["view", str(folder), "--save", str(target)]) == 2
    assert "got another file, which it would replace" in capsys.readouterr().err
    target.unlink()
    assert [main(["view", str(folder), "--save", str(target)]) for _ in range(2)] == [0, 0]


def test_a_full_disk_says_what_to_do(folder, tmp_path, capsys, monkeypatch):
    """All that was said was `[Errno 28] No space left on device`."""

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("flightdepth.files.os.fsync", full)
    assert main(["view", str(folder), "--save", str(tmp_path / "flight.rrd")]) == 3
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"error: no room left on the disk of {tmp_path / 'flight.rrd'}; nothing of it was written."
        " Free some room and give the same command again"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_flight_ends_it(tmp_path):
    """Rerun waited for itself for ever."""
    folder = write_flown(tmp_path / "out").folder
    sorted((folder / "depth").iterdir())[-1].unlink()
    command = [sys.executable, "-m", "flightdepth", "view", folder, "--save", tmp_path / "flight.rrd"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2
    assert "No such file" in ended.stderr
    assert not (tmp_path / "flight.rrd").exists()


@pytest.mark.parametrize("option", ["--port", "--data-port"])
def test_a_port_of_a_page_that_is_not_asked_for(folder, capsys, option):
    assert main(["view", str(folder), "--save", "a.rrd", option, "1234"]) == 2
    assert "expected --web beside them" in capsys.readouterr().err


def test_web_and_save_exclude_each_other(folder, capsys):
    assert main(["view", str(folder), "--web", "--save", "a.rrd"]) == 2
    assert "one of them" in capsys.readouterr().err


def test_a_recording_in_no_folder(folder, capsys):
    assert main(["view", str(folder), "--save", "nowhere/a.rrd"]) == 2
    assert "an existing folder" in capsys.readouterr().err


def test_a_recording_among_the_files_of_the_run_is_refused(folder, capsys):
    """The next run there was refused for it."""
    assert main(["view", str(folder), "--save", str(folder / "a.rrd")]) == 2
    assert "a place outside" in capsys.readouterr().err
    assert not (folder / "a.rrd").exists()


def test_a_folder_that_is_none(tmp_path, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert "flightdepth run" in capsys.readouterr().err


def test_without_the_extra_it_says_which(folder, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)  # an import of it fails
    assert main(["view", str(folder)]) == 3
    assert "flightdepth[view]" in capsys.readouterr().err


def test_a_port_that_another_has(folder, capsys):
    """Found in review: a traceback, where a viewer's window was open already: it listens on the same port."""
    with socket.create_server(("", 0)) as taken:
        ports = ["--port", str(free_port()), "--data-port", str(taken.getsockname()[1])]
        assert main(["view", str(folder), "--web", *ports]) == 3
    assert f"could not serve on ports {ports[1]} and {ports[3]}" in capsys.readouterr().err


def test_browsers_see_the_first_frames_of_a_large_flight_too(folder, monkeypatch):
    """Found in review: of 500 frames of 4K the server dropped the first 150, for more than 1 GiB it does not hold."""
    import rerun

    given = {}

    def serve_grpc(**options):
        given.update(options)
        raise OSError("enough seen")

    monkeypatch.setattr(rerun, "serve_grpc", serve_grpc)
    assert main(["view", str(folder), "--web"]) == 3
    assert given["server_memory_limit"] == "75%"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@pytest.fixture(scope="module")
def address(folder):
    """Of `flightdepth view --web`, as a user starts it."""
    ports = ["--port", str(free_port()), "--data-port", str(free_port())]
    command = ["view", str(folder), "--web", *ports]
    # A shell without job control starts what runs in its background with SIGINT ignored; a terminal does not.
    hears = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    script = f"{hears}from flightdepth.cli import main; sys.exit(main({command!r}))"
    served = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        for line in served.stdout:
            if line.startswith("open "):
                yield line.split()[1]
                break
        else:
            pytest.fail("it ended without an address")
    finally:
        served.send_signal(signal.SIGINT)
        assert served.wait(60) == 130
        served.stdout.close()


@pytest.mark.slow
def test_the_browser_draws_the_flight(address):
    errors = []
    with chromium(*SOFTWARE_GL) as browser:
        page = browser.new_page(viewport={"width": 900, "height": 600})
        page.set_default_timeout(180_000)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: said.type == "error" and errors.append(said.text))
        # What the viewer asks of the internet (a font, its version) is none of ours, and is not there in a test.
        page.route(lambda url: "//localhost" not in url, lambda route: route.fulfill(status=204, body=""))
        page.goto(address)
        page.wait_for_selector("canvas")
        drawn = red_until(page, 2000, time.monotonic() + 240)
    assert drawn >= 2000
    assert [text for text in errors if "204" not in text and "parsing a JSON" not in text] == []


def red_until(page, wanted: int, deadline: float) -> int:
    """How many pixels have the colour of the flight's pictures, as soon as there are `wanted`."""
    red = 0
    while red < wanted and time.monotonic() < deadline:
        page.wait_for_timeout(2000)
        page.mouse.move(450 + int(time.monotonic()) % 7, 150)  # the viewer draws when something moves
        image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        red = int((np.abs(image.astype(int) - RED).max(axis=2) < 12).sum())
    if saved := os.environ.get("FLIGHTDEPTH_SCREENSHOTS"):
        page.screenshot(path=str(Path(saved) / "view.png"))
    return red


def test_the_page_is_served(address):
    """The quick half of the above: page, program and data answer."""
    from urllib.request import urlopen

    page = address.split("/?")[0]
    with urlopen(page, timeout=20) as answer:
        assert b"<canvas" in answer.read()
    host, port = address.rsplit("//", 1)[1].split("/")[0].split(":")
    socket.create_connection((host, int(port)), 20).close()
