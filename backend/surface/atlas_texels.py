"""The texels of an atlas on the detail surface: where each lies on the mesh, and fields to vertices and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..geometry.rasterise import rasterise

if TYPE_CHECKING:
    from scipy import sparse


@dataclass(frozen=True)
class AtlasTexels:
    """The T texels of an atlas of A x A whose centres lie on the surface, which has N vertices.

    Attributes:
        resolution: A.
        pixel: [T] row * A + column, the row of the smallest v first; increasing.
        face: [T] of the surface, on which each lies.
        weights: [T, 3] barycentric.
        faces: [M, 3] of the surface.
    """

    resolution: int
    pixel: np.ndarray
    face: np.ndarray
    weights: np.ndarray
    faces: np.ndarray

    @classmethod
    def of(cls, corner_uv: Tensor, faces: Tensor, resolution: int) -> AtlasTexels:
        """Find the texels of a surface by its corners' coordinates [M, 3, 2] and faces [M, 3]."""
        corner_px = corner_uv.reshape(-1, 2) * resolution
        alone = torch.arange(len(corner_px)).reshape(-1, 3)
        found = rasterise(corner_px, torch.ones(len(corner_px)), alone, (resolution, resolution))
        pixel, first = np.unique(found.pixel.numpy(), return_index=True)
        face = found.face.numpy()[first]
        centre = np.stack([pixel % resolution, pixel // resolution], 1) + 0.5
        weights = _barycentric(corner_px.reshape(-1, 3, 2).numpy()[face].astype(np.float64), centre)
        return cls(resolution, pixel, face, weights.astype(np.float32), faces.numpy())

    def at_texels(self, values: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Interpolate values [N, C] of vertices at the texels [T, C], or at the chosen ones of them."""
        return np.einsum("tkc,tk->tc", values[self.corners[chosen]], self.weights[chosen])

    def at_vertices(self, values: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Average values [T, C] at the vertices [N, C], and add up their weights [T] there [N]."""
        shares = (weight[:, None] * self.weights).ravel()
        at, count = self.corners.ravel(), self._count
        total = np.bincount(at, shares, count)
        of_texel = np.repeat(np.arange(len(self.pixel)), 3)
        sums = [np.bincount(at, shares * values[of_texel, channel], count) for channel in range(values.shape[1])]
        return np.stack(sums, 1) / np.maximum(total, 1e-9)[:, None], total

    def as_map(self, values: np.ndarray) -> np.ndarray:
        """Spread values [T, C] over the atlas [A, A, C]; beyond the charts each texel has its nearest one's."""
        image = np.zeros((self.resolution**2, values.shape[1]), np.float32)
        image[self.pixel] = values
        image = image.reshape(self.resolution, self.resolution, -1)
        return image[self._nearest[0], self._nearest[1]]

    def from_map(self, image: np.ndarray) -> np.ndarray:
        """Take values [T, C] of a map [A, A, C]."""
        return image.reshape(self.resolution**2, -1)[self.pixel]

    @cached_property
    def corners(self) -> np.ndarray:
        """[T, 3] vertices of the face that each texel lies on."""
        return self.faces[self.face]

    @cached_property
    def laplacian(self) -> sparse.csr_matrix:
        """[N, N] of the surface's edges: degree on the diagonal, -1 between neighbours."""
        from scipy import sparse  # which rendering does without

        ends = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]])
        one_way = sparse.coo_matrix((np.ones(len(ends)), ends.T), shape=(self._count, self._count))
        neighbours = ((one_way + one_way.T) > 0).astype(np.float64)
        return (sparse.diags(np.asarray(neighbours.sum(1))[:, 0]) - neighbours).tocsr()

    @property
    def _count(self) -> int:
        return int(self.faces.max()) + 1

    @cached_property
    def _nearest(self) -> np.ndarray:
        is_inside = np.zeros(self.resolution**2, bool)
        is_inside[self.pixel] = True
        return nearest_inside(is_inside.reshape(self.resolution, self.resolution))


def nearest_inside(is_inside: np.ndarray) -> np.ndarray:
    """Return row and column [2, A, A] of the texel inside that is nearest to each, by jump flooding.

    In ever shorter jumps each texel takes over what a texel there knows, if that is nearer; the last jumps are taken
    twice, after which hardly a texel has its second nearest.
    """
    size = len(is_inside)
    row, column = (axis.astype(np.int32) for axis in np.ogrid[:size, :size])
    far = 2 * size  # farther than any texel is from another
    nearest_row, nearest_column = np.where(is_inside, row, -far), np.where(is_inside, column, -far)
    distance = (nearest_row - row) ** 2 + (nearest_column - column) ** 2
    step = 1 << max(size - 1, 1).bit_length() - 1
    jumps = [step >> level for level in range(step.bit_length())]
    for jump in (*jumps, 2, 1):
        for down, right in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
            here, there = _shifted(down * jump, right * jump)
            theirs = (nearest_row[there] - row[here[0]]) ** 2 + (nearest_column[there] - column[:, here[1]]) ** 2
            is_nearer = theirs < distance[here]
            np.copyto(distance[here], theirs, where=is_nearer)
            for known in (nearest_row, nearest_column):
                np.copyto(known[here], known[there], where=is_nearer)
    return np.stack([nearest_row, nearest_column])


def _shifted(down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the part of an image whose texels have one so far below and to the right, and the part of those."""
    here, there = [], []
    for offset in (down, right):
        here.append(slice(max(-offset, 0), -offset if offset > 0 else None))
        there.append(slice(max(offset, 0), offset if offset < 0 else None))
    return (here[0], here[1]), (there[0], there[1])


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute barycentric coordinates [T, 3] of points [T, 2] in triangles [T, 3, 2]."""
    ab, ac, ap = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    area = _cross(ab, ac)
    b, c = _cross(ap, ac) / area, _cross(ab, ap) / area
    return np.stack([1 - b - c, b, c], 1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
