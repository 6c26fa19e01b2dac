"""Addresses where no Ray cluster is; nothing here starts one."""

import socket

import pytest
from small_sets import TEXTURES, small_source

from flightdepth.errors import BadInput
from flightdepth.stillbox.engines import on_ray

pytest.importorskip("ray", reason="needs flightdepth[cluster]")


@pytest.fixture
def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_where_nobody_answers(free_port):
    with pytest.raises(BadInput, match=f"--address: expected HOST:PORT .*, got 127.0.0.1:{free_port}"):
        next(on_ray(small_source(), TEXTURES, range(2), f"127.0.0.1:{free_port}"))


@pytest.mark.parametrize("address", ["nowhere", "host:", ":10", "host:port", "127.0.0.1:99999", ""])
def test_what_is_no_address(address):
    with pytest.raises(BadInput, match="--address: expected HOST:PORT"):
        next(on_ray(small_source(), TEXTURES, range(2), address))
