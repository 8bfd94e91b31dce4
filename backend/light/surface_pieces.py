"""Pieces of surfaces around a hand: triangles, cut until they are small against their distance, and gathered in cells.

A cell of the grid is as coarse as it is far, so that a table is as many pieces as the meadow behind it. A piece has a
side; a triangle is one on each side that has any of the hand before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

LEAST_M = 0.04
"""Of distances that count."""
_MOST_CUT = 100_000
_LIFT_M = 0.001  # pieces lie as far before their surface
_TINY = 1e-12
_CELLS_ACROSS = 1 << 16  # cells of one size lie much nearer to each other than that
_AT_ONCE = 1 << 14  # pieces whose distances are in memory


class Pieces(NamedTuple):
    """N pieces.

    Attributes:
        corners: [N, M, 3] m, world.
        position: [N, 3] their middles, m, world.
        area: [N, 3] normal times area, m^2.
        albedo: [N, 3].
        is_back: [N] whether that is not the side from which their corners are in counter-clockwise order.
        vertex: [N, 3] the nearest of the hand's vertices that lie before them, m, world; the middle where none does. A
            hand may reach through a wall, or past a table's edge: what is nearest of all may lie behind their plane.
    """

    corners: np.ndarray
    position: np.ndarray
    area: np.ndarray
    albedo: np.ndarray
    is_back: np.ndarray
    vertex: np.ndarray

    @classmethod
    def none(cls) -> Pieces:
        """No pieces."""
        flat = np.zeros((0, 3))
        return cls(np.zeros((0, 3, 3)), flat, flat, flat, np.zeros(0, bool), flat)

    @classmethod
    def of(cls, triangles: np.ndarray, albedo: np.ndarray, near: np.ndarray, fineness: float) -> Pieces:
        """The sides of triangles [N, 3, 3] that have any of a hand's vertices before them.

        Args:
            triangles: m, world.
            albedo: [N, 3].
            near: [V, 3] the vertices, m, world.
            fineness: the longest side of a piece against its distance.
        """
        corners, albedo = _cut(triangles, albedo, near, fineness)
        a, b, c = corners.swapaxes(0, 1)
        middle, area = corners.mean(1), np.cross(b - a, c - a) / 2
        sides = (
            cls(corners, middle, side, albedo, np.full(len(side), is_back), _nearest_before(middle, side, near))
            for side, is_back in ((area, False), (-area, True))
        )
        kept = (pieces.chosen((pieces.vertex != pieces.position).any(1)) for pieces in sides)
        return cls(*(np.concatenate(values) for values in zip(*kept, strict=True)))

    def chosen(self, which: np.ndarray) -> Pieces:
        """Some of them, by index or mask."""
        return Pieces(*(values[which] for values in self))

    @property
    def distance(self) -> np.ndarray:
        """[N] from the hand, m, but at least `LEAST_M`."""
        return np.maximum(np.linalg.norm(self.vertex - self.position, axis=-1), LEAST_M)

    def largest(self, most: int) -> np.ndarray:
        """Indices of those that may shed most light on the hand, in order."""
        facing = ((self.vertex - self.position) * self.area).sum(-1) / self.distance**3
        order = np.argsort(-facing, kind="stable")[:most]
        return order[facing[order] > 0]

    def cells(self, fineness: float) -> np.ndarray:
        """[N] the same whole number for all that lie in one cell of the world and face alike."""
        level = np.floor(np.log2(fineness * self.distance))
        numbers = np.floor(self.position / np.exp2(level)[:, None]).astype(np.int64) % _CELLS_ACROSS
        axis = np.abs(self.area).argmax(1)
        is_down = np.take_along_axis(self.area, axis[:, None], 1)[:, 0] < 0
        facing = 4 * axis + 2 * is_down + self.is_back
        keys = level.astype(np.int64)
        for values, count in ((facing, 12), *((column, _CELLS_ACROSS) for column in numbers.T)):
            keys = keys * count + values
        return keys

    def gathered(self, cells: np.ndarray, near: np.ndarray) -> tuple[Pieces, np.ndarray]:
        """One piece for all in a cell, lifted from their surface, and [N] which of these each has become.

        Args:
            cells: [N] the same number for all in one.
            near: as `of` takes them.
        """
        first, group = np.unique(cells, return_index=True, return_inverse=True)[1:]
        group = group.ravel()
        weight = np.maximum(np.linalg.norm(self.area, axis=-1), _TINY)

        def summed(values: np.ndarray) -> np.ndarray:
            return np.stack([np.bincount(group, column) for column in values.T], -1)

        total = summed(weight[:, None])
        area, middle = summed(self.area), summed(weight[:, None] * self.position) / total
        normal = area / np.maximum(np.linalg.norm(area, axis=-1, keepdims=True), _TINY)
        height = np.einsum("nki,ni->nk", self.corners - middle[group, None], normal[group]).max(1)
        highest = np.full(len(middle), -np.inf)
        np.maximum.at(highest, group, height)
        lifted = middle + (_LIFT_M + highest[:, None]) * normal
        albedo = summed(weight[:, None] * self.albedo) / total
        vertex = _nearest_before(lifted, area, near)
        return Pieces(lifted[:, None], lifted, area, albedo, self.is_back[first], vertex), group


def distance_of(points: np.ndarray, near: np.ndarray) -> np.ndarray:
    """[N] distance of points from the nearest of some vertices, m."""
    return np.sqrt(np.maximum(_squared(points, near).min(1), 0))


def _nearest_before(position: np.ndarray, area: np.ndarray, near: np.ndarray) -> np.ndarray:
    """[N, 3] as `Pieces.vertex`; in single precision, for each vertex is tried on each piece."""
    origin = near.mean(0)
    at, sides, vertices = (values.astype(np.float32) for values in (position - origin, area, near - origin))
    nearest = [np.zeros(0, np.int64)]
    for start in range(0, len(at), _AT_ONCE):
        some, side = at[start : start + _AT_ONCE], sides[start : start + _AT_ONCE]
        is_before = side @ vertices.T > (side * some).sum(-1)[:, None]
        found = np.where(is_before, _squared(some, vertices), np.inf).argmin(1)
        nearest.append(np.where(np.take_along_axis(is_before, found[:, None], 1)[:, 0], found, -1))
    index = np.concatenate(nearest)
    return np.where(index[:, None] >= 0, near[index], position)


def _cut(triangles: np.ndarray, albedo: np.ndarray, near: np.ndarray, fineness: float) -> tuple[np.ndarray, np.ndarray]:
    """The triangles in halves of halves, until all are small against their distance."""
    done, still = [], (triangles, albedo)
    while len(still[0]) and len(still[0]) < _MOST_CUT:
        corners, colour = still
        edges = np.linalg.norm(corners - np.roll(corners, -1, 1), axis=-1)
        longest, side = edges.argmax(1), edges.max(1)
        distance = np.maximum(distance_of(corners.mean(1), near) - side / 2, LEAST_M)
        is_long = side > fineness * distance
        done.append((corners[~is_long], colour[~is_long]))
        which = np.arange(len(corners))[is_long]
        a, b, c = (corners[which, (longest[which] + turn) % 3] for turn in range(3))
        middle = (a + b) / 2
        halves = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        still = halves, np.concatenate([colour[which], colour[which]])
    done.append(still)
    corners, colours = (np.concatenate(parts) for parts in zip(*done, strict=True))
    return corners, colours


def _squared(points: np.ndarray, near: np.ndarray) -> np.ndarray:
    """[N, V] squared distances."""
    return (points**2).sum(-1)[:, None] - 2 * points @ near.T + (near**2).sum(-1)
