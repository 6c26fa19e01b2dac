import numpy as np
import plain_hits
import pytest
from built_scenes import SHAPES
from bundled import hit, tori_hits

from flightdepth.scenes.scene import Shape


def rays(seed: int, count: int):
    """Rays from around a unit primitive to somewhere near it, directions of any length."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        start = rng.standard_normal(3)
        start *= rng.uniform(2, 30) / np.linalg.norm(start)
        yield start, (rng.uniform(-1.3, 1.3, 3) - start) * rng.uniform(0.01, 2)


@pytest.mark.parametrize("shape", list(Shape))
def test_first_hit_is_the_schoolbook_formula_s(shape):
    ours = np.array([hit(shape, SHAPES[shape], o, d)[0] for o, d in rays(1, 400)])
    plain = np.array([plain_hits.hit_unit(shape, SHAPES[shape], o, d) for o, d in rays(1, 400)])
    assert (np.isfinite(plain)).sum() > 80
    np.testing.assert_array_equal(np.isfinite(ours), np.isfinite(plain))
    np.testing.assert_allclose(ours, plain, rtol=1e-7)


@pytest.mark.parametrize("shape", list(Shape))
def test_far_end_of_the_interval_hides_the_hit(shape):
    o, d = next((o, d) for o, d in rays(2, 99) if hit(shape, SHAPES[shape], o, d)[0] < np.inf)
    t, _ = hit(shape, SHAPES[shape], o, d)
    assert hit(shape, SHAPES[shape], o, d, t_max=t * (1 - 1e-9))[0] == np.inf
    assert hit(shape, SHAPES[shape], o, d, t_max=t * (1 + 1e-9))[0] == t


@pytest.mark.parametrize("shape", [Shape.CUBE, Shape.SPHERE, Shape.CONE])
def test_a_ray_from_inside_meets_the_far_wall(shape):
    o = np.array([0.01, 0.02, -0.3])
    for _, d in rays(3, 50):
        t, _ = hit(shape, 0.0, o, d)
        assert t == pytest.approx(plain_hits.hit_unit(shape, 0.0, o, d), rel=1e-9)


@pytest.mark.parametrize("part", range(6))
def test_cube_names_the_face(part):
    axis, side = part // 2, 2.0 * (part % 2) - 1
    o = np.array([0.1, 0.2, 0.3])
    o[axis] = 5 * side
    d = np.zeros(3)
    d[axis] = -side
    assert hit(Shape.CUBE, 0.0, o, d) == (4.0, part)


def test_cone_has_a_base():
    assert hit(Shape.CONE, 0.0, (0.3, 0.2, -4.0), (0.0, 0.0, 1.0)) == (3.0, 1)


def test_cone_s_side_by_hand():
    assert hit(Shape.CONE, 0.0, (-5.0, 0.0, 0.0), (1.0, 0.0, 0.0)) == (4.5, 0)


def test_cone_s_other_nappe_is_no_part_of_it():
    assert hit(Shape.CONE, 0.0, (-5.0, 0.0, 1.5), (1.0, 0.0, 0.0))[0] == np.inf


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.5, 0.2), (-0.69, 0.0)])
def test_torus_lets_rays_through_its_hole(offset):
    assert hit(Shape.TORUS, 0.3, (*offset, -4.0), (0.0, 0.0, 1.0))[0] == np.inf


def test_torus_catches_a_ray_beside_its_hole():
    assert hit(Shape.TORUS, 0.3, (-0.71, 0.0, -4.0), (0.0, 0.0, 1.0))[0] < np.inf


def test_slanted_rays_pass_the_hole_as_distances_along_them_say():
    for start, _ in rays(4, 120):
        aim = np.random.default_rng(int(abs(start[0]) * 1e6)).uniform(-0.6, 0.6, 3) * [1, 1, 0]
        d = aim - start
        along = np.linspace(0, 2, 40001)[:, None]
        nearest = plain_hits.torus_value(start + along * d, 0.3).min()
        if abs(nearest) > 1e-3:
            assert (hit(Shape.TORUS, 0.3, start, d)[0] < np.inf) == (nearest < 0)


def grazing(radius: float, depth: float, seed: int):
    """A ray along a meridian's tangent whose middle lies `depth` below the tube's surface, and its half chord."""
    rng = np.random.default_rng(seed)
    around, meridian = rng.uniform(0, 2 * np.pi), rng.uniform(-1.2, 1.2)  # outer side: nothing hides it
    out = np.array([np.cos(around), np.sin(around), 0.0])
    normal = out * np.cos(meridian) + np.array([0, 0, np.sin(meridian)])
    tangent = -out * np.sin(meridian) + np.array([0, 0, np.cos(meridian)])
    point = out + normal * (radius - depth)
    return point - 7 * tangent, tangent, np.sqrt(radius**2 - (radius - depth) ** 2) if depth > 0 else None


@pytest.mark.parametrize("radius", [0.15, 0.3, 0.45])
@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9])
def test_torus_is_met_by_rays_just_below_its_tangent(radius, depth):
    for seed in range(60):
        o, d, half_chord = grazing(radius, depth, seed)
        t, _ = hit(Shape.TORUS, radius, o, d)
        # In the meridian's plane the tube is a circle: the chord begins half a chord before the middle.
        assert t == pytest.approx(7 - half_chord, abs=1e-7 + 1e-13 / half_chord)


@pytest.mark.parametrize("radius", [0.15, 0.3, 0.45])
@pytest.mark.parametrize("depth", [-1e-3, -1e-6, -1e-9])
def test_torus_is_missed_by_rays_just_above_its_tangent(radius, depth):
    for seed in range(60):
        o, d, _ = grazing(radius, depth, seed)
        assert hit(Shape.TORUS, radius, o, d)[0] == np.inf


def test_torus_hits_lie_on_it_and_nothing_of_it_lies_before_them():
    for o, d in rays(5, 300):
        t, _ = hit(Shape.TORUS, 0.2, o, d)
        along = np.linspace(0, min(t, 4.0) * (1 - 1e-9), 5001)[:, None]
        assert plain_hits.torus_value(o + along * d, 0.2).min() > -1e-9
        if t < np.inf:
            assert abs(plain_hits.torus_value(o + t * d, 0.2)) < 1e-9


def test_a_ray_meets_a_torus_alike_alone_and_beside_others():
    o, d = map(np.array, zip(*rays(6, 64), strict=True))
    together = tori_hits(0.3, o, d)
    assert 10 < np.isfinite(together).sum() < 54
    alone = [tori_hits(0.3, [a], [b])[0] for a, b in zip(o, d, strict=True)]
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(tori_hits(0.3, o[::-1], d[::-1]), together[::-1])
