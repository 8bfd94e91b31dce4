"""The atlas of a hand: where each face lies in the unit square; and the cap of a hand that is open at the wrist."""

from __future__ import annotations

import numpy as np
import trimesh
import xatlas

_RESOLUTION_PX = 1024  # for which the padding is meant
_PADDING_PX = 4
_MM = 1e-3


def unwrap(v_template: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An atlas of a surface: vertices [V, 3] m, faces [F, 3] -> vt [T, 2] in [0, 1], ft [F, 3] into vt.

    Charts do not overlap, and lie at least 4 texels of a 1024 px map apart. Deterministic.
    """
    return unwrap_millimetres(v_template / _MM, f)


def unwrap_millimetres(vertices: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`unwrap` for vertices in mm. xatlas has absolute tolerances, which a hand in metres comes close to."""
    normals = trimesh.Trimesh(vertices, f, process=False).vertex_normals
    atlas = xatlas.Atlas()
    atlas.add_mesh(vertices.astype(np.float32), f.astype(np.uint32), normals.astype(np.float32))
    atlas.generate(_chart_options(), _pack_options())
    _, ft, vt = atlas[0]
    return vt.astype(np.float64), ft.astype(np.int64)


def _chart_options() -> xatlas.ChartOptions:
    options = xatlas.ChartOptions()
    options.max_cost = 8.0  # fewer, larger charts than xatlas' own 2
    options.max_iterations = 4
    return options


def _pack_options() -> xatlas.PackOptions:
    options = xatlas.PackOptions()
    options.resolution = _RESOLUTION_PX
    options.padding = _PADDING_PX
    options.bilinear = True
    return options
