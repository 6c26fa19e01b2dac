"""Scenes that were drawn before must stay what they are, to the bit: test sets, trained networks, the sample flight.

The digests are of `SET_VERSION` "2" and `OUTDOOR_VERSION` "1"; `python tests/scenes/test_golden_scenes.py` prints them.
"""

import dataclasses
import hashlib
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from flightdepth.scenes import Scene, StillBoxConfig, draw_scene
from flightdepth.scenes.config import SET_VERSION
from flightdepth.scenes.outdoor import draw_outdoor
from flightdepth.scenes.outdoor_config import OUTDOOR_VERSION, OutdoorConfig

# name: changes to the config, textures, seed, scenes, digest
CLOSED = {
    "test set": ({}, 96, 170202017, 300, "57007a24acafedea"),
    "training": ({}, 96, 1, 200, "6ff0fade1febb53c"),
    "plain": ({}, 0, 6, 50, "22e48d872fa43094"),
    "open": ({"open_share": 0.5}, 96, 3, 60, "68def7b6bf8ad4c8"),
    "narrow": ({"horizontal_fov_deg": 60.0, "frames": 30, "speed_m_s": 0.5}, 8, 2, 60, "d8561e6bab8cce57"),
    "fast": ({"speed_m_s": 5.0, "time_step_s": 0.2}, 8, 2, 60, "de5f6c0ddb28073a"),
    "sparse": (
        {"meshes": (0, 4), "clearance_m": 2.0, "lamps": (1, 5), "texture_ratio": 0.9},
        8,
        2,
        60,
        "2b94627f8d65cec0",
    ),
}
# name: changes to the config, seed, scenes, digest
OUTDOORS = {
    "sample": ({}, 1, 2, "0cf850be8a334625"),
    "slow": ({"frames": 30, "rate_hz": 3.0}, 5, 4, "6c15cafda1cbaa3b"),
    "few": (
        {"frames": 12, "trees": (2, 4), "hills": (0, 3), "speed_m_s": (1.0, 9.0)},
        7,
        4,
        "7773637022db231e",
    ),
}


def arrays(holder: object) -> Iterator[np.ndarray]:
    for field in dataclasses.fields(holder):
        value = getattr(holder, field.name)
        if isinstance(value, np.ndarray):
            yield value
        else:
            yield from arrays(value)


def digest(scenes: Iterable[Scene]) -> str:
    """Of every byte of every array of the scenes."""
    sha = hashlib.sha256()
    for scene in scenes:
        for array in arrays(scene):
            sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()[:16]


def closed(name: str) -> str:
    change, textures, seed, scenes, _ = CLOSED[name]
    config = StillBoxConfig(**change)
    return digest(draw_scene(config, textures, seed, number) for number in range(scenes))


def outdoors(name: str) -> str:
    change, seed, scenes, _ = OUTDOORS[name]
    config = OutdoorConfig(**change)
    return digest(draw_outdoor(config, seed, number) for number in range(scenes))


@pytest.mark.parametrize("name", CLOSED)
def test_closed_scenes_stay_what_they_are(name):
    assert (SET_VERSION, closed(name)) == ("2", CLOSED[name][-1])


@pytest.mark.parametrize("name", OUTDOORS)
def test_outdoor_scenes_stay_what_they_are(name):
    assert (OUTDOOR_VERSION, outdoors(name)) == ("1", OUTDOORS[name][-1])


if __name__ == "__main__":
    for name in CLOSED:
        print(name, closed(name))
    for name in OUTDOORS:
        print(name, outdoors(name))
