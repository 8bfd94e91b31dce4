"""Cost curves as one picture, drawn with Pillow."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10
from pathlib import Path
from typing import NamedTuple

from PIL import Image, ImageDraw, ImageFont

from ..records.errors import LiveHandError

_PANEL_PX = (440, 360)
_MARGIN_PX = (70, 48, 24, 56)  # left, top, right, bottom
_FONT_PX = 15
_TICKS = 4
_STEPS = (1, 2, 4, 5, 8, 10)
_GROUND, _INK, _GRID = (255, 255, 255), (40, 40, 40), (222, 222, 222)
_COLOURS = ((200, 80, 40), (40, 100, 180), (60, 140, 80), (140, 80, 160))


class Curve(NamedTuple):
    """One line: its name, points (x, ms) and spreads (10th, 90th percentile, ms)."""

    name: str
    points: list[tuple[float, float]]
    spreads: list[tuple[float, float]]


class Panel(NamedTuple):
    """One set of axes, both from zero."""

    title: str
    x_label: str
    curves: list[Curve]


def save_plot(panels: Sequence[Panel], path: Path) -> None:
    """Draw the panels side by side.

    Raises:
        LiveHandError: the file cannot be written.
    """
    width, height = _PANEL_PX
    image = Image.new("RGB", (width * len(panels), height), _GROUND)
    draw = ImageDraw.Draw(image)
    for number, panel in enumerate(panels):
        _draw_panel(draw, panel, number * width)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        image.save(path)
    except (OSError, ValueError) as error:
        raise LiveHandError(f"the plot {path} could not be written ({error}); choose another .png") from error


def round_up(value: float) -> float:
    """The next 1, 2, 4, 5 or 8 times a power of ten: an axis' end whose quarters read well; of values above 0."""
    power = 10.0 ** floor(log10(value))
    return next(step * power for step in _STEPS if step * power >= value * (1 - 1e-9))


def _draw_panel(draw: ImageDraw.ImageDraw, panel: Panel, left_px: int) -> None:
    x_end = round_up(max(x for curve in panel.curves for x, _ in curve.points))
    y_end = round_up(max(high for curve in panel.curves for _, high in curve.spreads))
    _draw_axes(draw, panel, left_px, x_end, y_end)
    for number, curve in enumerate(panel.curves):
        colour = _COLOURS[number % len(_COLOURS)]
        places = [_place(left_px, x / x_end, y / y_end) for x, y in curve.points]
        draw.line(places, fill=colour, width=3)
        for (x, y), (px, _), (low, high) in zip(places, curve.points, curve.spreads, strict=True):
            draw.line([_place(left_px, px / x_end, end / y_end) for end in (low, high)], fill=colour, width=1)
            draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=colour)
        legend_y = _MARGIN_PX[1] + 6 + number * (_FONT_PX + 4)
        draw.text((left_px + _MARGIN_PX[0] + 10, legend_y), curve.name, fill=colour, font=_font())


def _draw_axes(draw: ImageDraw.ImageDraw, panel: Panel, left_px: int, x_end: float, y_end: float) -> None:
    for tick in range(_TICKS + 1):
        share = tick / _TICKS
        (x0, y), (x1, _) = (_place(left_px, end, share) for end in (0.0, 1.0))
        draw.line((x0, y, x1, y), fill=_GRID)
        draw.text((x0 - 8, y), f"{share * y_end:g}", fill=_INK, font=_font(), anchor="rm")
        x, bottom = _place(left_px, share, 0.0)
        draw.line((x, bottom, x, bottom + 4), fill=_INK)
        draw.text((x, bottom + 8), f"{share * x_end:g}", fill=_INK, font=_font(), anchor="ma")
    middle = left_px + _PANEL_PX[0] / 2
    draw.text((middle, 14), panel.title, fill=_INK, font=_font(), anchor="ma")
    draw.text((middle, _PANEL_PX[1] - 22), panel.x_label, fill=_INK, font=_font(), anchor="ma")


def _place(left_px: int, x: float, y: float) -> tuple[float, float]:
    """A point of the axes' unit square in the picture, px."""
    left, top, right, bottom = _MARGIN_PX
    width, height = _PANEL_PX[0] - left - right, _PANEL_PX[1] - top - bottom
    return left_px + left + x * width, top + (1 - y) * height


def _font() -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(_FONT_PX)
