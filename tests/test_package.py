"""What `import flightdepth as fd` offers."""

import pickle
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import flightdepth as fd
from flightdepth.commands.demo import LOG, VIDEO
from flightdepth.errors import MissingExtra
from flightdepth.flight import open_flight
from flightdepth.ranges import MultiRangeEstimator


@pytest.mark.parametrize("name", fd.__all__)
def test_each_public_name_is_there(name):
    assert getattr(fd, name) is not None
    assert name in dir(fd)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="frobnicate"):
        _ = fd.frobnicate


def test_the_version_is_the_distributions():
    assert fd.__version__ == version("flightdepth")


def test_importing_the_package_loads_nothing():
    script = "import sys, flightdepth; print(sorted(n for n in sys.modules if n.startswith('flightdepth.')))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_missing_extra_comes_back_from_another_machine():
    error = MissingExtra("Reading ULog", "px4")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_the_example_of_the_readme_uses_all_that_a_flight_tells(monkeypatch, capsys):
    """Found in review: it left the attitudes out, so that a camera which turns was taken not to."""
    text = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    example = text.split("In Python:")[1].split("```")[1].removeprefix("python\n")
    attitudes = []

    class Listening(MultiRangeEstimator):
        def add_attitude(self, stamp_ns, world_from_camera):
            attitudes.append(stamp_ns)
            super().add_attitude(stamp_ns, world_from_camera)

    monkeypatch.setattr(
        fd, "open_flight", lambda path, telemetry, camera: open_flight(VIDEO, LOG, camera, end_s=0.1)
    )
    monkeypatch.setattr(fd, "MultiRangeEstimator", Listening)
    exec(example, {})
    assert len(attitudes) >= 2
    assert "\n2 [" in capsys.readouterr().out  # the third frame
