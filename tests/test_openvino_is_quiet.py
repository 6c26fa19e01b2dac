"""OpenVINO would tell its makers that it was imported, and keep an id for that in the user's home."""

import os
import subprocess
import sys

SHOWS = "import flightdepth.processor as p; p.openvino_core(); import sys; print(sys.modules['openvino_telemetry'])"


def test_nothing_is_told_and_nothing_is_written_at_home(tmp_path):
    environment = {**os.environ, "HOME": str(tmp_path)}
    environment.pop("CI", None)  # it tells nothing where that is set
    run = subprocess.run(
        [sys.executable, "-c", SHOWS], env=environment, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "None"
    assert not run.stderr
    assert not list(tmp_path.iterdir())
