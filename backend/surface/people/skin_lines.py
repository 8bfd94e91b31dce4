"""Creases of the palm and veins as curves in the plane of the hand, each drawn anew from a seed, as images.

The plane is (d, r), mm: d from the wrist towards the fingers, r towards the thumb. Where the lines run is anatomy; how
they bend, branch and end is a person's own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

_WRIST_MM = 95.0  # along the template's X
_WAVES_MM = (7.0, 15.0, 33.0)
Points = Sequence[tuple[int, int]]


class PlaneImage(NamedTuple):
    """An image over a part of the plane.

    Attributes:
        values: [H, W] in [0, 1], rows by d.
        start_mm: [2] d and r of its first corner.
        texel_mm: side of its texels.
    """

    values: np.ndarray
    start_mm: tuple[float, float]
    texel_mm: float

    def at(self, points_mm: np.ndarray) -> np.ndarray:
        """Sample it, bilinear, at points [T, 3] of the template, mm; 0 beside it."""
        at = (plane(points_mm) - np.array(self.start_mm, np.float32)) / np.float32(self.texel_mm)
        first = np.floor(at).astype(np.int32)
        row, column = first.T
        down, right = (at - first).T
        is_inside = ((first >= 0) & (first < np.array(self.values.shape) - 1)).all(1)
        row, column = np.where(is_inside, row, 0), np.where(is_inside, column, 0)
        image = self.values
        upper = image[row, column] * (1 - right) + image[row, column + 1] * right
        lower = image[row + 1, column] * (1 - right) + image[row + 1, column + 1] * right
        return np.where(is_inside, upper * (1 - down) + lower * down, 0).astype(np.float32)


class LineStroke(NamedTuple):
    """A curve as samples.

    Attributes:
        points: [P, 2] in the plane, mm.
        strength, width_mm: [P] of the line there.
    """

    points: np.ndarray
    strength: np.ndarray
    width_mm: np.ndarray


# Where creases run, how deep they are, and how wide.
_PALM: tuple[tuple[Points, float, float], ...] = (
    (((67, 33), (65, 24), (57, 15), (43, 8), (27, 5), (12, 8)), 1.0, 0.55),
    (((68, 33), (66, 20), (60, 4), (51, -12), (43, -25)), 0.9, 0.5),
    (((89, 15), (81, 9), (75, -2), (72, -16), (69, -29), (68, -38)), 0.95, 0.5),
    (((18, -1), (40, -3), (62, -4)), 0.3, 0.35),
    (((2, -26), (0, 0), (3, 26)), 0.7, 0.5),
    (((-7, -25), (-9, 0), (-6, 25)), 0.5, 0.45),
    (((-19, -23), (-21, 2), (-18, 24)), 0.25, 0.4),
)
_TOGETHER, _APART = 1.9, 2.0  # of all of a curve, and of its knots before neighbours are averaged
_DEEP_FROM = 0.6  # of a crease that has branches
_VEINS: tuple[tuple[Points, float], ...] = (
    (((97, 15), (80, 14), (60, 13), (38, 7), (10, 14), (-32, 20), (-96, 24), (-172, 25)), 1.5),
    (((93, -5), (72, -6), (52, 0), (38, 7)), 1.1),
    (((84, -23), (64, -19), (44, -14), (16, -17), (-32, -19), (-116, -17), (-172, -15)), 1.5),
    (((72, -6), (66, -14), (62, -19)), 0.9),
    (((60, 13), (48, 20), (30, 24), (10, 14)), 1.0),
    (((44, -14), (30, -4), (24, 4)), 0.9),
    (((78, -31), (60, -29), (44, -22), (30, -16)), 0.9),
    (((-56, 22), (-82, 12), (-104, -4), (-116, -17)), 1.1),
    (((-24, -18), (-48, -4), (-82, 12)), 0.9),
)
_ALWAYS = 3  # veins that everybody has
_CHANCE = 0.65  # of each other one


def plane(points_mm: np.ndarray) -> np.ndarray:
    """Return d and r [T, 2] of points [T, 3] of the template, mm."""
    return np.stack([_WRIST_MM - points_mm[:, 0], points_mm[:, 2]], 1).astype(np.float32)


def palm_creases(random: np.random.Generator, minor: int) -> PlaneImage:
    """Draw the creases of a palm and wrist: long curves with branches, and so many short lines between them."""
    strokes = []
    for points, strength, width_mm in _PALM:
        main = _stroke(_moved(points, random, 2.8), random, strength, width_mm, wiggle_mm=0.5)
        strokes.append(main)
        if strength > _DEEP_FROM:
            strokes += [_branch(main, random) for _ in range(random.integers(4, 9))]
    strokes += [_minor(random) for _ in range(minor)]
    return _image(strokes, (-32.0, -48.0), (108.0, 58.0), 0.2)


def veins(random: np.random.Generator) -> PlaneImage:
    """Draw the veins of a back and forearm: trunks that everybody has, and connections of one's own."""
    strokes = []
    for index, (points, width_mm) in enumerate(_VEINS):
        if index < _ALWAYS or random.random() < _CHANCE:
            strokes.append(_stroke(_moved(points, random, 3.5), random, 1.0, width_mm, wiggle_mm=1.6, fade_mm=12.0))
    trunks = [stroke for stroke in strokes if len(stroke.points) > 1]
    for _ in range(random.integers(4, 9)):
        start = trunks[random.integers(len(trunks))]
        strokes.append(_branch(start, random, (12.0, 32.0), 0.8))
    return _image(strokes, (-178.0, -48.0), (108.0, 58.0), 0.5)


def _moved(points: Points, random: np.random.Generator, deviation_mm: float) -> np.ndarray:
    """Move a curve's knots, neighbours alike: one that moves alone would be a kink."""
    apart = random.normal(0, _APART * deviation_mm, (len(points), 2))
    for _ in range(2):
        padded = np.pad(apart, ((1, 1), (0, 0)), mode="edge")
        apart = 0.25 * padded[:-2] + 0.5 * apart + 0.25 * padded[2:]
    return np.array(points) + random.normal(0, _TOGETHER * deviation_mm, 2) + apart


def _stroke(
    knots: np.ndarray,
    random: np.random.Generator,
    strength: float,
    width_mm: float,
    wiggle_mm: float,
    fade_mm: float = 9.0,
) -> LineStroke:
    """Draw a curve through knots [K, 2], that wanders, swells and thins, and ends in points; it has no gaps."""
    lengths = np.r_[0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    at = np.arange(0, lengths[-1], 0.15 if width_mm < 0.8 else 0.4)
    curve = _through(knots, lengths, at)
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True).clip(1e-6)
    aside, swell = np.zeros_like(at), np.zeros_like(at)
    for wave_mm in _WAVES_MM:
        one, other = np.sin(2 * np.pi * at / wave_mm + random.uniform(0, 6.28, (2, 1)))
        aside, swell = aside + wiggle_mm * wave_mm / _WAVES_MM[-1] * one, swell + 0.1 * other
    ends = np.clip(np.minimum(at, lengths[-1] - at) / fade_mm, 0, 1)
    points = curve + aside[:, None] * np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    return LineStroke(points, strength * np.sqrt(ends) * (0.85 + swell), width_mm * (0.45 + 0.55 * ends))


def _through(knots: np.ndarray, lengths: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate by Catmull and Rom's spline, with the knots' own spacing."""
    slope = np.gradient(knots, lengths, axis=0)
    index = np.searchsorted(lengths, at, "right").clip(1, len(knots) - 1) - 1
    span = (lengths[index + 1] - lengths[index])[:, None]
    t = (at - lengths[index])[:, None] / span
    start, end = knots[index], knots[index + 1]
    held = (2 * t**3 - 3 * t**2 + 1) * start + (3 * t**2 - 2 * t**3) * end
    return held + span * ((t**3 - 2 * t**2 + t) * slope[index] + (t**3 - t**2) * slope[index + 1])


def _branch(
    main: LineStroke,
    random: np.random.Generator,
    length_mm: tuple[float, float] = (6.0, 20.0),
    strength: float = 0.5,
) -> LineStroke:
    """Let a finer line leave a curve at a small angle."""
    index = int(random.integers(len(main.points) // 8, max(len(main.points) - 2, len(main.points) // 8 + 1)))
    ahead = main.points[min(index + 2, len(main.points) - 1)] - main.points[index - 1]
    turn = random.choice([-1, 1]) * random.uniform(0.25, 0.75)
    way = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ ahead
    way /= max(float(np.linalg.norm(way)), 1e-6)
    length = random.uniform(*length_mm)
    bend = random.normal(0, 0.12 * length) * np.array([-way[1], way[0]])
    knots = main.points[index] + np.stack([np.zeros(2), 0.5 * length * way + bend, length * way])
    peak = float(main.strength[index])
    line = _stroke(knots, random, peak * strength, 0.7 * float(main.width_mm[index]), 0.3, fade_mm=0.6 * length)
    count = len(line.points)
    return line._replace(strength=peak * strength * (1 - np.linspace(0, 1, count) ** 2))  # it begins on the curve


def _minor(random: np.random.Generator) -> LineStroke:
    """Draw a short fine line somewhere on the palm; more run along the hand and across it than between."""
    start = np.array([random.uniform(4, 96), random.uniform(-40, 34)])
    angle = random.choice([0.0, 0.5 * np.pi, 0.25 * np.pi]) + random.normal(0, 0.35)
    length = random.gamma(3.0, 4.0) + 3
    way = length * np.array([np.cos(angle), np.sin(angle)])
    bend = random.normal(0, 0.06 * length) * np.array([-np.sin(angle), np.cos(angle)])
    knots = start + np.stack([np.zeros(2), 0.5 * way + bend, way])
    return _stroke(knots, random, random.uniform(0.06, 0.28), random.uniform(0.18, 0.3), 0.3, fade_mm=0.4 * length)


def _image(
    strokes: Iterable[LineStroke], start_mm: tuple[float, float], end_mm: tuple[float, float], texel_mm: float
) -> PlaneImage:
    """Draw the strokes; where two cross, the stronger one shows."""
    shape = tuple(round((end - start) / texel_mm) for start, end in zip(start_mm, end_mm, strict=True))
    values = np.zeros(shape, np.float32)
    for stroke in strokes:
        dots = (stroke.points - start_mm) / texel_mm
        for (row, column), strength, width in zip(dots, stroke.strength, stroke.width_mm / texel_mm, strict=True):
            reach = int(3 * width) + 1
            top, left = max(int(row) - reach, 0), max(int(column) - reach, 0)
            window = values[top : int(row) + reach + 1, left : int(column) + reach + 1]
            if window.size:
                down = np.arange(top, top + window.shape[0]) - row
                right = np.arange(left, left + window.shape[1]) - column
                dot = np.exp(-0.5 * (down[:, None] ** 2 + right**2) / width**2)
                np.maximum(window, strength * dot, out=window)
    return PlaneImage(values, start_mm, texel_mm)
