import numpy as np
import plain_hits
import pytest
from built_scenes import NO_TEXTURES, SHAPES, built, pose, turned_by

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, draw_scene
from flightdepth.scenes.scene import Shape

CAMERA = Camera.from_fov(40, 32, 90)


def plain_depth(shape, world_from_object, radius, camera) -> np.ndarray:
    """z-depth [H, W] of one object seen from the origin."""
    linear, centre = world_from_object[:, :3], world_from_object[:, 3]
    o = np.linalg.solve(linear, -centre)
    rays = camera.rays().reshape(-1, 3)
    hits = [plain_hits.hit_unit(shape, radius, o, np.linalg.solve(linear, ray)) for ray in rays]
    return np.reshape(hits, (camera.height, camera.width))


def rendered_depth(scene, camera=CAMERA, frame=0) -> np.ndarray:
    return render(scene, NO_TEXTURES, camera, frames=[frame]).depth_m[0]


@pytest.mark.parametrize("shape", list(Shape))
@pytest.mark.parametrize("seed", range(3))
def test_an_object_under_open_sky(shape, seed):
    place = pose([3.0, 2.0, 1.5], [0.5, -1.0, 8.0], turned_by(seed))
    ours = rendered_depth(built([(shape, place, SHAPES[shape])], room=None))
    plain = plain_depth(shape, place, SHAPES[shape], CAMERA)
    assert 0.03 < np.isfinite(plain).mean() < 0.95
    np.testing.assert_array_equal(np.isfinite(ours), np.isfinite(plain))
    np.testing.assert_allclose(ours, plain, rtol=1e-6)


@pytest.mark.parametrize("shape", list(Shape))
def test_an_object_that_reaches_behind_the_camera(shape):
    place = pose([6.0, 3.0, 40.0], [5.0, 4.5, 0.0])
    ours = rendered_depth(built([(shape, place, SHAPES[shape])], room=None))
    plain = plain_depth(shape, place, SHAPES[shape], CAMERA)
    np.testing.assert_allclose(ours, plain, rtol=1e-6)


def test_an_object_behind_the_camera_is_not_seen():
    place = pose([2.0, 2.0, 2.0], [0.0, 0.0, -9.0])
    assert np.isinf(rendered_depth(built([(Shape.SPHERE, place, 0.0)], room=None))).all()


def test_the_room_s_walls():
    ours = rendered_depth(built(room=(7.0, 5.0, 11.0)))
    rays = CAMERA.rays()
    with np.errstate(divide="ignore"):
        plain = np.minimum(np.minimum(7 / np.abs(rays[..., 0]), 5 / np.abs(rays[..., 1])), 11.0)
    np.testing.assert_allclose(ours, plain, rtol=1e-6)


def test_the_nearest_of_many_objects_is_seen():
    placed = [
        (shape, pose([1.5, 1.0, 2.0], [x, y, 7 + 2 * x], turned_by(n)), SHAPES[shape])
        for n, (shape, x, y) in enumerate(
            zip(list(Shape) * 2, np.linspace(-3, 3, 8), [0, 1] * 4, strict=True)
        )
    ]
    ours = rendered_depth(built(placed))
    each = [rendered_depth(built([one], room=None)) for one in placed]
    np.testing.assert_array_equal(ours, np.min([*each, rendered_depth(built())], axis=0))


def through(ray) -> Camera:
    """A camera of one pixel that looks along (x, y, 1)."""
    return Camera(1, 1, 1.0, 1.0, -float(ray[0]), -float(ray[1]))


def test_a_point_seen_from_one_place_is_there_from_another():
    scene, agreed = draw_scene(StillBoxConfig(), 0, 3, 1), 0
    camera = Camera.from_fov(16, 16, 90)
    moved = scene.camera_position[9] - scene.camera_position[0]
    points = camera.rays() * rendered_depth(scene, camera)[..., None].astype(np.float64) - moved
    for point in points.reshape(-1, 3):
        seen = rendered_depth(scene, through(point / point[2]), frame=9)[0, 0]
        assert seen < point[2] * (1 + 1e-5)  # the point itself or something before it
        agreed += seen > point[2] * (1 - 1e-5)
    assert agreed > 0.9 * points.size / 3
