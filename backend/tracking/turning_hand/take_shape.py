"""One shape for a whole take: the hand's proportions as the picture shows them over all frames.

A camera does not tell a large hand from a near one, and a tracker's landmarks are those of an ordinary hand; so the
prior is strong, and all frames together count as a few.
"""

from __future__ import annotations

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...hand.model import HandModel
from ...motion.landmarks.lifting import Lifting, mediapipe_lifting
from ...motion.landmarks.skeleton import HandSkeleton
from ...motion.landmarks.take_file import FilmedTake
from ...motion.landmarks.take_fit import TakeFit, fit_take, sighted
from ...motion.motion import mirrored
from ...motion.resampling import sampled_at
from ...records.side import Side

_ROUNDS = 2
_COUNTED_FRAMES = 10.0  # what a take says at most, for its frames repeat one another's mistakes


def fit_with_shape(take: FilmedTake, side: Side, model: HandModel, lifting: Lifting = mediapipe_lifting) -> TakeFit:
    """Fit the hand of one side, in turn for its poses and its shape.

    Raises:
        LiveHandError: as `fit_take`.
    """
    beta = np.zeros(10)
    for _ in range(_ROUNDS):
        beta = shape_of(_fit(take, side, model, beta, lifting), take, side, model, lifting)
    return _fit(take, side, model, beta, lifting)


def shape_of(fit: TakeFit, take: FilmedTake, side: Side, model: HandModel, lifting: Lifting) -> np.ndarray:
    """Fit the shape [10] that explains best where the joints are seen, each frame's position and rotation left free."""
    skeleton, motion = HandSkeleton.of(model), fit.motion if side == "right" else mirrored(fit.motion)
    beta = motion.betas[0]
    seen = sighted(take.hands[side], take.times, take.camera, side, skeleton.offsets(beta), lifting)
    motion = sampled_at(motion, (seen.times - fit.start_s) * (motion.fps or 30.0))
    wrists = motion.transl + skeleton.rest[0] + skeleton.shape[0] @ beta
    of_rest, of_beta = skeleton.shape_terms(_rotations(motion.theta))
    arms = of_rest + of_beta @ beta
    nodes = wrists[:, None] + arms
    normal, right = np.eye(10), np.zeros(10)
    share = min(1.0, _COUNTED_FRAMES / max(int(seen.is_seen.sum()), 1))
    for frame in np.flatnonzero(seen.is_seen):
        weight = 1 / seen.lifted.points_sd[frame]
        slope = _slopes(nodes[frame], weight)
        rows = (slope @ of_beta[frame]).reshape(42, 10)
        picture_points = nodes[frame, :, :2] / nodes[frame, :, 2:]
        off = ((seen.lifted.picture_points[frame] - picture_points) * weight[:, None]).reshape(42) + rows @ beta
        basis, _ = np.linalg.qr(np.concatenate([slope, slope @ _turned(arms[frame])], -1).reshape(42, 6))
        rows = rows - basis @ (basis.T @ rows)  # what place and turn cannot do
        normal += share * rows.T @ rows
        right += share * rows.T @ off
    return np.linalg.solve(normal, right)


def _fit(take: FilmedTake, side: Side, model: HandModel, beta: np.ndarray, lifting: Lifting) -> TakeFit:
    return fit_take(take.hands[side], take.times, take.camera, model, side, take.fps, beta, lifting)


def _rotations(theta: np.ndarray) -> np.ndarray:
    """Compute world rotations [T, 5, 4, 3, 3] of the wrist and of each finger's joints."""
    local = axis_angle_to_matrix(theta)
    fingers = []
    for finger in range(5):
        chain = [local[:, 0]]
        for joint in range(3):
            chain.append(chain[-1] @ local[:, 3 * finger + joint + 1])
        fingers.append(np.stack(chain, 1))
    return np.stack(fingers, 1)


def _slopes(nodes: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Compute slopes [21, 2, 3] of the positions in the picture by the nodes [21, 3], weighted [21]."""
    depth = nodes[:, 2]
    slope = np.zeros((len(nodes), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1 / depth
    slope[:, :, 2] = -nodes[:, :2] / depth[:, None] ** 2
    return slope * weight[:, None, None]


def _turned(arms: np.ndarray) -> np.ndarray:
    """Compute the movement [21, 3, 3] of arms [21, 3] by turns about the axes."""
    return np.cross(np.eye(3), arms[:, None], axis=-1).swapaxes(-1, -2)
