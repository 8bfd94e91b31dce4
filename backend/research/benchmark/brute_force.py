"""The nearest face of every sample by testing all faces, as the published CUDA kernel does.

On a CPU with numba this is a compiled loop (0.5 ns per pair of sample and face on one core with AVX-512; the authors'
renderer took 4 ns on another), elsewhere dense torch (12 ns). `closest_on_triangles` over all faces would take 300 ns
or more, and a baseline must not be slow only because it is badly written.

The distance to a triangle is the least of the distances to its edges, or the height over its plane where the sample
projects into the face.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from inspect import unwrap
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...render.backends import has_numba

_BLOCK = 64  # samples that the compiled loop tests against one face at a time
_CHUNK = 128  # samples of the dense search; 9 tables of [128, F] fit into a CPU's cache
_GPU_CHUNK = 4096
_FAR_M2 = np.float32(1e30)
_TINY = 1e-24  # m^4, keeps the quotients of degenerate faces finite


class FaceTable(NamedTuple):
    """The constants of each face.

    Attributes:
        corners: [F, 3, 3] m.
        edges: [F, 3, 3] to the next corner, m.
        inverse: [F, 3] 1 / squared length of the edges, 1/m^2.
        plane: [F, 3, 3] rows whose products with the offset from corner 0 are the barycentrics of corners 1 and 2 and
            the height over the plane.
    """

    corners: Tensor
    edges: Tensor
    inverse: Tensor
    plane: Tensor

    @classmethod
    def of(cls, triangles: Float[Tensor, "F 3 3"]) -> FaceTable:
        """Build the table of a mesh's faces."""
        a, b, c = triangles.unbind(1)
        edges = torch.stack([b - a, c - b, a - c], 1)
        ab, ac = b - a, c - a
        d00, d01, d11 = ((ab * ab).sum(-1), (ab * ac).sum(-1), (ac * ac).sum(-1))
        scale = 1 / (d00 * d11 - d01 * d01).clamp(min=_TINY)
        v = (d11[:, None] * ab - d01[:, None] * ac) * scale[:, None]
        w = (d00[:, None] * ac - d01[:, None] * ab) * scale[:, None]
        normal = torch.nn.functional.normalize(torch.linalg.cross(ab, ac), dim=-1)
        inverse = 1 / (edges * edges).sum(-1).clamp(min=_TINY)
        return cls(triangles, edges, inverse, torch.stack([v, w, normal], 1))


def nearest_faces(points: Float[Tensor, "S 3"], triangles: Float[Tensor, "F 3 3"]) -> Int[Tensor, " S"]:
    """Find the nearest face of each sample; any of them where several are equally near."""
    table = FaceTable.of(triangles)
    if points.device.type == "cpu" and has_numba():
        return _compiled_search(points, table)
    chunk = _CHUNK if points.device.type == "cpu" else _GPU_CHUNK
    return torch.cat([dense_search(part, table) for part in points.split(chunk)])


def dense_search(points: Float[Tensor, "S 3"], table: FaceTable) -> Int[Tensor, " S"]:
    """Search as matrix products: every quantity of the test is linear in (p, 1, |p|^2).

    Positions are relative to the samples' mean, so that single precision is exact to 0.01 mm.
    """
    centre = points.mean(0)
    moved, corners = points - centre, table.corners - centre
    squared = (moved * moved).sum(-1, keepdim=True)
    extended = torch.cat([moved, torch.ones_like(squared), squared], -1)
    along = _affine(extended, table.edges * table.inverse[..., None], corners)  # [3, S, F]
    lengths = (corners * corners).sum(-1, keepdim=True)
    to_corner = extended @ torch.cat([-2 * corners, lengths, torch.ones_like(lengths)], -1).permute(1, 2, 0)
    clamped = along.clamp(0, 1)
    length = 1 / table.inverse.T[:, None]
    nearest = ((clamped - 2 * along) * clamped * length + to_corner).amin(0)
    v, w, height = _affine(extended, table.plane, corners[:, :1].expand(-1, 3, -1))
    is_inside = torch.minimum(torch.minimum(v, w), 1 - v - w) >= 0
    return torch.where(is_inside, height * height, nearest).argmin(1)


def _affine(extended: Tensor, rows: Float[Tensor, "F 3 3"], origin: Float[Tensor, "F 3 3"]) -> Float[Tensor, "3 S F"]:
    """Multiply each face's three rows with the offset p - origin, for every sample and face."""
    offset = -(rows * origin).sum(-1, keepdim=True)
    table = torch.cat([rows, offset, torch.zeros_like(offset)], -1)  # [F, 3, 5]
    return extended @ table.permute(1, 2, 0)


def _compiled_search(points: Tensor, table: FaceTable) -> Tensor:
    """Compile the loop, to run on as many threads as torch uses; it releases Python's lock."""
    arrays = [np.ascontiguousarray(values.numpy()) for values in table]
    parts = np.array_split(np.ascontiguousarray(points.numpy()), torch.get_num_threads())
    search = _compiled()
    with ThreadPoolExecutor(len(parts)) as pool:
        found = list(pool.map(lambda part: search(part, *arrays), parts))
    return torch.as_tensor(np.concatenate(found))


@cache
def _compiled() -> Callable[..., np.ndarray]:
    import numba

    from ...compute.kernels.compiled import disk_cache

    relaxed = {"contract", "reassoc", "nsz"}  # the part of fast maths that does not affect comparisons
    with disk_cache() as has_cache:  # tests wrap functions to check types
        return numba.njit(fastmath=relaxed, nogil=True, cache=has_cache)(unwrap(_search))


def _search(points, corners, edges, inverse, plane):
    """Loop as numba compiles it; the innermost loops run over a block of samples, so that they are vectorised."""
    one, zero = np.float32(1), np.float32(0)
    found = np.zeros(len(points), np.int64)
    block, face = np.zeros((3, _BLOCK), np.float32), np.empty(_BLOCK, np.int32)
    nearest, least = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    x, y, z = block[0], block[1], block[2]
    for start in range(0, len(points), _BLOCK):
        count = min(_BLOCK, len(points) - start)
        block[:, :count] = points[start : start + count].T
        least[:] = _FAR_M2
        for f in range(len(corners)):
            nearest[:] = _FAR_M2
            for k in range(3):
                ax, ay, az = corners[f, k]
                ex, ey, ez = edges[f, k]
                for i in range(_BLOCK):
                    px, py, pz = x[i] - ax, y[i] - ay, z[i] - az
                    t = min(max((px * ex + py * ey + pz * ez) * inverse[f, k], zero), one)
                    px, py, pz = px - t * ex, py - t * ey, pz - t * ez
                    nearest[i] = min(nearest[i], px * px + py * py + pz * pz)
            ax, ay, az = corners[f, 0]
            vx, vy, vz = plane[f, 0]
            wx, wy, wz = plane[f, 1]
            nx, ny, nz = plane[f, 2]
            for i in range(_BLOCK):
                px, py, pz = x[i] - ax, y[i] - ay, z[i] - az
                v, w = px * vx + py * vy + pz * vz, px * wx + py * wy + pz * wz
                height = px * nx + py * ny + pz * nz
                squared = height * height if min(v, w, one - v - w) >= zero else nearest[i]
                is_nearer = squared < least[i]
                least[i] = squared if is_nearer else least[i]
                face[i] = f if is_nearer else face[i]
        found[start : start + count] = face[:count]
    return found
