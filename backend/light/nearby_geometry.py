"""Scene geometry near a hand, as flat patches that reflect light on it.

A cell of the grid is as coarse as it is far, so that a table is as many pieces as the meadow behind it. A piece has a
side; a triangle is one on each side that has any of the hand before it.

What the hand sees of the surfaces is sampled at small points, at which light is looked up, and these are merged into as
few patches as reflect it.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.light import Light
from .indirect_diffuse import Surfels
from .shadow_maps import Bounds

_MOST = 1024
_IN_CACHE = 128  # pieces that are tried at once on all of these
_TINY = 1e-12


class Blockers(NamedTuple):
    """T triangles that may hide pieces from the hand; in single precision, for each is tried on each piece.

    `values` @ (x - `origin`) - `offsets` gives on which side of each a point x lies.

    Attributes:
        values: [3, T, 3] height over the triangle's plane, in units of its own, and shares of two of its edges.
        offsets: [3, T].
        origin: [3] m, near.
    """

    values: np.ndarray
    offsets: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, triangles: np.ndarray, near: np.ndarray) -> Blockers:
        """Choose those of triangles [N, 3, 3] that look largest from vertices [V, 3]; without area they hide none."""
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
        """Keep the pieces that nothing hides from the nearest of a hand's vertices that lie before them."""
        way = (pieces.vertex - pieces.position).astype(np.float32)
        start = (pieces.position - self.origin).astype(np.float32)
        rows = [slice(first, first + _IN_CACHE) for first in range(0, len(way), _IN_CACHE)]
        is_hidden = [self._is_hidden(start[some], way[some]) for some in rows]
        return pieces.chosen(~np.concatenate([np.zeros(0, bool), *is_hidden]))

    def _is_hidden(self, start: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Find which of some ways [N, 3] from their starts a triangle crosses."""
        height, u, v = start @ self.values.swapaxes(1, 2) - self.offsets[:, None]
        climb, along_u, along_v = way @ self.values.swapaxes(1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):  # along a plane nothing is hidden: no comparison holds
            t = -height / climb
            u += t * along_u
            v += t * along_v
            is_hidden = (t > 0) & (t < 1) & (u >= 0) & (v >= 0) & (u + v <= 1)
        return is_hidden.any(1)


def _largest(triangles: np.ndarray, near: np.ndarray) -> np.ndarray:
    a, b, c = triangles.swapaxes(0, 1)
    size = np.linalg.norm(np.cross(b - a, c - a), axis=-1) / np.maximum(distance_of(triangles.mean(1), near), LEAST_M)
    return triangles[np.argsort(-size, kind="stable")[:_MOST]]


LEAST_M = 0.04
"""Of distances that count."""
_MOST_CUT = 100_000
_LIFT_M = 0.001  # pieces lie as far before their surface
_LIFT_PX = 1.5  # of a shadow map, by which points on them are raised
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
        """Return no pieces."""
        flat = np.zeros((0, 3))
        return cls(np.zeros((0, 3, 3)), flat, flat, flat, np.zeros(0, bool), flat)

    @classmethod
    def of(cls, triangles: np.ndarray, albedo: np.ndarray, near: np.ndarray, fineness: float) -> Pieces:
        """Cut up the sides of triangles [N, 3, 3] that have any of a hand's vertices before them.

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
        """Select pieces by index or mask."""
        return Pieces(*(values[which] for values in self))

    @property
    def distance(self) -> np.ndarray:
        """[N] from the hand, m, but at least `LEAST_M`."""
        return np.maximum(np.linalg.norm(self.vertex - self.position, axis=-1), LEAST_M)

    def largest(self, most: int) -> np.ndarray:
        """Return the indices of those that may reflect most light onto the hand, in order."""
        facing = ((self.vertex - self.position) * self.area).sum(-1) / self.distance**3
        order = np.argsort(-facing, kind="stable")[:most]
        return order[facing[order] > 0]

    def cells(self, fineness: float) -> np.ndarray:
        """Assign each piece a number [N], the same for all that lie in one cell of the world and face alike."""
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
        """Merge the pieces of each cell, lifted from their surface; also return which of these each has become [N].

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
    """Compute the distance [N] of points from the nearest of some vertices, m."""
    return np.sqrt(np.maximum(_squared(points, near).min(1), 0))


def _nearest_before(position: np.ndarray, area: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Find `Pieces.vertex` [N, 3]; in single precision, for each vertex is tried on each piece."""
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
    """Cut the triangles in halves of halves, until all are small against their distance."""
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
    """Compute squared distances [N, V]."""
    return (points**2).sum(-1)[:, None] - 2 * points @ near.T + (near**2).sum(-1)


MOST_PATCHES = 128
"""If the coarsest cells are more, those that fill most of the hand's view are kept."""
MOST_POINTS = 4096
"""Of all patches."""
# Sides of pieces and cells against their distance from the hand: as fine as gives few.
_FINENESS = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
_MOST_NEAR = 64  # vertices of the hand whose nearest stands for it
_NEAREST_M = 0.001  # that count


class PatchPoints(NamedTuple):
    """S points of P patches, at which light is looked up: a shadow may end within a patch.

    Attributes:
        position: [S, 3] m, world; a little before the surface.
        normal: [S, 3] unit, on the side of the hand.
        area_m2: [S].
        patch: [S] of which each is.
    """

    position: Tensor
    normal: Tensor
    area_m2: Tensor
    patch: Tensor

    def bounds_with(self, vertices: Float[Tensor, "V 3"]) -> Bounds:
        """Return a sphere about the points and a hand with these vertices."""
        return Bounds.around(torch.cat([self.position, vertices]))

    def lifted(self, bounds: Bounds, map_px: int) -> Float[Tensor, "S 3"]:
        """Raise the points, for shadow maps of this size around bounds: they must not shadow their own surface.

        It would where light grazes.
        """
        lift_m = torch.minimum(_LIFT_PX * 2 * bounds.radius / map_px, 0.5 * self.area_m2.sqrt())
        return self.position + lift_m[:, None] * self.normal

    @property
    def surfels(self) -> Surfels:
        """The points as discs."""
        every = torch.arange(len(self.position), device=self.position.device)
        return Surfels(self.position, self.normal, every, self.area_m2)


class Patches(NamedTuple):
    """P patches, each with the side that the hand sees.

    Attributes:
        position: [P, 3] m, world; a little before the surface.
        normal: [P, 3] unit, on the side of the hand.
        area_m2: [P].
        albedo: [P, 3].
        points: on them.
    """

    position: Tensor
    normal: Tensor
    area_m2: Tensor
    albedo: Tensor
    points: PatchPoints

    @classmethod
    def around(cls, light: Light, vertices: Float[Tensor, "V 3"]) -> Patches:
        """Make the patches of a light's occluders around a hand with these vertices; none if no albedo is known."""
        step = -(-len(vertices) // _MOST_NEAR)
        near = vertices[::step].cpu().double().numpy()
        if len(light.occluder_albedo) == 0:
            return cls._of(Pieces.none(), Pieces.none(), np.zeros(0, int), vertices.device)
        points = _points_before(light, near)
        patches, patch = _gathered(points, near, MOST_PATCHES)
        is_kept = patch >= 0
        return cls._of(patches, points.chosen(is_kept), patch[is_kept], vertices.device)

    @classmethod
    def _of(cls, patches: Pieces, points: Pieces, patch: np.ndarray, device: torch.device) -> Patches:
        def tensors(*arrays: np.ndarray) -> tuple[Tensor, ...]:
            return tuple(torch.as_tensor(array, dtype=torch.float32, device=device) for array in arrays)

        on_them = PatchPoints(*tensors(*_flat(points)), patch=torch.as_tensor(patch, device=device))
        return cls(*tensors(*_flat(patches), patches.albedo), points=on_them)

    def mean(self, of_points: Float[Tensor, "K S"]) -> Float[Tensor, "K P"]:
        """Average the points' values over each patch."""
        patch, area_m2 = self.points.patch, self.points.area_m2
        total = area_m2.new_zeros(len(self.position)).index_add(0, patch, area_m2)
        return of_points.new_zeros(len(of_points), len(total)).index_add(1, patch, of_points * (area_m2 / total[patch]))

    def factors(
        self, position: Float[Tensor, "R 3"]
    ) -> tuple[Float[Tensor, "R P 3"], Float[Tensor, "R P"], Float[Tensor, "R P"]]:
        """Compute unit directions from points to the patches, their form factors, and distances, m.

        That is the form factor of a small surface and a disc without its cosine, as in `light.indirect_diffuse`.
        """
        offset = self.position - position[:, None]
        distance = offset.norm(dim=-1).clamp(min=_NEAREST_M)
        towards = offset / distance[..., None]
        there = -(towards * self.normal).sum(-1).clamp(max=0)
        return towards, there * self.area_m2 / (pi * distance**2 + self.area_m2), distance

    def exchanged(self) -> Float[Tensor, "P P"]:
        """Compute what each patch receives of the light that the others reflect."""
        towards, factors, _ = self.factors(self.position)
        factors = factors * (towards * self.normal[:, None]).sum(-1).clamp(min=0)
        return factors / factors.sum(1, keepdim=True).clamp(min=1)


def _points_before(light: Light, near: np.ndarray) -> Pieces:
    """Find what a hand with these vertices sees of a light's occluders."""
    triangles = np.asarray(light.occluders, float)
    cut = Pieces.of(triangles, np.asarray(light.occluder_albedo, float), near, _FINENESS[0])
    points, _ = _gathered(cut, near, MOST_POINTS)
    return Blockers.of(triangles, near).seen(points)


def _gathered(pieces: Pieces, near: np.ndarray, most: int) -> tuple[Pieces, np.ndarray]:
    """Merge the pieces in cells so coarse that few remain; return also which each becomes; -1: smallest, left out."""
    found, number = pieces, np.arange(len(pieces.area))
    for fineness in _FINENESS:
        found, number = pieces.gathered(pieces.cells(fineness), near)
        if len(found.area) <= most:
            break
    kept, numbers = found.largest(most), np.full(len(found.area), -1)
    numbers[kept] = np.arange(len(kept))
    return found.chosen(kept), numbers[number]


def _flat(pieces: Pieces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, normals and areas."""
    area_m2 = np.linalg.norm(pieces.area, axis=-1)
    return pieces.position, pieces.area / np.maximum(area_m2, _TINY)[:, None], area_m2
