"""A surface in the scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class SurfaceMesh(NamedTuple):
    """The skin's own surface in a pose, finer than the hand's mesh.

    Attributes:
        vertices: [N, 3] m, world.
        faces: [M, 3] into these, counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray
