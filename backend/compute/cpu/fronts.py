"""The first front face in each pixel, by kernels: as `geometry.rasterise.nearest_fronts`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.outline import front_rows, nearest_of_rows
from ..kernels.records import ProjectedMesh
from .threads import in_parallel


class Fronts(NamedTuple):
    """What an image of P pixels shows of a mesh of M faces.

    Attributes:
        depth: [P] m; infinite for none.
        face: [P] -1 for none.
        rows: [M, 2] the first row of pixels that a front face touches, and the one after the last; equal for none.
    """

    depth: np.ndarray
    face: np.ndarray
    rows: np.ndarray


def find_fronts(mesh: ProjectedMesh, size_px: tuple[int, int]) -> Fronts:
    """The first front faces of a projected mesh."""
    width, height = size_px
    depth, face = np.full(width * height, np.inf, np.float32), np.full(width * height, -1, np.int32)
    rows = np.empty((len(mesh.faces), 2), np.int32)
    in_parallel(lambda first, last: front_rows(mesh, width, height, first, last, rows), len(rows))
    in_parallel(lambda first, last: nearest_of_rows(mesh, rows, width, first, last, depth, face), height)
    return Fronts(depth, face, rows)
