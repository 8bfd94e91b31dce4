"""The texture atlas of a hand: the position of each face in the unit square."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..records.errors import LiveHandError
from .cap import flat_cap

if TYPE_CHECKING:
    import xatlas

_RESOLUTION_PX = 1024  # that the padding refers to
_PADDING_PX = 4
_MM = 1e-3
_CELLS = 128  # per side of the grid that finds free space: 8 texels each at 1024 px
_MARGIN = 1  # cells between a cap's chart and its neighbours
_LEAST_CELLS = 4  # per side of the free square


def unwrap(v_template: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make an atlas of a surface: vt [T, 2] in [0, 1] and ft [F, 3] from vertices [V, 3] m and faces [F, 3].

    Charts do not overlap and are at least 4 texels of a 1024 px map apart; some are mirrored. Deterministic.
    """
    return unwrap_millimetres(v_template / _MM, f)


def unwrap_millimetres(vertices: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unwrap vertices in mm: the absolute tolerances of xatlas are too large for a hand in metres."""
    # Imported here because a hand with its own atlas, as the built-in one, loads without these packages.
    try:
        import trimesh
        import xatlas
    except ImportError as error:
        raise LiveHandError(
            f"a hand without an atlas (vt, ft) needs trimesh and xatlas, one is missing ({error}); "
            "install them with pip, or give a hand model with an atlas"
        ) from error
    normals = trimesh.Trimesh(vertices, f, process=False).vertex_normals
    atlas = xatlas.Atlas()
    atlas.add_mesh(vertices.astype(np.float32), f.astype(np.uint32), normals.astype(np.float32))
    atlas.generate(_chart_options(), _pack_options())
    _, ft, vt = atlas[0]
    return vt.astype(np.float64), ft.astype(np.int64)


def with_cap_chart(
    vt: np.ndarray, ft: np.ndarray, v_template: np.ndarray, f: np.ndarray, cap: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Add a chart for the faces `cap` [C, 3] in free space of a hand's own atlas.

    vt [T, 2] and ft [F, 3] come first, unchanged, so that textures for the file still fit. The chart has the atlas'
    mean scale, or a smaller one if the free space requires it.

    Raises:
        LiveHandError: the atlas has no free square of 4 x 4 cells of a 128 x 128 grid.
    """
    row, column, size = _largest_free_square(_occupied_cells(vt, ft))
    if size < _LEAST_CELLS:
        raise LiveHandError(
            "the hand's atlas must have free space for the cap of its open wrist, got none; "
            "leave out vt and ft, so that a new atlas is made"
        )
    points, faces = flat_cap(v_template, cap)
    room = (size - 2 * _MARGIN) / _CELLS
    scale = min(_mean_scale(vt, ft, v_template, f), room / points.max())
    corner = (np.array([column, row]) + _MARGIN) / _CELLS
    return np.concatenate([vt, corner + points * scale]), np.concatenate([ft, faces + len(vt)])


def _mean_scale(vt: np.ndarray, ft: np.ndarray, v_template: np.ndarray, f: np.ndarray) -> float:
    """Measure atlas units per metre."""
    in_atlas, in_space = (_doubled_area(points, faces) for points, faces in ((vt, ft), (v_template, f)))
    return float(np.sqrt(in_atlas / in_space))


def _doubled_area(points: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    cross = np.cross(b - a, c - a)
    return float(np.abs(cross).sum() if cross.ndim == 1 else np.linalg.norm(cross, axis=1).sum())


def _occupied_cells(vt: np.ndarray, ft: np.ndarray) -> np.ndarray:
    """Return [128, 128] bool, row by v and column by u: cells that a face covers, sampled at half a cell."""
    occupied = np.zeros((_CELLS, _CELLS), dtype=bool)
    for corners in vt[ft] * _CELLS:
        steps = 2 * int(np.ceil(np.ptp(corners, axis=0).max())) + 1
        first, second = np.meshgrid(*[np.linspace(0, 1, steps + 1)] * 2)
        a, b = first[first + second <= 1 + 1e-9], second[first + second <= 1 + 1e-9]
        samples = corners[0] + a[:, None] * (corners[1] - corners[0]) + b[:, None] * (corners[2] - corners[0])
        column, row = np.clip(samples.astype(int), 0, _CELLS - 1).T
        occupied[row, column] = True
    return occupied


def _largest_free_square(occupied: np.ndarray) -> tuple[int, int, int]:
    """Find first row, first column and size of the largest square of free cells; size 0 if there is none."""
    total = np.pad(occupied.astype(int).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    for size in range(len(occupied), 0, -1):
        taken = total[size:, size:] - total[:-size, size:] - total[size:, :-size] + total[:-size, :-size]
        free = np.argwhere(taken == 0)
        if len(free):
            return int(free[0, 0]), int(free[0, 1]), size
    return 0, 0, 0


def _chart_options() -> xatlas.ChartOptions:
    import xatlas

    options = xatlas.ChartOptions()
    options.max_cost = 8.0  # fewer, larger charts than xatlas' own 2
    options.max_iterations = 4
    return options


def _pack_options() -> xatlas.PackOptions:
    import xatlas

    options = xatlas.PackOptions()
    options.resolution = _RESOLUTION_PX
    options.padding = _PADDING_PX
    options.bilinear = True
    return options
