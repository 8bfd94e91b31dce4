"""Lines drawn on the skin, seen from above the hand: the palm's creases and the veins of its back. (d, r) mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dependencies import needs
from .smooth import unit

with needs("scipy"):
    from scipy.interpolate import CubicSpline
    from scipy.spatial import cKDTree

_STEP = 0.5  # mm between samples of a line
_WAVELENGTHS = (9, 17, 31)  # mm, of the wiggle that keeps a line from looking drawn


@dataclass(frozen=True)
class SkinLine:
    """A line through points in the plane (d, r).

    Attributes:
        points: what it passes through.
        strength: of the mark, in [0, 1].
        width: its standard deviation, mm.
        wiggle: amplitude of its longest wave, mm.
        fade: number of samples over which its ends fade.
        seed: of the wiggle's phases.
    """

    points: tuple[tuple[float, float], ...]
    strength: float
    width: float
    wiggle: float
    fade: int
    seed: int


def _crease(points: tuple[tuple[float, float], ...], strength: float, seed: int) -> SkinLine:
    return SkinLine(points, strength, width=0.85, wiggle=0.5, fade=24, seed=seed)


def _vein(points: tuple[tuple[float, float], ...], width: float, seed: int) -> SkinLine:
    return SkinLine(points, 1.0, width=width, wiggle=1.6, fade=16, seed=seed)


# Life, head, heart and fate line, and the two rings of the wrist; drawn by eye, like the veins.
CREASES = (
    _crease(((66, 33), (64, 24), (56, 15), (42, 8), (26, 6), (12, 9)), 1.0, 28),
    _crease(((67, 32), (66, 20), (60, 4), (50, -12), (42, -24)), 0.8, 28),
    _crease(((88, 14), (82, 10), (77, -2), (73, -16), (69, -30), (68, -38)), 0.9, 35),
    _crease(((20, -1), (40, -3), (60, -4)), 0.25, 28),
    _crease(((2, -26), (0, 0), (3, 26)), 0.5, 21),
    _crease(((-7, -25), (-9, 0), (-6, 25)), 0.3, 21),
)
VEINS = (
    _vein(((97, 15.5), (80, 14), (60, 13), (38, 7), (10, 14), (-32, 20)), 1.4, 1),
    _vein(((93, -5), (72, -6), (52, 0), (38, 7)), 1.1, 2),
    _vein(((84, -23), (64, -19), (44, -14), (16, -17), (-32, -19)), 1.4, 3),
    _vein(((72, -6), (66, -14), (62, -19)), 0.9, 4),
    _vein(((60, 13), (48, 20), (30, 24), (10, 14)), 1.0, 5),
    _vein(((44, -14), (30, -4), (24, 4)), 0.9, 6),
    _vein(((78, -31), (60, -29), (44, -22), (30, -16)), 0.9, 7),
)


def line_mask(line: SkinLine, points: np.ndarray) -> np.ndarray:
    """[N] in [0, strength]: how much of the line lies on points [N, 3] (anatomical frame), whatever their height."""
    samples = _samples(line)
    distance, nearest = cKDTree(samples).query(points[:, [0, 2]])
    to_end = np.minimum(nearest, len(samples) - 1 - nearest)
    return line.strength * np.exp(-0.5 * (distance / line.width) ** 2) * np.clip(to_end / line.fade, 0, 1)


def _samples(line: SkinLine) -> np.ndarray:
    """[P, 2] on a cubic spline through the line's points, moved sideways by a sum of three waves."""
    knots = np.array(line.points, dtype=float)
    lengths = np.r_[0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    places = np.arange(0, lengths[-1], _STEP)
    curve = CubicSpline(lengths, knots)(places)
    phases = np.random.default_rng(line.seed).uniform(0, 6.28, len(_WAVELENGTHS))
    offset = np.zeros_like(places)
    for wavelength, phase in zip(_WAVELENGTHS, phases, strict=True):
        offset += np.sin(2 * np.pi * places / wavelength + phase) * line.wiggle * wavelength / _WAVELENGTHS[-1]
    tangent = unit(np.gradient(curve, axis=0))
    return curve + np.stack([-tangent[:, 1], tangent[:, 0]], 1) * offset[:, None]
