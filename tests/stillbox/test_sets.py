"""Sets by name, with knobs from the user."""

import json

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import VARIANTS, Surface
from flightdepth.stillbox.sets import ORIGINAL_SCENES, SET_NAMES, SceneSet, changed, named_set, read_overrides

BLANK = Textures.from_images([])


# Names


@pytest.mark.parametrize(
    ("name", "scenes"), [("64", 80_000), ("128", 16_000), ("256", 3_200), ("512", 3_200)]
)
def test_the_original_s_sets(name, scenes):
    assert named_set(name) == (SceneSet(StillBoxConfig(), int(name), int(name), seed=1), scenes)
    assert ORIGINAL_SCENES[int(name)] == scenes


def test_the_outdoor_set_is_wide_and_flies_any_way():
    found, scenes = named_set("outdoor")
    assert (found.width, found.height, scenes) == (512, 320, 300)
    assert found.config.legs == "any"


def test_every_name_is_listed():
    assert SET_NAMES == ("64", "128", "256", "512", "outdoor")


def test_an_unknown_name_is_refused():
    with pytest.raises(BadInput, match="set: expected one of 64, 128, 256, 512, outdoor, got '65'"):
        named_set("65")


# Overrides


def test_overrides_of_the_set_and_of_its_config():
    found, scenes = named_set("64", scenes=7, seed=3, frames=20, clearance_m=2.0, orientation_noise_rad=0.001)
    assert scenes == 7
    config = StillBoxConfig(frames=20, clearance_m=2.0, orientation_noise_rad=0.001)
    assert found == SceneSet(config, 64, 64, seed=3)


@pytest.mark.parametrize(
    ("change", "size"),
    [({"width": 96}, (96, 96)), ({"height": 48}, (64, 48)), ({"width": 96, "height": 32}, (96, 32))],
)
def test_a_width_alone_keeps_the_picture_square(change, size):
    found, _ = named_set("64", **change)
    assert (found.width, found.height) == size


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (
            "64",
            {"colour": "red"},
            r"set, colour: expected keys from scenes, width, height, seed, frames, .*, lamps, got colour$",
        ),
        ("64", {"frames": 0}, r"set, frames: expected greater than or equal to 1, got 0$"),
        ("64", {"frame": 4}, r"set, frame: expected keys from .*, lamps; perhaps frames, got frame$"),
        ("64", {"meshes": 5}, r"set, meshes: expected a list, got 5$"),
        ("64", {"meshes": [1, 2, 3]}, r"set, meshes: expected at most 2 items .*, got \[1, 2, 3\]$"),
        ("64", {"speed_m_s": "fast"}, r"set, speed_m_s: expected a valid number.*, got fast$"),
        ("64", {"meshes": [9, 3]}, r"meshes: expected 0 <= low <= high, got 9, 3"),
        ("outdoor", {"speed_m_s": (3, 1)}, r"set, speed_m_s: expected 0 <= low <= high, got 3\.0, 1\.0$"),
        ("64", {"meshes": [1, "x"]}, r"set, meshes\.1: expected .*integer.*, got x"),
        ("64", {"frames": 900}, r"room_half_m: expected at least .* 46\.15 m"),
        ("64", {"legs": "any"}, r"set, legs: expected keys from .*, got legs$"),
        ("64", {"scenes": 0}, r"scenes of a set: expected a whole number from 1 on, got 0"),
        ("64", {"scenes": True}, r"scenes of a set: .* got True"),
        ("64", {"width": 0}, r"width of a set: expected a whole number from 1 on, got 0"),
        ("64", {"seed": -1}, r"seed of a set: expected a whole number from 0 on, got -1"),
        ("64", {"seed": 2**32}, r"seed of a set: expected at most 4294967295, got 4294967296"),
        ("64", {"height": 3.5}, r"height of a set: .* got 3\.5"),
        ("outdoor", {"legs": "up"}, r"set, legs: expected .*'any', got up"),
        ("outdoor", {"texture_ratio": 1}, r"set, texture_ratio: expected keys from .*, got texture_ratio$"),
        ("outdoor", {"turn_over_s": 9.0}, r"turn_over_s: expected at most the scene's 6\.00 s"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(name, change, said):
    with pytest.raises(BadInput, match=said) as caught:
        named_set(name, **change)
    assert "\n" not in str(caught.value)


def test_a_config_changes_as_a_whole():
    """Two values that fit together only both at once."""
    config = changed(StillBoxConfig(), {"frames": 900, "room_half_m": (50.0, 90.0)})
    assert config == StillBoxConfig(frames=900, room_half_m=(50.0, 90.0))


# Files


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_file_of_overrides(tmp_path, suffix):
    values = {"frames": 30, "meshes": [4, 9], "objects_ahead_of": "path", "width": 96}
    path = tmp_path / f"mine{suffix}"
    toml = 'frames = 30\nmeshes = [4, 9]\nobjects_ahead_of = "path"\nwidth = 96\n'
    path.write_text(json.dumps(values) if suffix == ".json" else toml)
    assert read_overrides(path) == values
    assert named_set("64", **read_overrides(path))[0].config.meshes == (4, 9)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.toml", "frames = = 3", "expected TOML, got .*line 1"),
        ("a.json", "{frames: 3}", "expected JSON, got .*line 1"),
        ("a.json", "[3]", "expected one table of names and values, got list"),
        ("a.json", b"\xff\xfe", "expected JSON"),
        ("a.yaml", "frames: 3", r"expected a \.toml or \.json file"),
    ],
)
def test_a_file_that_cannot_be_read(tmp_path, name, text, said):
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(BadInput, match=said):
        read_overrides(tmp_path / name)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(BadInput, match="that exists"):
        read_overrides(tmp_path / "no.toml")


# What a set answers


@pytest.mark.parametrize(("width", "height"), [(48, 16), (16, 48)])
def test_pictures_of_any_shape_keep_the_horizontal_field_of_view(width, height):
    found = SceneSet(StillBoxConfig(horizontal_fov_deg=60), width, height, seed=2)
    scene = found.scene(1, 0)
    seen = render(scene, BLANK, found.camera)
    assert seen.images.shape == (10, height, width, 3)
    assert found.camera.horizontal_fov_deg == pytest.approx(60)
    assert found.camera.fx == found.camera.fy
    np.testing.assert_array_equal(
        scene.world_from_object, draw_scene(found.config, 0, 2, 1, height / width).world_from_object
    )


@pytest.mark.parametrize(
    "config",
    [
        StillBoxConfig(frames=4, time_step_s=0.25, speed_m_s=2),
        OutdoorConfig(frames=600, rate_hz=60.0),
        OutdoorConfig(frames=600, rate_hz=60.0, legs="any"),
    ],
    ids=["closed", "forward-sideways", "any"],
)
def test_velocity_times_time_step_is_the_way_flown(config):
    found = SceneSet(config, 16, 16, seed=2)
    velocity, position = found.velocity(3), found.scene(3, 0).camera_position
    assert velocity.shape == position.shape
    way = np.cumsum((velocity[1:] + velocity[:-1]) / 2 * config.time_step_s, axis=0)
    np.testing.assert_allclose(position[1:] - position[0], way, atol=1e-3)


def test_a_flight_of_one_frame_has_a_velocity():
    velocity = SceneSet(StillBoxConfig(frames=1), 16, 16, seed=2).velocity(0)
    assert np.linalg.norm(velocity) == pytest.approx(1.0)


def test_an_outdoor_set_brings_its_textures_and_sees_the_sky():
    found = SceneSet(OutdoorConfig(frames=2, houses=(1, 1), trees=(2, 3), bushes=(4, 5)), 24, 16, seed=2)
    textures = found.own_textures()
    assert len(textures) == VARIANTS * len(Surface)
    seen = render(found.scene(0, len(textures)), textures, found.camera)
    assert np.isinf(seen.depth_m).any()
    assert np.isfinite(seen.depth_m).any()


def test_a_closed_set_is_given_its_textures():
    assert SceneSet(StillBoxConfig(), 8, 8, seed=0).own_textures() is None


def test_versions_tell_the_kinds_of_sets_apart():
    closed, outdoor = (
        SceneSet(config, 8, 8, seed=0).version for config in (StillBoxConfig(), OutdoorConfig())
    )
    assert (closed, outdoor) == ("2", "outdoor-1")
