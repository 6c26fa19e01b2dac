"""Where the rays of a bundle first meet a unit torus (|p|^2 + 1 - r^2)^2 = 4 (x^2 + y^2), minor radius r, axis z.

Measured along the unit direction from the point nearest to the centre, the quartic has no cubic term:
f(u) = u^4 + p u^2 + q u + s, positive outside. Its first root is bracketed by the curvature of f, which
is safe at grazing angles, where closed formulas lose all digits. Each step is taken by all rays side by side,
until none is left.
"""

from __future__ import annotations

import math

from flightdepth.renderers.bundles import STRIDE
from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.view import Records

MOST_STEPS = 60


@compiled
def hit_tori(radius: float, bundles: Records, count: int) -> None:
    """Fill `hit`: the first t in (0, far) where the ray o + t d, object space, meets the torus, or infinity."""
    rays = bundles[0]
    full = (count + STRIDE - 1) // STRIDE * STRIDE
    for i in range(count, full):
        rays.far[i] = -math.inf
    if _lay_out(radius, bundles, full) == 0:
        return
    for stretch in range(3):
        if _search_stretch(stretch, bundles, full) != 0:
            _find_dips(bundles, full)
    _find_roots(bundles, full)


@compiled
def _lay_out(radius: float, bundles: Records, count: int) -> int:
    """The quartic p, q, s of each ray and the stretch low .. high where its root can be; 0 when there is none."""
    rays, some = bundles[0], 0
    for i in range(count):
        ox, oy, oz, dx, dy, dz = rays.ox[i], rays.oy[i], rays.oz[i], rays.dx[i], rays.dy[i], rays.dz[i]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        ex, ey, ez = dx / length, dy / length, dz / length
        shift = -(ox * ex + oy * ey + oz * ez)
        x, y, z = ox + shift * ex, oy + shift * ey, oz + shift * ez
        m = x * x + y * y + z * z
        reach = (1.0 + radius) * (1.0 + radius) - m
        high = math.sqrt(max(reach, 0.0))
        low = -high
        slanted = abs(ez) > 1e-12  # the slab |z| <= r
        steep = ez if slanted else 1.0
        near, far = (-radius - z) / steep, (radius - z) / steep
        low, high = (
            (max(low, min(near, far)) if slanted else low),
            (min(high, max(near, far)) if slanted else high),
        )
        low, high = max(low, 0.0 * length - shift), min(high, rays.far[i] * length - shift)
        can = (reach > 0.0) & (slanted | (abs(z) <= radius)) & (low < high)
        k = m + 1.0 - radius * radius
        p, q, s = 2.0 * k - 4.0 * (ex * ex + ey * ey), -8.0 * (x * ex + y * ey), k * k - 4.0 * (x * x + y * y)
        rays.p[i], rays.q[i], rays.s[i], rays.shift[i], rays.length[i] = p, q, s, shift, length
        rays.low[i], rays.high[i], rays.a[i] = low, high, low
        rays.f_a[i] = ((low * low + p) * low + q) * low + s
        rays.open[i], rays.found[i] = (1 if can else 0), 0
        rays.hit[i] = math.inf
        some |= rays.open[i]
    return some


@compiled
def _search_stretch(stretch: int, bundles: Records, count: int) -> int:
    """Look for a change of sign between the ends of a stretch; 1 when a dip below zero must be looked for.

    f'' = 12 u^2 + 2 p parts the line into a convex, a concave and a convex stretch. A change of sign between
    the ends of a stretch holds one root. Without one, only a convex stretch can dip below zero and return.
    """
    rays, some = bundles[0], 0
    side, last = (-1.0 if stretch == 0 else 1.0), stretch == 2
    for i in range(count):
        p, q, s, a, f_a = rays.p[i], rays.q[i], rays.s[i], rays.a[i], rays.f_a[i]
        bend = math.sqrt(max(-p / 6.0, 0.0)) if p < 0.0 else 0.0
        b = rays.high[i] if last else side * bend
        b = min(max(b, rays.low[i]), rays.high[i])
        f_b = ((b * b + p) * b + q) * b + s
        here = (rays.open[i] != 0) & (b > a)
        crosses = here & ((f_a < 0.0) != (f_b < 0.0))
        dips = here & ((f_a < 0.0) == (f_b < 0.0)) & (f_a > 0.0) & (stretch != 1)
        rays.u0[i] = a if here else rays.u0[i]
        rays.u1[i] = b if here else rays.u1[i]
        rays.f0[i] = f_a if here else rays.f0[i]
        rays.found[i] = 1 if crosses else rays.found[i]
        rays.open[i] = 0 if crosses else rays.open[i]
        rays.dips[i] = 1 if dips else 0
        rays.c0[i], rays.c1[i], rays.f_c0[i], rays.f_c1[i] = a, b, f_a, f_b
        rays.g_c0[i] = (4.0 * a * a + 2.0 * p) * a + q
        rays.g_c1[i] = (4.0 * b * b + 2.0 * p) * b + q
        rays.a[i], rays.f_a[i] = (b if here else a), (f_b if here else f_a)
        some |= rays.dips[i]
    return some


@compiled
def _find_dips(bundles: Records, count: int) -> None:
    """Some u in a convex stretch, positive at both ends, with f(u) < 0, becomes the far end of the root's bracket.

    The tangents at both ends bound f from below; where they meet above zero the search is over.
    """
    rays = bundles[0]
    for _ in range(MOST_STEPS):
        some = 0
        for i in range(count):
            p, q, s = rays.p[i], rays.q[i], rays.s[i]
            c0, c1, f0, f1, g0, g1 = (
                rays.c0[i], rays.c1[i], rays.f_c0[i], rays.f_c1[i], rays.g_c0[i], rays.g_c1[i],
            )  # fmt: skip
            u = (f1 - f0 + g0 * c0 - g1 * c1) / (g0 - g1)
            meets = (rays.dips[i] != 0) & (g0 < 0.0) & (g1 > 0.0) & (f0 + g0 * (u - c0) <= 0.0)
            u = min(max(u, c0), c1)
            f = ((u * u + p) * u + q) * u + s
            g = (4.0 * u * u + 2.0 * p) * u + q
            below = meets & (f < 0.0)
            more = meets & (f >= 0.0) & (c1 - c0 >= 1e-9) & (u != c0) & (u != c1)
            rays.u1[i] = u if below else rays.u1[i]
            rays.found[i] = 1 if below else rays.found[i]
            rays.open[i] = 0 if below else rays.open[i]
            rays.dips[i] = 1 if more else 0
            rays.c0[i], rays.f_c0[i], rays.g_c0[i] = (
                (u if g < 0.0 else c0), (f if g < 0.0 else f0), (g if g < 0.0 else g0),
            )  # fmt: skip
            rays.c1[i], rays.f_c1[i], rays.g_c1[i] = (
                (c1 if g < 0.0 else u), (f1 if g < 0.0 else f), (g1 if g < 0.0 else g),
            )  # fmt: skip
            some |= rays.dips[i]
        if some == 0:
            return


@compiled
def _find_roots(bundles: Records, count: int) -> None:
    """The root of f between two points of different sign: Newton, kept inside by bisection."""
    rays = bundles[0]
    for i in range(count):
        rays.root[i] = 0.5 * (rays.u0[i] + rays.u1[i])
    for _ in range(MOST_STEPS):
        some = 0
        for i in range(count):
            p, q, s, u = rays.p[i], rays.q[i], rays.s[i], rays.root[i]
            f = ((u * u + p) * u + q) * u + s
            beyond = (f < 0.0) == (rays.f0[i] < 0.0)
            low, high = (u if beyond else rays.u0[i]), (rays.u1[i] if beyond else u)
            slope = (4.0 * u * u + 2.0 * p) * u + q
            newton = u - f / slope if slope != 0.0 else math.inf
            ends = abs(newton - u) < 1e-13
            bisected = newton if (low < newton) & (newton < high) else 0.5 * (low + high)
            u = min(max(newton, low), high) if ends else bisected
            live = rays.found[i] != 0
            rays.u0[i], rays.u1[i], rays.root[i] = low, high, u
            t = (u + rays.shift[i]) / rays.length[i]
            rays.hit[i] = t if live else rays.hit[i]
            rays.found[i] = 0 if ends else rays.found[i]
            some |= rays.found[i]
        if some == 0:
            return
