"""Equals `field.rays.project`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled


@compiled
def project_vertices(vertices, K, world2cam, first, last, positions_px, depth):
    """Fill positions_px [V, 2] and depth [V], m, of vertices [first, last) before a camera, in double precision."""
    k, to_camera = K.astype(np.float64), world2cam.astype(np.float64)
    for index in range(first, last):
        row = np.uintp(index)
        x, y, z = np.float64(vertices[row, 0]), np.float64(vertices[row, 1]), np.float64(vertices[row, 2])
        right = to_camera[0, 0] * x + to_camera[0, 1] * y + to_camera[0, 2] * z + to_camera[0, 3]
        down = to_camera[1, 0] * x + to_camera[1, 1] * y + to_camera[1, 2] * z + to_camera[1, 3]
        ahead = to_camera[2, 0] * x + to_camera[2, 1] * y + to_camera[2, 2] * z + to_camera[2, 3]
        scale = k[2, 0] * right + k[2, 1] * down + k[2, 2] * ahead
        positions_px[row, 0] = (k[0, 0] * right + k[0, 1] * down + k[0, 2] * ahead) / scale
        positions_px[row, 1] = (k[1, 0] * right + k[1, 1] * down + k[1, 2] * ahead) / scale
        depth[row] = ahead
