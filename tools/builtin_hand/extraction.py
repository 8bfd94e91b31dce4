"""Extracts a triangle mesh of the hand: marching cubes in a narrow band, then Taubin smoothing. Build frame, mm."""

from __future__ import annotations

import numpy as np
import trimesh

from ...backend.teacher.dependencies import needs
from ...backend.teacher.frames import swap_distal
from ...backend.teacher.meshes import outward
from ...backend.teacher.rays import Ray
from ...backend.teacher.sdf import BOUNDS, signed_distance

with needs("scipy"):
    from scipy.ndimage import map_coordinates

_COARSE = 4.0  # mm: spacing of the grid that finds the band
_BAND = 4.0  # mm: where the interpolated coarse distance is smaller, the fine grid is evaluated


def extract_mesh(rays: dict[str, Ray], spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Extract vertices [N, 3] and outward faces [M, 3] of the hand without details, closed, at a `spacing` mm grid."""
    points, faces = _march(_band_volume(rays, spacing), spacing)
    mesh = trimesh.Trimesh(swap_distal(points), faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    mesh = max(mesh.split(only_watertight=False), key=lambda part: len(part.faces))
    trimesh.smoothing.filter_taubin(mesh, 0.5, 0.53, 8)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    return vertices, outward(vertices, faces)


def _band_volume(rays: dict[str, Ray], spacing: float) -> np.ndarray:
    """Compute [X, Y, Z] distances: exact within the band, interpolated outside it, where only the sign matters."""
    low, high = BOUNDS
    coarse_axes = [np.arange(low[i], high[i] + _COARSE, _COARSE) for i in range(3)]
    grid = np.stack(np.meshgrid(*coarse_axes, indexing="ij"), -1)
    coarse = signed_distance(rays, grid.reshape(-1, 3), with_details=False).reshape(grid.shape[:3])
    axes = [np.arange(low[i], high[i], spacing) for i in range(3)]
    positions = np.meshgrid(*[(axis - low[i]) / _COARSE for i, axis in enumerate(axes)], indexing="ij")
    volume = map_coordinates(coarse, positions, order=1).astype(np.float32)
    band = np.abs(volume) < _BAND
    index = np.argwhere(band)
    points = np.stack([axes[i][index[:, i]] for i in range(3)], 1)
    volume[band] = signed_distance(rays, points, with_details=False)
    return volume


def _march(volume: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    with needs("scikit-image"):
        from skimage.measure import marching_cubes
    points, faces, _, _ = marching_cubes(volume, 0.0, spacing=(spacing,) * 3)
    return points + BOUNDS[0], faces
