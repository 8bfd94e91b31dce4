"""Conversions between the frames of this folder (see its docstring) and the template's."""

from __future__ import annotations

import numpy as np

# The anatomical and the build frame differ by the sign of the first axis; the swap is its own inverse.
_SWAP = np.array([-1.0, 1.0, 1.0])

# From the build frame to the template's, mm: the wrist joint is where MANO has it.
_TEMPLATE_OFFSET = np.array([95.0, 0.0, 0.0])
_MM = 1e-3


def swap_distal(vectors: np.ndarray) -> np.ndarray:
    """Turn points or directions [..., 3] from the anatomical to the build frame or back."""
    return vectors * _SWAP


def build_to_template(points: np.ndarray) -> np.ndarray:
    """Convert the build frame [..., 3] mm to the template's [..., 3] m."""
    return (points + _TEMPLATE_OFFSET) * _MM


def template_to_build(points_m: np.ndarray) -> np.ndarray:
    """Convert the template [..., 3] m to the build frame [..., 3] mm."""
    return points_m / _MM - _TEMPLATE_OFFSET
