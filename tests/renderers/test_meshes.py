"""The unit primitives as triangles: on the surface, outwards, and with the ray caster's places on the texture."""

import numpy as np
import pytest

from flightdepth.renderers.meshes import Mesh, cube_face, primitive
from flightdepth.renderers.surfaces import normal_in_object, texture_place
from flightdepth.scenes.scene import Shape

RADIUS = 0.3
SEGMENTS = 128
VOLUMES = {
    Shape.CUBE: 8.0,
    Shape.SPHERE: 4 / 3 * np.pi,
    Shape.CONE: 2 / 3 * np.pi,
    Shape.TORUS: 2 * np.pi**2 * RADIUS**2,
}


def made(shape) -> Mesh:
    return primitive(shape, RADIUS, SEGMENTS)


def faces(shape, mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres, normals (twice the area long) and part numbers of the triangles."""
    p = mesh.vertices[mesh.triangles]
    centres, normals = p.mean(axis=1), np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    if shape is Shape.CUBE:
        axis = np.abs(normals).argmax(axis=1)
        return centres, normals, 2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)
    return centres, normals, ((centres[:, 2] < -1 + 1e-9) & (shape is Shape.CONE)).astype(int)


def distance_inside(shape, points) -> np.ndarray:
    """How far points lie under the surface of a sphere or a torus."""
    ring = np.hypot(points[:, 0], points[:, 1])
    if shape is Shape.SPHERE:
        return 1 - np.linalg.norm(points, axis=1)
    return RADIUS - np.hypot(ring - 1, points[:, 2])


@pytest.mark.parametrize("shape", list(Shape))
def test_the_mesh_is_closed_and_has_the_shape_s_volume(shape):
    mesh = made(shape)
    centres, normals, _ = faces(shape, mesh)
    assert np.abs(normals.sum(axis=0)).max() < 1e-9  # of any closed surface
    assert np.einsum("ij,ij->", centres, normals) / 6 == pytest.approx(VOLUMES[shape], rel=3e-3)


@pytest.mark.parametrize("shape", list(Shape))
def test_triangles_look_outwards(shape):
    centres, normals, parts = faces(shape, made(shape))
    for centre, normal, part in list(zip(centres, normals, parts, strict=True))[::37]:
        assert np.dot(normal_in_object(int(shape), int(part), *centre), normal) > 0


@pytest.mark.parametrize("shape", list(Shape))
def test_places_on_the_texture_are_the_ray_caster_s(shape):
    mesh = made(shape)
    centres, _, parts = faces(shape, mesh)
    for centre, part, uv in list(zip(centres, parts, mesh.uv.mean(axis=1), strict=True))[::37]:
        expected = texture_place(int(shape), int(part), RADIUS, *centre)[:2]
        np.testing.assert_allclose(uv, expected, atol=0.35 / SEGMENTS)  # a third of a cell, beside a pole


@pytest.mark.parametrize("shape", [Shape.SPHERE, Shape.TORUS])
@pytest.mark.parametrize("segments", [64, 256])
def test_chords_lie_within_five_over_segments_squared(shape, segments):
    """A cell spans 2 pi / segments either way (a torus' tube twice that): at most two sagittas deep."""
    mesh = primitive(shape, RADIUS, segments)
    p = mesh.vertices[mesh.triangles]
    middles = np.concatenate(
        [p.mean(axis=1), (p[:, 0] + p[:, 1]) / 2, (p[:, 1] + p[:, 2]) / 2, (p[:, 2] + p[:, 0]) / 2]
    )
    inside = distance_inside(shape, middles)
    assert np.abs(distance_inside(shape, mesh.vertices)).max() < 1e-12
    bound = {Shape.SPHERE: 2 * np.pi**2 / 2, Shape.TORUS: (4 * RADIUS + 1 + RADIUS) * np.pi**2 / 2}[shape]
    assert 0.5 * bound / segments**2 < inside.max() < bound / segments**2 * 1.01


def test_cube_faces_follow_each_other_as_in_scenes():
    for part in range(6):
        vertices = cube_face(part).vertices
        assert (vertices[:, part // 2] == (1.0 if part % 2 else -1.0)).all()
        assert np.abs(np.delete(vertices, part // 2, axis=1)).max() == 1
