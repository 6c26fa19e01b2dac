"""The sparsification curve of an error bar, drawn as SVG: mean error as the pixels of the largest bars are left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

WIDTH, HEIGHT = 428, 260
LEFT, RIGHT, TOP, BOTTOM = 48, 20, 14, 40  # margins, px
TICKS = 5
CURVES = (("by_sigma", "by sigma", "#c2410c", ""), ("by_error", "by the true error", "#1d4ed8", "5 4"))


def curve_svg(spread: Mapping[str, Any]) -> str:
    """Both curves of `spread_summary`'s `sparsification`, as shares of the mean error of all pixels."""
    curve = spread["sparsification"]
    shares = curve["left_out"]
    parts = [_axes()]
    for number, (key, label, colour, dashes) in enumerate(CURVES):
        y = TOP + 16 + 18 * number
        x = WIDTH - RIGHT - 150
        parts += [
            _line(_points(shares, curve[key]), colour, dashes),
            _line(((x, y), (x + 24, y)), colour, dashes),
            _text(x + 30, y + 4, label),
        ]
    style = "font-family:sans-serif;font-size:12px"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" style="{style}">'
    return "\n".join([head, f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>', *parts, "</svg>\n"])


def _axes() -> str:
    marks = []
    for tick in range(TICKS + 1):
        share = tick / TICKS
        x, y = _place(share, share)
        marks += [
            f'<path d="M{LEFT} {y:g}H{WIDTH - RIGHT}" stroke="#ddd"/>',
            _text(x, HEIGHT - BOTTOM + 16, f"{share:.0%}", "middle"),
            _text(LEFT - 6, y + 4, f"{share:g}", "end"),
        ]
    words = [
        _text(
            (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, "pixels left out, largest sigma or error first", "middle"
        ),
        f'<g transform="translate(12 {(TOP + HEIGHT - BOTTOM) / 2:g}) rotate(-90)">'
        + _text(0, 0, "mean error of the rest", "middle")
        + "</g>",
    ]
    return "\n".join([*marks, *words])


def _place(share: float, error: float) -> tuple[float, float]:
    x = LEFT + share * (WIDTH - LEFT - RIGHT)
    return round(x, 1), round(HEIGHT - BOTTOM - error * (HEIGHT - TOP - BOTTOM), 1)


def _points(shares: Sequence[float], errors: Sequence[float]) -> list[tuple[float, float]]:
    return [_place(*each) for each in zip(shares, errors, strict=True)]


def _line(points: Sequence[tuple[float, float]], colour: str, dashes: str) -> str:
    where = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{where}" fill="none" stroke="{colour}" stroke-width="2" stroke-dasharray="{dashes}"/>'


def _text(x: float, y: float, words: str, anchor: str = "start") -> str:
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" fill="#333">{words}</text>'
