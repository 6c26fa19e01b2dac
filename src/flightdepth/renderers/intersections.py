"""Where a ray first meets each unit primitive but the torus (see tori.py), compiled.

Every function takes the ray o + t d in object space (d need not be unit length) and the interval of t that
counts, and returns (t, part): the first t in (t_min, t_max) and which face, or infinity for a miss. They
choose between values, never branch: in a loop over rays the compiler takes several rays at once.
"""

from __future__ import annotations

import math

from flightdepth.renderers.compiling import compiled

CUBE, SPHERE, CONE, TORUS = 0, 1, 2, 3  # scenes.Shape, as constants that the compiler sees
MISS = math.inf
TINY = 1e-300
Ray = tuple[float, float, float, float, float, float]  # origin and direction


@compiled
def hit_cube(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t_min: float, t_max: float
) -> tuple[float, int]:
    """Slabs |x|, |y|, |z| <= 1; part 0..5 is the face -x, +x, -y, +y, -z, +z."""
    # A direction of exactly 0 becomes a tiny one, so that no 0 * infinity appears.
    ix = 1.0 / (dx if dx != 0.0 else TINY)
    iy = 1.0 / (dy if dy != 0.0 else TINY)
    iz = 1.0 / (dz if dz != 0.0 else TINY)
    wx, wy, wz = abs(ix), abs(iy), abs(iz)
    mx, my, mz = -ox * ix, -oy * iy, -oz * iz
    enter = max(max(mx - wx, my - wy), mz - wz)
    leave = min(min(mx + wx, my + wy), mz + wz)
    outside = enter > t_min
    t = enter if outside else leave
    hit = (enter <= leave) & (t_min < t) & (t < t_max)
    front = (dx <= 0.0) if enter == mx - wx else (2 + (dy <= 0.0) if enter == my - wy else 4 + (dz <= 0.0))
    back = (dx > 0.0) if leave == mx + wx else (2 + (dy > 0.0) if leave == my + wy else 4 + (dz > 0.0))
    return (t if hit else MISS), (front if outside else back)


@compiled
def hit_sphere(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t_min: float, t_max: float
) -> tuple[float, int]:
    """x^2 + y^2 + z^2 = 1, by the distance of the ray from the centre, which keeps its digits far away."""
    dd = dx * dx + dy * dy + dz * dz
    closest = -(ox * dx + oy * dy + oz * dz) / dd
    x, y, z = ox + closest * dx, oy + closest * dy, oz + closest * dz
    square = (1.0 - (x * x + y * y + z * z)) / dd
    half = math.sqrt(max(square, 0.0))
    near, far = closest - half, closest + half
    t = far if near <= t_min else near
    hit = (square >= 0.0) & (t_min < t) & (t < t_max)
    return (t if hit else MISS), 0


@compiled
def hit_cone(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t_min: float, t_max: float
) -> tuple[float, int]:
    """Part 0 is the side x^2 + y^2 = ((1 - z) / 2)^2 for -1 <= z <= 1, part 1 the base disc at z = -1."""
    base = (-1.0 - oz) / (dz if dz != 0.0 else TINY)
    x, y = ox + base * dx, oy + base * dy
    on_base = (dz != 0.0) & (t_min < base) & (base < t_max) & (x * x + y * y <= 1.0)
    best = base if on_base else t_max
    a = dx * dx + dy * dy - 0.25 * dz * dz
    b = ox * dx + oy * dy + 0.25 * (1.0 - oz) * dz  # half the linear coefficient
    c = ox * ox + oy * oy - 0.25 * (1.0 - oz) * (1.0 - oz)
    disc = b * b - a * c
    # The two roots without cancellation: q / a and c / q.
    q = -(b + math.copysign(math.sqrt(max(disc, 0.0)), b))
    first, second = c / (q if q != 0.0 else TINY), q / (a if a != 0.0 else TINY)
    on_first = (disc >= 0.0) & (q != 0.0) & (t_min < first) & (first < best) & (abs(oz + first * dz) <= 1.0)
    best = first if on_first else best
    on_second = (
        (disc >= 0.0) & (a != 0.0) & (t_min < second) & (second < best) & (abs(oz + second * dz) <= 1.0)
    )
    best = second if on_second else best
    on_side = on_first | on_second
    return (best if on_base | on_side else MISS), (0 if on_side else 1)
