"""Triangles that may hide pieces of surfaces from a hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .surface_pieces import LEAST_M, Pieces, distance_of

_MOST = 1024
_TINY = 1e-12


class Screens(NamedTuple):
    """T triangles that may hide pieces from the hand; in single precision, for each is tried on each piece.

    `values` @ (x - `origin`) - `offsets` tells where a point x lies to each.

    Attributes:
        values: [3, T, 3] height over the triangle's plane, in units of its own, and shares of two of its edges.
        offsets: [3, T].
        origin: [3] m, near.
    """

    values: np.ndarray
    offsets: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, triangles: np.ndarray, near: np.ndarray) -> Screens:
        """Of the triangles [N, 3, 3] those that look largest from vertices [V, 3]; without area they hide nothing."""
        origin = near.mean(0)
        a, b, c = (_largest(triangles, near) - origin).swapaxes(0, 1)
        first, second = b - a, c - a
        normal = np.cross(first, second)
        squared = (normal**2).sum(-1, keepdims=True)
        has_area = squared[:, 0] > _TINY**2
        values = np.stack([normal, np.cross(second, normal), np.cross(normal, first)]) / np.maximum(squared, _TINY**2)
        values = values[:, has_area]
        return cls(values.astype(np.float32), (values * a[has_area]).sum(-1).astype(np.float32), origin)

    def seen(self, pieces: Pieces) -> Pieces:
        """The pieces that nothing hides from the nearest of a hand's vertices that lie before them."""
        way = np.float32(pieces.vertex - pieces.position)
        start = np.float32(pieces.position - self.origin)
        height, u, v = start @ self.values.swapaxes(1, 2) - self.offsets[:, None]
        climb, along_u, along_v = way @ self.values.swapaxes(1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):  # along a plane nothing is hidden: no comparison holds
            t = -height / climb
            u, v = u + t * along_u, v + t * along_v
            is_hidden = (t > 0) & (t < 1) & (u >= 0) & (v >= 0) & (u + v <= 1)
        return pieces.chosen(~is_hidden.any(1))


def _largest(triangles: np.ndarray, near: np.ndarray) -> np.ndarray:
    a, b, c = triangles.swapaxes(0, 1)
    size = np.linalg.norm(np.cross(b - a, c - a), axis=-1) / np.maximum(distance_of(triangles.mean(1), near), LEAST_M)
    return triangles[np.argsort(-size, kind="stable")[:_MOST]]
