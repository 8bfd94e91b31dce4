"""Equals the normals of `surface.ray_hits.ray_hits`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled

_0, _HALF, _1, _TINY = (np.float32(value) for value in (0, 0.5, 1, 1e-12))


@compiled
def fill_normals(mesh, normals, face, pixel, width, first, last, out):
    """Fill out [R, 3] with the unit normals of faces [R] in pixels' centres, for rays [first, last); 0 for face -1.

    `normals` [N, 3] are those of the vertices of `mesh` (`ProjectedMesh`).
    """
    for ray in range(first, last):
        out[ray, 0], out[ray, 1], out[ray, 2] = _0, _0, _0
        if face[ray] < 0:
            continue
        a, b, c = mesh.faces[face[ray], 0], mesh.faces[face[ray], 1], mesh.faces[face[ray], 2]
        x, y = np.float32(pixel[ray] % width) + _HALF, np.float32(pixel[ray] // width) + _HALF
        ax, ay = mesh.positions_px[a, 0], mesh.positions_px[a, 1]
        bx, by = mesh.positions_px[b, 0], mesh.positions_px[b, 1]
        cx, cy = mesh.positions_px[c, 0], mesh.positions_px[c, 1]
        wa = ((cx - bx) * (y - by) - (cy - by) * (x - bx)) / mesh.depth[a]
        wb = ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) / mesh.depth[b]
        wc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / mesh.depth[c]
        squared, weight = _0, _1 / (wa + wb + wc)
        for axis in range(3):
            value = weight * (wa * normals[a, axis] + wb * normals[b, axis] + wc * normals[c, axis])
            out[ray, axis] = value
            squared += value * value
        length = max(np.sqrt(squared), _TINY)
        for axis in range(3):
            out[ray, axis] /= length
