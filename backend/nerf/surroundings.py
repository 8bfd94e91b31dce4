"""What stands around a hand, as flat patches that shed light on it.

Triangles are cut until they are small against their distance from the hand, and gathered again in the cells of a grid
that is as coarse, so that a table is as many patches as the meadow behind it.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.light import Light
from .bounce import Probes

MOST_PATCHES = 128
"""If the coarsest grid has more, those that fill most of the hand's view are kept."""
# Sides of pieces and cells against their distance from the hand: as fine as gives no more than these.
_FINENESS = (0.5, 0.7, 1.0, 1.4, 2.0)
_LEAST_M = 0.02  # of distances that count
_MOST_PIECES, _MOST_TRIED, _MOST_SCREENS = 100_000, 1024, 1024
_MOST_NEAR = 64  # vertices of the hand whose nearest stands for it
_LIFT_M = 0.001  # patches lie as far before their surface
_TINY = 1e-12
_CELLS_ACROSS = 1 << 16  # cells of one size lie much nearer to each other than that


class Patches(NamedTuple):
    """P patches, each with the side that the hand sees.

    Attributes:
        position: [P, 3] m, world; a little before the surface.
        normal: [P, 3] unit, on the side of the hand.
        area_m2: [P].
        albedo: [P, 3].
    """

    position: Tensor
    normal: Tensor
    area_m2: Tensor
    albedo: Tensor

    @classmethod
    def around(cls, light: Light, vertices: Float[Tensor, "V 3"]) -> Patches:
        """The patches of a light's occluders around a hand with these vertices; none if their albedo is not known."""
        step = -(-len(vertices) // _MOST_NEAR)
        near = vertices[::step].cpu().double().numpy()
        if len(light.occluder_albedo) == 0:
            return cls._of(_Pieces(*(np.zeros((0, 3)) for _ in range(3))), vertices.device)
        triangles = np.asarray(light.occluders, float)
        cut = _Cut.of(*_cut(triangles, np.asarray(light.occluder_albedo, float), near), near)
        screens = _Screens.of(_largest_triangles(triangles, near), near.mean(0))
        seen = (screens.seen(_largest(_gathered(cut, one), near, _MOST_TRIED), near) for one in _FINENESS)
        pieces = next(seen)
        while len(pieces.area) > MOST_PATCHES and (coarser := next(seen, None)) is not None:
            pieces = coarser
        return cls._of(_largest(pieces, near, MOST_PATCHES), vertices.device)

    @classmethod
    def _of(cls, pieces: _Pieces, device: torch.device) -> Patches:
        area_m2 = np.linalg.norm(pieces.area, axis=-1)
        normal = pieces.area / np.maximum(area_m2, _TINY)[:, None]
        values = (pieces.position, normal, area_m2, pieces.albedo)
        return cls(*(torch.as_tensor(value, dtype=torch.float32, device=device) for value in values))

    @property
    def probes(self) -> Probes:
        """The same as discs."""
        every = torch.arange(len(self.position), device=self.position.device)
        return Probes(self.position, self.normal, every, self.area_m2)

    def factors(
        self, position: Float[Tensor, "R 3"]
    ) -> tuple[Float[Tensor, "R P 3"], Float[Tensor, "R P"], Float[Tensor, "R P"]]:
        """Unit directions from points to the patches, what a surface that faces one receives of it, and distances, m.

        That is the form factor of a small surface and a disc without the surface's cosine, as in `nerf.bounce`.
        """
        offset = self.position - position[:, None]
        distance = offset.norm(dim=-1).clamp(min=_LIFT_M)
        towards = offset / distance[..., None]
        there = -(towards * self.normal).sum(-1).clamp(max=0)
        return towards, there * self.area_m2 / (pi * distance**2 + self.area_m2), distance

    def exchanged(self) -> Float[Tensor, "P P"]:
        """What each patch receives of the light that the others shed."""
        towards, factors, _ = self.factors(self.position)
        factors = factors * (towards * self.normal[:, None]).sum(-1).clamp(min=0)
        return factors / factors.sum(1, keepdim=True).clamp(min=1)


class _Pieces(NamedTuple):
    """N pieces: middles [N, 3] m, vector areas [N, 3] m^2 on the side of the hand, albedo [N, 3]."""

    position: np.ndarray
    area: np.ndarray
    albedo: np.ndarray


def _cut(triangles: np.ndarray, albedo: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The triangles [N, 3, 3] in halves of halves, until all are small against their distance."""
    done, still = [], (triangles, albedo)
    while len(still[0]) and len(still[0]) < _MOST_PIECES:
        corners, colour = still
        edges = np.linalg.norm(corners - np.roll(corners, -1, 1), axis=-1)
        longest, side = edges.argmax(1), edges.max(1)
        distance = np.maximum(_distance(corners.mean(1), near)[0] - side / 2, _LEAST_M)
        is_long = side > _FINENESS[0] * distance
        done.append((corners[~is_long], colour[~is_long]))
        which = np.arange(len(corners))[is_long]
        a, b, c = (corners[which, (longest[which] + turn) % 3] for turn in range(3))
        middle = (a + b) / 2
        halves = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        still = halves, np.concatenate([colour[which], colour[which]])
    done.append(still)
    corners, colours = (np.concatenate(parts) for parts in zip(*done, strict=True))
    return corners, colours


class _Cut(NamedTuple):
    """N small triangles, in no cells yet.

    Attributes:
        corners: [N, 3, 3] m.
        pieces: the triangles as pieces.
        distance: [N] from the hand, m.
        facing: [N] a number from 0 to 11 that tells which of a board's sides this is, and where it faces.
    """

    corners: np.ndarray
    pieces: _Pieces
    distance: np.ndarray
    facing: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray, albedo: np.ndarray, near: np.ndarray) -> _Cut:
        """The triangles, turned to a hand with these vertices."""
        a, b, c = corners.swapaxes(0, 1)
        position, area = corners.mean(1), np.cross(b - a, c - a) / 2
        distance, nearest = _distance(position, near)
        is_back = ((nearest - position) * area).sum(-1) < 0
        area = np.where(is_back[:, None], -area, area)
        axis = np.abs(area).argmax(1)
        is_down = np.take_along_axis(area, axis[:, None], 1)[:, 0] < 0
        return cls(corners, _Pieces(position, area, albedo), distance, 4 * axis + 2 * is_down + is_back)

    def cells(self, fineness: float) -> np.ndarray:
        """[N] the same whole number for all that lie in one cell of the world and face alike."""
        level = np.floor(np.log2(fineness * np.maximum(self.distance, _LEAST_M)))
        numbers = np.floor(self.pieces.position / np.exp2(level)[:, None]).astype(np.int64) % _CELLS_ACROSS
        keys = level.astype(np.int64)
        for values, count in ((self.facing, 12), *((column, _CELLS_ACROSS) for column in numbers.T)):
            keys = keys * count + values
        return keys


def _gathered(cut: _Cut, fineness: float) -> _Pieces:
    """One piece, lifted from the surface, for all that lie in a cell and face alike."""
    position, area, albedo = cut.pieces
    group = np.unique(cut.cells(fineness), return_inverse=True)[1].ravel()
    weight = np.maximum(np.linalg.norm(area, axis=-1), _TINY)

    def summed(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(group, column) for column in values.T], -1)

    total = summed(weight[:, None])
    area, middle = summed(area), summed(weight[:, None] * position) / total
    normal = area / np.maximum(np.linalg.norm(area, axis=-1, keepdims=True), _TINY)
    height = np.einsum("nki,ni->nk", cut.corners - middle[group, None], normal[group]).max(1)
    highest = np.full(len(middle), -np.inf)
    np.maximum.at(highest, group, height)
    lifted = middle + (_LIFT_M + highest[:, None]) * normal
    return _Pieces(lifted, area, summed(weight[:, None] * albedo) / total)


def _largest(pieces: _Pieces, near: np.ndarray, most: int) -> _Pieces:
    """The pieces that may shed most light on the hand."""
    distance, nearest = _distance(pieces.position, near)
    facing = ((nearest - pieces.position) * pieces.area).sum(-1) / np.maximum(distance, _LEAST_M) ** 3
    order = np.argsort(-facing, kind="stable")[:most]
    return _Pieces(*(values[order[facing[order] > 0]] for values in pieces))


def _largest_triangles(triangles: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Those that may stand before others."""
    a, b, c = triangles.swapaxes(0, 1)
    size = np.linalg.norm(np.cross(b - a, c - a), axis=-1) / np.maximum(_distance(triangles.mean(1), near)[0], _LEAST_M)
    return triangles[np.argsort(-size, kind="stable")[:_MOST_SCREENS]]


class _Screens(NamedTuple):
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
    def of(cls, triangles: np.ndarray, origin: np.ndarray) -> _Screens:
        """Of triangles [N, 3, 3]; those without area hide nothing."""
        a, b, c = (triangles - origin).swapaxes(0, 1)
        first, second = b - a, c - a
        normal = np.cross(first, second)
        squared = (normal**2).sum(-1, keepdims=True)
        has_area = squared[:, 0] > _TINY**2
        values = np.stack([normal, np.cross(second, normal), np.cross(normal, first)]) / np.maximum(squared, _TINY**2)
        values = values[:, has_area]
        return cls(values.astype(np.float32), (values * a[has_area]).sum(-1).astype(np.float32), origin)

    def seen(self, pieces: _Pieces, near: np.ndarray) -> _Pieces:
        """The pieces that nothing hides from the hand's nearest vertex."""
        way = np.float32(_distance(pieces.position, near)[1] - pieces.position)
        start = np.float32(pieces.position - self.origin)
        height, u, v = start @ self.values.swapaxes(1, 2) - self.offsets[:, None]
        climb, along_u, along_v = way @ self.values.swapaxes(1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):  # along a plane nothing is hidden: no comparison holds
            t = -height / climb
            u, v = u + t * along_u, v + t * along_v
            is_hidden = (t > 0) & (t < 1) & (u >= 0) & (v >= 0) & (u + v <= 1)
        return _Pieces(*(values[~is_hidden.any(1)] for values in pieces))


def _distance(points: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [N] of points from the nearest of some vertices, m, and those vertices [N, 3]."""
    squared = (points**2).sum(-1)[:, None] - 2 * points @ near.T + (near**2).sum(-1)
    nearest = squared.argmin(1)
    return np.sqrt(np.maximum(np.take_along_axis(squared, nearest[:, None], 1)[:, 0], 0)), near[nearest]
