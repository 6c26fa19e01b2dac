"""Fixtures of the commands' tests."""

from collections.abc import Iterator

import pytest

from flightdepth.runtimes import network
from tests_compiled import opened_once

OPENED = opened_once(network.open_runtime)


@pytest.fixture(autouse=True, scope="module")
def networks_compiled_once() -> Iterator[None]:
    """Of all modules here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(network, "open_runtime", OPENED)
        yield
