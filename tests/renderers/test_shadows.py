import numpy as np
from bundled import Seen, filled

from flightdepth.camera import Camera
from flightdepth.renderers.shadows import LIT, aim, cast_shadow, list_blockers
from flightdepth.scenes import StillBoxConfig, draw_scene

CAMERA = Camera.from_fov(32, 32, 90)


def blocked(seen: Seen, lamp: int, points: np.ndarray, objects) -> np.ndarray:
    """Which of these objects stands between each point and a lamp, or LIT."""
    x, y, z = points.T
    bundles, count = filled(px=x, py=y, pz=z)
    aim(seen.lamps, lamp, bundles, count)
    for k in objects:
        cast_shadow(seen.things, int(k), bundles, count)
    return bundles[0]["blocker"][:count].copy()


def test_lists_hold_every_object_that_shades_a_point_within_their_radius():
    rng, found = np.random.default_rng(0), 0
    for number in range(25):
        scene = draw_scene(StillBoxConfig(lamps=(2, 3)), 0, 1, number)
        seen = Seen(scene, CAMERA)
        lists = np.zeros((len(seen.lamps), len(seen.things)), np.int16)
        for _ in range(8):
            centre = rng.uniform([-15, -15, 0], [15, 15, 30])
            radius = rng.uniform(0.01, 3)
            list_blockers(seen.things, seen.lamps, len(seen.things) - 1, *centre, radius, lists)
            points = centre + rng.uniform(-1, 1, (5, 3)) * radius / 3**0.5
            for lamp, listed in enumerate(lists):
                assert listed[0] < len(seen.things)
                ours = blocked(seen, lamp, points, listed[1 : listed[0] + 1])
                everyone = blocked(seen, lamp, points, range(len(scene.shape)))
                np.testing.assert_array_equal(ours == LIT, everyone == LIT)
                found += (ours != LIT).sum()
    assert found > 100


def test_the_first_object_asked_is_named_and_points_do_not_mind_each_other():
    rng, found = np.random.default_rng(1), 0
    for number in range(10):
        scene = draw_scene(StillBoxConfig(), 0, 2, number)
        seen, points = Seen(scene, CAMERA), rng.uniform([-15, -15, 0], [15, 15, 30], (24, 3))
        together = blocked(seen, 0, points, range(len(scene.shape)))
        for point, name in zip(points, together, strict=True):
            alone = [k for k in range(len(scene.shape)) if blocked(seen, 0, point[None], [k])[0] != LIT]
            assert name == (alone[0] if alone else LIT)
            found += name != LIT
    assert found > 20


def test_lists_leave_most_objects_out():
    listed = objects = 0
    for number in range(10):
        scene = draw_scene(StillBoxConfig(), 0, 1, number)
        seen = Seen(scene, CAMERA)
        lists = np.zeros((len(seen.lamps), len(seen.things)), np.int16)
        list_blockers(seen.things, seen.lamps, len(seen.things) - 1, 1.0, 2.0, 9.0, 0.1, lists)
        listed += lists[:, 0].sum()
        objects += len(seen.lamps) * len(scene.shape)
    assert listed < 0.3 * objects
