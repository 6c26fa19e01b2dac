import numpy as np

from flightdepth.camera import Camera
from flightdepth.renderers.shadows import LIT, first_blocker, list_blockers
from flightdepth.renderers.view import prepare_view, prepare_world
from flightdepth.scenes import StillBoxConfig, draw_scene

CAMERA = Camera.from_fov(32, 32, 90)


def everything(view) -> np.ndarray:
    """Lists that leave no object out."""
    objects = len(view.things) - 1
    one = np.concatenate([[objects], np.arange(objects)]).astype(np.int16)
    return np.repeat(one[None], len(view.lamps), axis=0)


def test_lists_hold_every_object_that_shades_a_point_within_their_radius():
    rng, blocked = np.random.default_rng(0), 0
    for number in range(25):
        scene = draw_scene(StillBoxConfig(lamps=(2, 3)), 0, 1, number)
        view = prepare_view(scene, prepare_world(scene), CAMERA, 0)
        lists, all_lists = np.zeros((len(view.lamps), len(view.things)), np.int16), everything(view)
        for _ in range(8):
            centre = rng.uniform([-15, -15, 0], [15, 15, 30])
            radius = rng.uniform(0.01, 3)
            list_blockers(view.things, view.lamps, len(view.things) - 1, *centre, radius, lists)
            for lamp, position in enumerate(scene.lamp_position):
                point = centre + rng.uniform(-1, 1, 3) * radius / 3**0.5
                ray = (*point, 0.0, 0.0, 0.0, *(position - point))
                found = first_blocker(view.things, lists, lamp, *ray)
                assert (found == LIT) == (first_blocker(view.things, all_lists, lamp, *ray) == LIT)
                assert lists[lamp, 0] < len(view.things)
                blocked += found != LIT
    assert blocked > 20


def test_lists_leave_most_objects_out():
    listed = objects = 0
    for number in range(10):
        scene = draw_scene(StillBoxConfig(), 0, 1, number)
        view = prepare_view(scene, prepare_world(scene), CAMERA, 0)
        lists = np.zeros((len(view.lamps), len(view.things)), np.int16)
        list_blockers(view.things, view.lamps, len(view.things) - 1, 1.0, 2.0, 9.0, 0.1, lists)
        listed += lists[:, 0].sum()
        objects += len(view.lamps) * len(scene.shape)
    assert listed < 0.3 * objects
