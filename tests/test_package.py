"""What `import flightdepth as fd` offers."""

import pickle
import subprocess
import sys
from importlib.metadata import version

import pytest

import flightdepth as fd
from flightdepth.errors import MissingExtra


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
