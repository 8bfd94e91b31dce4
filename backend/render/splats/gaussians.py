"""Gaussian splats, and the spherical harmonics of their colours by the direction in which they are seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

DEGREE = 3
"""The highest that viewers know; gloss needs it."""
MIDDLE = 0.5
"""Added to what the harmonics give."""


@dataclass(frozen=True)
class Splats:
    """N Gaussians, in any axes.

    Attributes:
        positions: [N, 3] m.
        rotations: [N, 4] unit quaternions (w, x, y, z), from each one's own axes.
        scales: [N, 3] m, standard deviations along these.
        opacity: [N] in (0, 1), at the middle.
        harmonics: [N, K, 3] of the colours, sRGB-encoded; K as in `harmonic_basis`.
        normals: [N, 3] unit, outward, of the surface.
        albedo: [N, 3] linear, of the surface.
    """

    positions: np.ndarray
    rotations: np.ndarray
    scales: np.ndarray
    opacity: np.ndarray
    harmonics: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def degree(self) -> int:
        """Of the harmonics."""
        return round(self.harmonics.shape[1] ** 0.5) - 1

    def colors(self, origin: np.ndarray) -> np.ndarray:
        """Compute the colours [N, 3], sRGB-encoded, that a camera at `origin` [3] sees; none is negative."""
        basis = harmonic_basis(self.positions - origin, self.degree)
        return (np.einsum("nk,nkc->nc", basis, self.harmonics) + MIDDLE).clip(0)


def joined(parts: Sequence[Splats]) -> Splats:
    """Join the splats of several hands."""
    return Splats(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Splats)))


def harmonic_basis(directions: np.ndarray, degree: int) -> np.ndarray:
    """Compute the real spherical harmonics [N, (degree + 1)^2] of directions [N, 3], with the Condon-Shortley phase.

    The columns are ordered by degree, then from the lowest order to the highest, as files of splats have them.

    Args:
        directions: from the camera to the splat, of any length but 0.
        degree: 0 to 3.
    """
    x, y, z = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
    xx, yy, zz = x * x, y * y, z * z
    # Each a polynomial, and the square of its factor times pi.
    terms = [
        (np.ones_like(x), 1 / 4),
        (-y, 3 / 4),
        (z, 3 / 4),
        (-x, 3 / 4),
        (x * y, 15 / 4),
        (-y * z, 15 / 4),
        (2 * zz - xx - yy, 5 / 16),
        (-x * z, 15 / 4),
        (xx - yy, 15 / 16),
        (-y * (3 * xx - yy), 35 / 32),
        (x * y * z, 105 / 4),
        (-y * (4 * zz - xx - yy), 21 / 32),
        (z * (2 * zz - 3 * xx - 3 * yy), 7 / 16),
        (-x * (4 * zz - xx - yy), 21 / 32),
        (z * (xx - yy), 105 / 16),
        (-x * (xx - 3 * yy), 35 / 32),
    ]
    return np.stack([polynomial * (square / np.pi) ** 0.5 for polynomial, square in terms[: (degree + 1) ** 2]], 1)
