"""Pairs to fit the judge on: what is drawn for them has nothing to do with what the scenes draw."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightdepth.renderers.raycast import Rendered
from flightdepth.scenes import Textures
from flightdepth.scenes.draw import stillbox_velocity
from flightdepth.scenes.outdoor import outdoor_velocity

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
judging_pairs = importlib.import_module("judging_pairs")
fitting_pairs = judging_pairs.fitting_pairs

PAIRS = 400
NOTHING = Rendered(np.zeros((2, 4, 4, 3), np.uint8), np.ones((2, 4, 4), np.float32))


@pytest.fixture
def only_flown(monkeypatch):
    """Scenes that are flown through, but neither built nor seen; a pair's displacement is the first velocity."""

    def flown(velocity):
        return SimpleNamespace(displacement=lambda *_: velocity[0])

    def room(config, _, *key):
        return flown(stillbox_velocity(config, *key))

    monkeypatch.setattr(judging_pairs, "draw_scene", room)
    monkeypatch.setattr(judging_pairs, "draw_outdoor", lambda *key: flown(outdoor_velocity(*key)))
    for textures in ("_room_textures", "outdoor_textures"):
        monkeypatch.setattr(judging_pairs, textures, lambda _: Textures.from_images([]))
    monkeypatch.setattr(judging_pairs, "render", lambda *_, **__: NOTHING)
    monkeypatch.setattr(judging_pairs, "EFFECTS_SHARE", 0.0)


@pytest.mark.parametrize("room_share", [0.0, 1.0], ids=["outdoors", "rooms"])
def test_the_lens_says_nothing_of_the_way_flown(only_flown, monkeypatch, room_share):
    """Both began with one stream: outdoors the lens told the speed, in rooms the direction."""
    monkeypatch.setattr(judging_pairs, "ROOM_SHARE", room_share)
    pairs = list(fitting_pairs(PAIRS, wrong_share=0.0))
    way = np.array([pair.displacement for pair in pairs])
    lens, over_ground = [pair.camera.horizontal_fov_deg for pair in pairs], np.hypot(way[:, 0], way[:, 2])
    columns = [lens, over_ground, *way.T]
    assert np.abs(np.corrcoef(columns)[0, 1:]).max() < 0.2
