"""Outdoor scenes: the same for the same seed, clear of the flight, and a flight that obeys its own velocity."""

import numpy as np
import pytest
from pydantic import ValidationError

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import Textures
from flightdepth.scenes.outdoor import draw_outdoor, outdoor_flight
from flightdepth.scenes.outdoor_config import GROUND_PIECES, PIECES, OutdoorConfig
from flightdepth.scenes.outdoor_textures import VARIANTS, Surface, picture
from flightdepth.scenes.scene import Shape
from flightdepth.scenes.textures import PYRAMID_TEXELS

CONFIG = OutdoorConfig(frames=30, rate_hz=3.0)
ANY = OutdoorConfig(frames=60, rate_hz=10.0, legs="any")


@pytest.fixture(scope="module")
def scene():
    return draw_outdoor(CONFIG, seed=5)


# The flight


@pytest.mark.parametrize("config", [OutdoorConfig(), ANY], ids=["forward-sideways", "any"])
def test_position_is_the_integral_of_the_velocity(config):
    flight, time_s = outdoor_flight(config, seed=1), np.linspace(0, config.duration_s, 20_001)
    velocity = flight.velocity(time_s)
    steps = (velocity[1:] + velocity[:-1]) / 2 * np.diff(time_s)[:, None]
    summed = flight.position(time_s)[0] + np.cumsum(steps, axis=0)
    assert np.abs(summed - flight.position(time_s)[1:]).max() < 1e-5


def test_the_first_leg_is_forward_and_the_second_sideways():
    flight = outdoor_flight(OutdoorConfig(), seed=1)
    start, end = flight.velocity(np.array([0.0, 10.0]))
    assert start == pytest.approx([0, 0, flight.first_m_s[2]])
    assert end == pytest.approx([flight.second_m_s[0], 0, 0])


def test_the_camera_looks_ahead_and_down():
    flight = outdoor_flight(OutdoorConfig(), seed=1)
    ahead = flight.world_from_camera @ (0, 0, 1)
    assert ahead[1] / ahead[2] == pytest.approx(flight.pitch_down)  # y is down


def test_the_orientation_is_a_rotation():
    turn = outdoor_flight(OutdoorConfig(), seed=1).world_from_camera
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)


@pytest.mark.parametrize("seed", range(8))
def test_speed_and_height_lie_in_their_ranges(seed):
    flight = outdoor_flight(CONFIG, seed)
    assert CONFIG.speed_m_s[0] <= flight.first_m_s[2] <= CONFIG.speed_m_s[1]
    assert CONFIG.speed_m_s[0] <= abs(flight.second_m_s[0]) <= CONFIG.speed_m_s[1]
    assert CONFIG.height_m[0] <= flight.height_m <= CONFIG.height_m[1]


# Flights any way


@pytest.fixture(scope="module")
def any_flights():
    return [outdoor_flight(ANY, seed=1, number=number) for number in range(400)]


def test_any_heading_is_as_likely_as_another(any_flights):
    legs = np.array([leg for flight in any_flights for leg in (flight.first_m_s, flight.second_m_s)])
    heading = legs[:, [0, 2]] / np.linalg.norm(legs[:, [0, 2]], axis=1, keepdims=True)
    # Deviations over 800 legs: sqrt(1/2 / n) for sine and cosine, sqrt(1/8 / n) for their squares.
    assert np.abs(heading.mean(axis=0)).max() < 4.5 * np.sqrt(1 / 2 / 800)
    assert np.abs((heading**2).mean(axis=0) - 0.5).max() < 4.5 * np.sqrt(1 / 8 / 800)


def test_speeds_over_the_ground_and_climbs_lie_in_their_ranges(any_flights):
    legs = np.array([leg for flight in any_flights for leg in (flight.first_m_s, flight.second_m_s)])
    speed = np.hypot(legs[:, 0], legs[:, 2])
    assert (speed >= ANY.speed_m_s[0]).all()
    assert (speed <= ANY.speed_m_s[1]).all()
    assert np.abs(legs[:, 1]).max() <= ANY.climb_m_s
    assert legs[:, 1].min() < -0.5 < 0.5 < legs[:, 1].max()


def test_the_height_stays_in_its_range_all_the_way(any_flights):
    time_s = np.linspace(0, ANY.duration_s, 60)
    heights_m = np.array([-flight.position(time_s)[:, 1] for flight in any_flights])
    assert heights_m.min() >= ANY.height_m[0] - 1e-9
    assert heights_m.max() <= ANY.height_m[1] + 1e-9


# The scene


def test_the_same_seed_gives_the_same_scene(scene):
    again = draw_outdoor(CONFIG, seed=5)
    assert (again.world_from_object == scene.world_from_object).all()
    assert (again.materials.texture == scene.materials.texture).all()


def test_another_number_gives_another_scene(scene):
    other = draw_outdoor(CONFIG, seed=5, number=1)
    assert not np.array_equal(other.camera_position, scene.camera_position)


def test_the_sky_is_open(scene):
    assert np.isinf(scene.room_half).all()


def test_every_texture_exists(scene):
    assert scene.materials.texture.min() >= 0
    assert scene.materials.texture.max() < VARIANTS * len(Surface)


def distances_m(scene, k, path=None):
    """Sampled distances from the path to the surface of object k, metres."""
    path = scene.camera_position if path is None else path
    rng = np.random.default_rng(k)
    unit = rng.uniform(-1, 1, (400, 3))
    if scene.shape[k] == Shape.CUBE:
        side = rng.integers(3, size=400)
        unit[np.arange(400), side] = rng.choice([-1.0, 1.0], 400)
    elif scene.shape[k] == Shape.SPHERE:
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    else:
        angle, z = rng.uniform(0, 2 * np.pi, 400), unit[:, 2]
        unit = np.stack([np.cos(angle) * (1 - z) / 2, np.sin(angle) * (1 - z) / 2, z], axis=1)
    pose = scene.world_from_object[k]
    points = unit @ pose[:, :3].T + pose[:, 3]
    squares = (points**2).sum(axis=1)[:, None] + (path**2).sum(axis=1) - 2 * points @ path.T
    return np.sqrt(squares.clip(0))


FAR = OutdoorConfig(  # 600 m in steps of 30 m, past hills and through a country full of trees
    legs="any",
    speed_m_s=(14.0, 16.0),
    height_m=(6.0, 8.0),
    clearance_m=2.0,
    trees=(150, 150),
    woods=(30, 30),
    hills=(30, 30),
    houses=(0, 0),
    bushes=(0, 0),
).model_copy(update={"frames": 20, "rate_hz": 0.5})  # farther than is taken from outside


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("config", [CONFIG, ANY], ids=["forward-sideways", "any"])
def test_the_path_keeps_clear_of_everything(config, seed):
    scene = draw_outdoor(config, seed)
    nearest = min(distances_m(scene, k).min() for k in range(len(scene.shape)))
    assert nearest >= CONFIG.clearance_m


@pytest.mark.parametrize(
    "seed", [8, 9, 12, 17]
)  # each met a wood or a hill before they were kept off the path
def test_a_far_flight_keeps_clear_between_its_frames_too(seed):
    """Between the points that are checked, 2 m apart, a surface may come 14 % nearer."""
    scene, flight = draw_outdoor(FAR, seed), outdoor_flight(FAR, seed)
    path = flight.position(np.linspace(0, (FAR.frames - 1) / FAR.rate_hz, 500))
    gaps = np.linalg.norm(scene.world_from_object[:, None, :, 3] - path, axis=2)
    close = np.flatnonzero(gaps.min(axis=1) - scene.bound_radii_m() < FAR.clearance_m)
    solids = [k for k in close if scene.bound_radii_m()[k] < 140]  # the ground is under the lowest height
    nearest = min(distances_m(scene, k, path).min() for k in solids)
    assert nearest >= 0.86 * FAR.clearance_m


def test_bounds_hold_every_object(scene):
    """The gables and roofs are sheared, which the bounding radius does not expect of its own."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
    cubes = scene.shape == Shape.CUBE
    corners = scene.world_from_object[cubes, :, :3] @ signs
    reach = np.linalg.norm(corners, axis=1).max(axis=1)
    assert (reach <= scene.bound_radii_m()[cubes] * (1 + 1e-9)).all()


# What is refused


@pytest.mark.parametrize("legs", ["forward-sideways", "any"])
def test_as_far_as_a_flight_may_go_there_is_ground_below_the_horizon(legs):
    """300 frames at 1 Hz flew 884 m, off the plain, with sky below."""
    config = OutdoorConfig(frames=16, rate_hz=0.3, legs=legs)
    camera, blank = Camera.from_fov(48, 48, 90), Textures(np.zeros((30, PYRAMID_TEXELS, 3), np.uint8))
    rows, columns = np.mgrid[:48, :48]
    rays = np.stack(
        [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones((48, 48))], -1
    )
    for number in range(6):
        scene = draw_outdoor(config, 3, number)
        down = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)) @ scene.world_from_camera[0, 1]
        assert np.isfinite(render(scene, blank, camera).depth_m[:, down > np.sin(np.radians(1.5))]).all()


def test_a_flight_beyond_that_is_refused_and_how_to_mend_it_told():
    with pytest.raises(
        ValidationError, match=r"speed_m_s: expected flights of at most 300 m, .* got 1794 m; few"
    ):
        OutdoorConfig(frames=300, rate_hz=1.0)


@pytest.mark.parametrize("kind", PIECES)
def test_nothing_is_built_of_more_pieces_than_are_counted(kind):
    nothing = dict.fromkeys(PIECES, (0, 0))
    few, many = (OutdoorConfig(**nothing | {kind: (count, count)}) for count in (0, 12))
    for number in range(4):
        ground, all_of_it = (len(draw_outdoor(config, 2, number).shape) for config in (few, many))
        assert ground <= GROUND_PIECES
        assert 0 < all_of_it - ground <= 12 * PIECES[kind]


def test_more_things_than_a_renderer_can_name_are_refused():
    with pytest.raises(ValidationError, match="expected things of at most 32767 pieces, got up to 49"):
        OutdoorConfig(woods=(0, 1000))
    assert OutdoorConfig(woods=(0, 600)).woods[1] == 600


@pytest.mark.parametrize("change", [{"speed_m_s": (6, 4)}, {"height_m": (2, 12)}, {"colour": 1}])
def test_a_config_that_cannot_be(change):
    with pytest.raises(ValidationError):
        OutdoorConfig.model_validate(change)


# The textures


@pytest.mark.parametrize("surface", list(Surface))
def test_a_surface_has_contrast_and_depends_on_its_stream_only(surface):
    first, second = (picture(surface, np.random.default_rng(3)) for _ in range(2))
    assert (first == second).all()
    assert first.std() > 5
