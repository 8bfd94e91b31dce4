"""Curves as one SVG drawing, for the page: how each row falls as the mesh fits less."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

_SIZE_PX, _MARGIN_PX = (560.0, 300.0), 48.0
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # Okabe and Ito's


def svg_curves(series: Mapping[str, Sequence[tuple[float, float]]], x_label: str, y_label: str) -> str:
    """Draw a line with points for each name; both axes span all points. Empty if no line has two points."""
    drawn = {name: sorted(points) for name, points in series.items() if len(points) > 1}
    if not drawn:
        return ""
    xs, ys = zip(*(point for points in drawn.values() for point in points), strict=True)
    spans = [(min(values), max(max(values), min(values) + 1e-9)) for values in (xs, ys)]
    width, height = _SIZE_PX
    whole = f"{width + 220:.0f}"
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {whole} {height:.0f}" width="{whole}">']
    left, right, top, bottom = _MARGIN_PX, width - _MARGIN_PX, _MARGIN_PX / 2, height - _MARGIN_PX
    parts.append(f'<path d="M{left} {top}V{bottom}H{right}" fill="none" stroke="#999"/>')
    for index, (name, points) in enumerate(drawn.items()):
        colour = _COLOURS[index % len(_COLOURS)]
        places = [_place(point, spans, (left, right, top, bottom)) for point in points]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in places]
        parts.append(_text(width - 20, 30.0 + 20 * index, name, colour))
    (low_x, high_x), (low_y, high_y) = spans
    parts += [_text(left, bottom + 18, f"{low_x:g}"), _text(right - 10, bottom + 18, f"{high_x:g}")]
    parts += [_text(4.0, bottom, f"{low_y:.1f}"), _text(4.0, top + 10, f"{high_y:.1f}")]
    parts += [_text((left + right) / 2 - 60, bottom + 36, x_label), _text(left + 6, top + 10, y_label), "</svg>"]
    return "".join(parts)


def _place(
    point: tuple[float, float], spans: Sequence[tuple[float, float]], box: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Place a point in the drawing's pixels."""
    left, right, top, bottom = box
    x, y = ((value - low) / (high - low) for value, (low, high) in zip(point, spans, strict=True))
    return left + x * (right - left), bottom - y * (bottom - top)


def _text(x: float, y: float, text: str, colour: str = "#333") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" font-size="12" fill="{colour}">{html.escape(text)}</text>'
