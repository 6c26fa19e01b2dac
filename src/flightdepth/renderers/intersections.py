"""Where a ray first meets each unit primitive, compiled.

Every function takes the ray o + t d in object space (d need not be unit length) and the interval of t that
counts, and returns (t, part): the first t in (t_min, t_max) and which face, or (infinity, 0) for a miss.
"""

from __future__ import annotations

import math

from flightdepth.renderers.compiling import compiled

CUBE, SPHERE, CONE, TORUS = 0, 1, 2, 3  # scenes.Shape, as constants that the compiler sees
MISS = math.inf
TINY = 1e-300


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
    if enter > leave:
        return MISS, 0
    if t_min < enter < t_max:
        if enter == mx - wx:
            return enter, (0 if dx > 0.0 else 1)
        if enter == my - wy:
            return enter, (2 if dy > 0.0 else 3)
        return enter, (4 if dz > 0.0 else 5)
    if enter <= t_min < leave < t_max:
        if leave == mx + wx:
            return leave, (1 if dx > 0.0 else 0)
        if leave == my + wy:
            return leave, (3 if dy > 0.0 else 2)
        return leave, (5 if dz > 0.0 else 4)
    return MISS, 0


@compiled
def hit_sphere(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t_min: float, t_max: float
) -> tuple[float, int]:
    """x^2 + y^2 + z^2 = 1, by the distance of the ray from the centre, which keeps its digits far away."""
    dd = dx * dx + dy * dy + dz * dz
    closest = -(ox * dx + oy * dy + oz * dz) / dd
    x, y, z = ox + closest * dx, oy + closest * dy, oz + closest * dz
    square = (1.0 - (x * x + y * y + z * z)) / dd
    if square < 0.0:
        return MISS, 0
    half = math.sqrt(square)
    t = closest - half
    if t <= t_min:
        t = closest + half
    if t_min < t < t_max:
        return t, 0
    return MISS, 0


@compiled
def hit_cone(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t_min: float, t_max: float
) -> tuple[float, int]:
    """Part 0 is the side x^2 + y^2 = ((1 - z) / 2)^2 for -1 <= z <= 1, part 1 the base disc at z = -1."""
    best, part = t_max, -1
    if dz != 0.0:
        t = (-1.0 - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        if t_min < t < best and x * x + y * y <= 1.0:
            best, part = t, 1
    a = dx * dx + dy * dy - 0.25 * dz * dz
    b = ox * dx + oy * dy + 0.25 * (1.0 - oz) * dz  # half the linear coefficient
    c = ox * ox + oy * oy - 0.25 * (1.0 - oz) * (1.0 - oz)
    disc = b * b - a * c
    if disc >= 0.0:
        # The two roots without cancellation: q / a and c / q.
        q = -(b + math.copysign(math.sqrt(disc), b))
        first = c / q if q != 0.0 else math.inf
        second = q / a if a != 0.0 else math.inf
        for t in (first, second):
            if t_min < t < best and abs(oz + t * dz) <= 1.0:
                best, part = t, 0
    if part < 0:
        return MISS, 0
    return best, part


@compiled
def hit_torus(
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    radius: float,
    t_min: float,
    t_max: float,
) -> tuple[float, int]:
    """(|p|^2 + 1 - r^2)^2 = 4 (x^2 + y^2), minor radius r, axis z.

    Measured along the unit direction from the point nearest to the centre, the quartic has no cubic term:
    f(u) = u^4 + p u^2 + q u + s, positive outside. Its first root is bracketed by the curvature of f, which
    is safe at grazing angles, where closed formulas lose all digits.
    """
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    ex, ey, ez = dx / length, dy / length, dz / length
    shift = -(ox * ex + oy * ey + oz * ez)
    x, y, z = ox + shift * ex, oy + shift * ey, oz + shift * ez
    m = x * x + y * y + z * z
    reach = (1.0 + radius) * (1.0 + radius) - m
    if reach <= 0.0:
        return MISS, 0
    high = math.sqrt(reach)
    low = -high
    if abs(ez) > 1e-12:  # the slab |z| <= r
        near, far = (-radius - z) / ez, (radius - z) / ez
        low, high = max(low, min(near, far)), min(high, max(near, far))
    elif abs(z) > radius:
        return MISS, 0
    low, high = max(low, t_min * length - shift), min(high, t_max * length - shift)
    if low >= high:
        return MISS, 0
    k = m + 1.0 - radius * radius
    p = 2.0 * k - 4.0 * (ex * ex + ey * ey)
    q = -8.0 * (x * ex + y * ey)
    s = k * k - 4.0 * (x * x + y * y)
    u = _first_root(p, q, s, low, high)
    if u == math.inf:
        return MISS, 0
    return (u + shift) / length, 0


@compiled
def _first_root(p: float, q: float, s: float, low: float, high: float) -> float:
    """Smallest root of f = u^4 + p u^2 + q u + s in [low, high] where f starts positive, or infinity.

    f'' = 12 u^2 + 2 p parts the line into a convex, a concave and a convex stretch. A change of sign between
    the ends of a stretch holds one root. Without one, only a convex stretch can dip below zero and return.
    """
    bend = math.sqrt(-p / 6.0) if p < 0.0 else 0.0
    a, f_a = low, ((low * low + p) * low + q) * low + s
    for stretch in range(3):
        b = -bend if stretch == 0 else (bend if stretch == 1 else high)
        b = min(max(b, low), high)
        if b <= a:
            continue
        f_b = ((b * b + p) * b + q) * b + s
        if (f_a < 0.0) != (f_b < 0.0):
            return _root_between(p, q, s, a, b, f_a)
        if stretch != 1 and f_a > 0.0:
            dip = _point_below_zero(p, q, s, a, b, f_a, f_b)
            if dip < math.inf:
                return _root_between(p, q, s, a, dip, f_a)
        a, f_a = b, f_b
    return math.inf


@compiled
def _point_below_zero(
    p: float, q: float, s: float, low: float, high: float, f_low: float, f_high: float
) -> float:
    """Some u in a convex stretch, positive at both ends, with f(u) < 0; infinity if there is none.

    The tangents at both ends bound f from below; where they meet above zero the search is over.
    """
    g_low = (4.0 * low * low + 2.0 * p) * low + q
    g_high = (4.0 * high * high + 2.0 * p) * high + q
    for _ in range(60):
        if g_low >= 0.0 or g_high <= 0.0:
            return math.inf
        u = (f_high - f_low + g_low * low - g_high * high) / (g_low - g_high)
        if f_low + g_low * (u - low) > 0.0:
            return math.inf
        u = min(max(u, low), high)
        f = ((u * u + p) * u + q) * u + s
        if f < 0.0:
            return u
        if high - low < 1e-9 or u == low or u == high:
            return math.inf
        g = (4.0 * u * u + 2.0 * p) * u + q
        if g < 0.0:
            low, f_low, g_low = u, f, g
        else:
            high, f_high, g_high = u, f, g
    return math.inf


@compiled
def _root_between(p: float, q: float, s: float, low: float, high: float, f_low: float) -> float:
    """The root of f between two points of different sign: Newton, kept inside by bisection."""
    u = 0.5 * (low + high)
    for _ in range(60):
        f = ((u * u + p) * u + q) * u + s
        if (f < 0.0) == (f_low < 0.0):
            low = u
        else:
            high = u
        slope = (4.0 * u * u + 2.0 * p) * u + q
        step = u - f / slope if slope != 0.0 else math.inf
        if abs(step - u) < 1e-13:
            return min(max(step, low), high)
        u = step if low < step < high else 0.5 * (low + high)
    return u


@compiled
def hit_shape(
    shape: int,
    radius: float,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    t_min: float,
    t_max: float,
) -> tuple[float, int]:
    """Any primitive, chosen by `shape`."""
    if shape == CUBE:
        return hit_cube(ox, oy, oz, dx, dy, dz, t_min, t_max)
    if shape == SPHERE:
        return hit_sphere(ox, oy, oz, dx, dy, dz, t_min, t_max)
    if shape == CONE:
        return hit_cone(ox, oy, oz, dx, dy, dz, t_min, t_max)
    return hit_torus(ox, oy, oz, dx, dy, dz, radius, t_min, t_max)
