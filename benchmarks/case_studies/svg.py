"""Small line plots as SVG text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 720, 260, 70, 24, 12, 40
COLOURS = ("#222222", "#d95f02", "#1b6ca8", "#5aa02c")
MOST_POINTS = 500
TICKS = 5


def plot(x: Float, series: Mapping[str, Float], x_label: str, y_label: str, dots: Sequence[str] = ()) -> str:
    """Lines (or dots, for those named) over a common x, as an SVG picture."""
    seen = np.concatenate([values[np.isfinite(values)] for values in series.values()])
    low, high = float(seen.min()), float(seen.max())
    pad = 0.05 * (high - low) or 1.0
    low, high = low - pad, high + pad
    left, right = float(x.min()), float(x.max())

    def at_x(value: Float | float) -> Float:
        return np.asarray(LEFT + (np.asarray(value) - left) / (right - left) * (WIDTH - LEFT - RIGHT))

    def at_y(value: Float | float) -> Float:
        return np.asarray(
            HEIGHT - BOTTOM - (np.asarray(value) - low) / (high - low) * (HEIGHT - TOP - BOTTOM)
        )

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="11">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
    ]
    for tick in np.linspace(low + pad, high - pad, TICKS):
        y = float(at_y(tick))
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e5e5e5"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:.3g}</text>')
    under = HEIGHT - BOTTOM + 16
    parts += [
        f'<text x="{float(at_x(tick)):.1f}" y="{under}" text-anchor="middle">{tick:.3g}</text>'
        for tick in np.linspace(left, right, TICKS)
    ]
    keep = np.unique(np.linspace(0, x.size - 1, min(MOST_POINTS, x.size)).round().astype(int))
    for number, (name, values) in enumerate(series.items()):
        colour = COLOURS[number % len(COLOURS)]
        good = keep[np.isfinite(values[keep])]
        points = list(zip(at_x(x[good]), at_y(values[good]), strict=True))
        if name in dots:
            parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="1.3" fill="{colour}"/>' for a, b in points]
        else:
            path = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
            parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
        parts.append(f'<text x="{LEFT + 8 + 170 * number}" y="15" fill="{colour}">{name}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text x="{middle:.0f}" y="{HEIGHT - 6}" text-anchor="middle">{x_label}</text>')
    turned = f'transform="translate(13 {(TOP + HEIGHT - BOTTOM) / 2:.0f}) rotate(-90)"'
    parts.append(f'<text {turned} text-anchor="middle">{y_label}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"
