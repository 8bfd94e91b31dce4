"""Points in space from their places in several pictures: linear triangulation, and one that outliers do not move."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from ...records.camera import Camera

_ROUNDS = 5


def projections(cameras: Sequence[Camera]) -> Float[np.ndarray, "C 3 4"]:
    """Compute the matrices from homogeneous world points, m, to homogeneous px."""
    return np.stack([camera.K @ np.linalg.inv(camera.cam2world)[:3] for camera in cameras])


def projected(
    matrices: Float[np.ndarray, "*#b 3 4"], points: Float[np.ndarray, "*#b N 3"]
) -> tuple[Float[np.ndarray, "... N 2"], Float[np.ndarray, "... N"]]:
    """Project points to px, with their depth (of matrices whose last rows are unit); leading axes broadcast."""
    homogeneous = points @ np.swapaxes(matrices[..., :3], -1, -2) + matrices[..., None, :, 3]
    depth = homogeneous[..., 2]
    return homogeneous[..., :2] / np.where(np.abs(depth) < 1e-9, 1e-9, depth)[..., None], depth


def triangulated(
    matrices: Float[np.ndarray, "*b C 3 4"], px: Float[np.ndarray, "*b C N 2"], weights: Float[np.ndarray, "*b C N"]
) -> Float[np.ndarray, "*b N 3"]:
    """Solve for the points, m, by weighted direct linear transformation.

    Args:
        matrices: of the cameras.
        px: the points in each picture.
        weights: of each; 0 where a point is not known. Two or more of each point must be above 0.
    """
    rows = px[..., None] * matrices[..., None, 2:3, :] - matrices[..., None, :2, :]  # [*b, C, N, 2, 4]
    rows = rows / np.linalg.norm(rows, axis=-1, keepdims=True) * weights[..., None, None]
    rows = np.moveaxis(rows, -4, -3)  # [*b, N, C, 2, 4]
    rows = rows.reshape(*rows.shape[:-3], -1, 4)
    normal = np.swapaxes(rows, -1, -2) @ rows
    last = np.linalg.eigh(normal)[1][..., :, 0]
    scale = np.where(np.abs(last[..., 3:]) < 1e-12, 1e-12, last[..., 3:])
    return last[..., :3] / scale


def consensus_points(
    matrices: Float[np.ndarray, "C 3 4"], px: Float[np.ndarray, "C N 2"], tolerance_px: Float[np.ndarray, " C"]
) -> tuple[Float[np.ndarray, "N 3"], Float[np.ndarray, "C N"]]:
    """Find the points that most views agree on, and how far each view is off, px.

    Of the points of all pairs of views, each landmark's best is where the errors, cut off at the tolerance, are least;
    then it is triangulated anew from the views within the tolerance.

    Args:
        matrices: of two cameras or more.
        px: the points in each picture.
        tolerance_px: of each view, in which a landmark may lie off.
    """
    pairs = np.array(list(combinations(range(len(px)), 2)))
    candidates = triangulated(matrices[pairs], px[pairs], np.ones((*pairs.shape, px.shape[1])))  # [P, N, 3]
    off = np.linalg.norm(projected(matrices[:, None], candidates[None])[0] - px[:, None], axis=-1)
    cost = np.minimum(off / tolerance_px[:, None, None], 1).sum(0)
    points = candidates[cost.argmin(0), np.arange(px.shape[1])]
    for _ in range(_ROUNDS):
        off = errors_px(matrices, points, px)
        is_near = off < tolerance_px[:, None]
        anew = triangulated(matrices, px, is_near.astype(float))
        points = np.where((is_near.sum(0) >= 2)[:, None], anew, points)
    return points, errors_px(matrices, points, px)


def errors_px(
    matrices: Float[np.ndarray, "C 3 4"], points: Float[np.ndarray, "N 3"], px: Float[np.ndarray, "C N 2"]
) -> Float[np.ndarray, "C N"]:
    """Measure how far the points are projected from where they were found."""
    return np.linalg.norm(projected(matrices, points[None])[0] - px, axis=-1)
