"""Lines on the skin in the plane (d, r), mm: the creases of the palm and wrist, and veins of hand and forearm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dependencies import needs
from .smooth import unit

with needs("scipy"):
    from scipy.interpolate import CubicSpline
    from scipy.spatial import KDTree

_STEP = 0.5  # mm between samples of a line
_WAVELENGTHS = (9, 17, 31)  # mm, of the waves that make a line look natural


@dataclass(frozen=True)
class SkinLine:
    """A line through points in the plane (d, r).

    Attributes:
        points: that it passes through.
        strength: of the mask, in [0, 1].
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
    return SkinLine(points, 1.0, width=width, wiggle=1.0, fade=16, seed=seed)


# The large veins of the back, beyond the wrist.
_CEPHALIC = ((-56.0, 22.0), (-96.0, 24.0), (-134.0, 20.0), (-172.0, 25.0))
_BASILIC = ((-72.0, -15.0), (-116.0, -17.0), (-146.0, -12.0), (-172.0, -15.0))
# Life, head, heart and fate line, and the three creases of the wrist; drawn by eye, like the veins.
CREASES = (
    _crease(((66.0, 33.0), (64.0, 24.0), (56.0, 15.0), (42.0, 8.0), (26.0, 6.0), (12.0, 9.0)), 1.0, 28),
    _crease(((67.0, 32.0), (66.0, 20.0), (60.0, 4.0), (50.0, -12.0), (42.0, -24.0)), 0.8, 28),
    _crease(((88.0, 14.0), (82.0, 10.0), (77.0, -2.0), (73.0, -16.0), (69.0, -30.0), (68.0, -38.0)), 0.9, 35),
    _crease(((20.0, -1.0), (40.0, -3.0), (60.0, -4.0)), 0.25, 28),
    _crease(((2.0, -26.0), (0.0, 0.0), (3.0, 26.0)), 0.75, 21),
    _crease(((-7.0, -25.0), (-9.0, 0.0), (-6.0, 25.0)), 0.55, 21),
    _crease(((-19.0, -23.0), (-21.5, 2.0), (-18.0, 24.0)), 0.3, 22),
)
VEINS = (
    _vein(((97.0, 15.5), (80.0, 14.0), (60.0, 13.0), (38.0, 7.0), (10.0, 14.0), (-32.0, 20.0), *_CEPHALIC), 1.4, 1),
    _vein(((93.0, -5.0), (72.0, -6.0), (52.0, 0.0), (38.0, 7.0)), 1.1, 2),
    _vein(((84.0, -23.0), (64.0, -19.0), (44.0, -14.0), (16.0, -17.0), (-32.0, -19.0), *_BASILIC), 1.4, 3),
    _vein(((72.0, -6.0), (66.0, -14.0), (62.0, -19.0)), 0.9, 4),
    _vein(((60.0, 13.0), (48.0, 20.0), (30.0, 24.0), (10.0, 14.0)), 1.0, 5),
    _vein(((44.0, -14.0), (30.0, -4.0), (24.0, 4.0)), 0.9, 6),
    _vein(((78.0, -31.0), (60.0, -29.0), (44.0, -22.0), (30.0, -16.0)), 0.9, 7),
    _vein(((-56.0, 22.0), (-82.0, 12.0), (-104.0, -4.0), (-116.0, -17.0)), 1.1, 8),
    _vein(((-24.0, -18.5), (-48.0, -4.0), (-82.0, 12.0)), 0.9, 9),
)
INNER_VEINS = (
    _vein(((-4.0, -12.0), (-40.0, -9.0), (-84.0, 0.0), (-128.0, 5.0), (-172.0, 2.0)), 1.4, 10),
    _vein(((-2.0, 17.0), (-36.0, 14.0), (-72.0, 17.0), (-128.0, 5.0)), 1.1, 11),
)


def line_mask(line: SkinLine, points: np.ndarray) -> np.ndarray:
    """Return [N] in [0, strength]: mask of the line at points [N, 3] of any height (anatomical frame)."""
    samples = _samples(line)
    distance, nearest = KDTree(samples).query(points[:, [0, 2]])
    to_end = np.minimum(nearest, len(samples) - 1 - nearest)
    return line.strength * np.exp(-0.5 * (distance / line.width) ** 2) * np.clip(to_end / line.fade, 0, 1)


def _samples(line: SkinLine) -> np.ndarray:
    """Return [P, 2] on a cubic spline through the line's points, moved sideways by a sum of three waves."""
    knots = np.array(line.points, dtype=float)
    lengths = np.r_[0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    points = np.arange(0, lengths[-1], _STEP)
    curve = CubicSpline(lengths, knots)(points)
    phases = np.random.default_rng(line.seed).uniform(0, 6.28, len(_WAVELENGTHS))
    offset = np.zeros_like(points)
    for wavelength, phase in zip(_WAVELENGTHS, phases, strict=True):
        offset += np.sin(2 * np.pi * points / wavelength + phase) * line.wiggle * wavelength / _WAVELENGTHS[-1]
    tangent = unit(np.gradient(curve, axis=0))
    return curve + np.stack([-tangent[:, 1], tangent[:, 0]], 1) * offset[:, None]
