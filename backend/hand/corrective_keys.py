"""Factors pose correctives into few shape keys: displacements [V, 3] m times a linear form of (R - I) of one joint.

MANO adds posedirs [V, 3, 135] times the row-major entries of R - I of joints 1..15. Each joint's nine columns are
factored by SVD, and components that move nothing are dropped. At most nine keys per joint remain; one if the model has
a single bulge per joint.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_NEGLIGIBLE_M = 1e-7  # components that move no vertex by more are dropped
_LARGEST_FEATURE = 8**0.5  # largest Frobenius norm of R - I


class Corrective(NamedTuple):
    """One shape key: displacement [V, 3] m at value 1, and form [3, 3] with value = sum(form * (R_joint - I))."""

    joint: int
    displacement: np.ndarray
    form: np.ndarray


def factor_correctives(posedirs: np.ndarray) -> list[Corrective]:
    """Factor out the components of posedirs [V, 3, 135] that can move a vertex; values stay within +-sqrt(8)."""
    return [part for joint in range(1, 16) for part in _of_joint(joint, posedirs[..., 9 * (joint - 1) : 9 * joint])]


def _of_joint(joint: int, columns: np.ndarray) -> list[Corrective]:
    left, scale, forms = np.linalg.svd(columns.reshape(-1, 9), full_matrices=False)
    displacements = (left * scale).T.reshape(9, -1, 3)
    reach = np.linalg.norm(displacements, axis=-1).max(-1) * _LARGEST_FEATURE
    return [Corrective(joint, displacements[k], forms[k].reshape(3, 3)) for k in range(9) if reach[k] > _NEGLIGIBLE_M]


def quaternion_form(form: np.ndarray, frame: np.ndarray) -> dict[str, float]:
    """Rewrite the same linear form in products of the bone's own unit quaternion (w, x, y, z).

    Args:
        form: [3, 3], applied to R - I in the model's frame.
        frame: [3, 3] rest orientation B of the bone, where R = B basis B^T.

    Returns:
        Coefficient by product ("x*x", "w*z", ...): the weighted sum of products equals sum(form * (R - I)). There is no
        constant term, so no cancellation near rest.
    """
    c = frame.T @ form @ frame
    return {
        "x*x": -2 * (c[1, 1] + c[2, 2]),
        "y*y": -2 * (c[0, 0] + c[2, 2]),
        "z*z": -2 * (c[0, 0] + c[1, 1]),
        "x*y": 2 * (c[0, 1] + c[1, 0]),
        "x*z": 2 * (c[0, 2] + c[2, 0]),
        "y*z": 2 * (c[1, 2] + c[2, 1]),
        "w*x": 2 * (c[2, 1] - c[1, 2]),
        "w*y": 2 * (c[0, 2] - c[2, 0]),
        "w*z": 2 * (c[1, 0] - c[0, 1]),
    }
