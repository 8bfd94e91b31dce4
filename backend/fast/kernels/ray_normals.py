"""Equals `nerf.ray_normals.ray_normals`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .compiled import compiled_part as part

_0, _1 = np.float32(0), np.float32(1)


@compiled
def fill_normals(mesh, normals, image, pixel, depth, edge_m, first, last, out):
    """Fill out [R, 3] for rays [first, last) of `depth` [R], m.

    `normals` [N, 3] are those of the vertices of `mesh` (`ProjectedMesh`), `image` the face in each pixel, its depth
    and the width of the full-size image.
    """
    face_at, depth_at, width = image
    for ray in range(first, last):
        x, y = 2 * (pixel[ray] % (width // 2)), 2 * (pixel[ray] // (width // 2))
        out[ray, 0], out[ray, 1], out[ray, 2] = _0, _0, _0
        face, least = -1, edge_m
        for k in range(4):
            at = (y + k // 2) * width + x + k % 2
            gap = abs(depth_at[at] - depth[ray])
            if face_at[at] >= 0 and gap < least:
                face, least = face_at[at], gap
        if face >= 0:
            _blend_normal(mesh, normals, face, np.float32(x + 1), np.float32(y + 1), out[ray])


@part
def _blend_normal(mesh, normals, face, x, y, out):
    """Fill out [3] with the unit normal of a face at a place in the image."""
    a, b, c = mesh.faces[face, 0], mesh.faces[face, 1], mesh.faces[face, 2]
    ax, ay, bx, by = mesh.positions_px[a, 0], mesh.positions_px[a, 1], mesh.positions_px[b, 0], mesh.positions_px[b, 1]
    cx, cy = mesh.positions_px[c, 0], mesh.positions_px[c, 1]
    wa = ((cx - bx) * (y - by) - (cy - by) * (x - bx)) / mesh.depth[a]
    wb = ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) / mesh.depth[b]
    wc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / mesh.depth[c]
    weight = _1 / (wa + wb + wc)
    for axis in range(3):
        out[axis] = weight * (wa * normals[a, axis] + wb * normals[b, axis] + wc * normals[c, axis])
    length = _1 / np.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for axis in range(3):
        out[axis] *= length
