"""The truth of a film of one hand from two sides: triangulated points whose bones keep their lengths.

Each frame's triangulation alone lets a bone grow and shrink by millimetres from frame to frame. A hand's bones do not,
so that points are moved until lengths are constant and both pictures still show them where the tracker found them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from ...backend.capture.masks.mask import load_opencv
from ...backend.person.rig.triangulation import projected, triangulated

CHAINS = np.array([[0, *range(first, first + 4)] for first in range(1, 21, 4)])
"""Landmarks [5, 5] of the fingers, each from the wrist to the tip."""
_BONES = np.stack([CHAINS[:, :-1], CHAINS[:, 1:]], -1).reshape(-1, 2)
_SPANS = np.array([[5, 9], [9, 13], [13, 17], [5, 17], [5, 13], [9, 17], [1, 5], [1, 17]])  # of the palm
_LINKS = np.concatenate([_BONES, _SPANS])
_LINK_ENDS = np.eye(21)[_LINKS[:, 0]] - np.eye(21)[_LINKS[:, 1]]
_LINK_M = np.concatenate([np.full(len(_BONES), 0.001), np.full(len(_SPANS), 0.003)])  # a palm is only nearly rigid
_PALM = 0, 9  # wrist and the middle finger's knuckle
_NOISE_PX = 3.0  # of the tracker's points
_ROBUST_PX = 9.0  # off, where a point has half its weight
_STEP_M = 0.01  # deviation of a step, which damps it
_STEPS = 10  # for given lengths
_TURNS = 8  # of points and lengths; the last one moves no length by a tenth of a millimetre
_SMOOTH_FRAMES = 1.5


class CalibratedLens(NamedTuple):
    """A calibrated camera: K, OpenCV's distortion, and world to camera [3, 4]."""

    K: np.ndarray
    distortion: np.ndarray
    world2cam: np.ndarray


class Path3D(NamedTuple):
    """Landmarks of a hand in MediaPipe's order: points [T, 21, 3], m, and the frames [T] of the film."""

    points: np.ndarray
    frames: np.ndarray


class StereoTruth(NamedTuple):
    """What two cameras tell of a hand: triangulated, and with bones of constant length.

    Both are smoothed over time after that, which lets the bones of a hand that moves fast vary again, by a millimetre.
    """

    plain: Path3D
    constant: Path3D


def stereo_truth(
    found: Sequence[tuple[np.ndarray, np.ndarray]], lenses: Sequence[CalibratedLens], like: Path3D
) -> StereoTruth:
    """Triangulate what both films show, in the world of the lenses, in metres by the palm's length of a fit.

    Args:
        found: the joints [T, 21, 2] px in each film, and the frames [T] that show them.
        lenses: of the films; their world has any unit.
        like: the fit that has the hand's size.
    """
    frames = np.intersect1d(found[0][1], found[1][1])
    flat = np.stack(
        [straightened(px[np.isin(rows, frames)], lens) for (px, rows), lens in zip(found, lenses, strict=True)], 1
    )
    points = _triangulated(flat, lenses)
    metres = _palm(like.points) / _palm(points)
    lenses = [lens._replace(world2cam=lens.world2cam * [1, 1, 1, metres]) for lens in lenses]
    plain = points * metres
    constant = with_constant_bones(plain, flat, lenses)
    return StereoTruth(*(Path3D(gaussian_filter1d(each, _SMOOTH_FRAMES, axis=0), frames) for each in (plain, constant)))


def straightened(px: Float[np.ndarray, "T N 2"], lens: CalibratedLens) -> Float[np.ndarray, "T N 2"]:
    """Take a lens' distortion and intrinsics from points: where they lie at depth 1."""
    cv2 = load_opencv()
    flat = cv2.undistortPoints(px.reshape(-1, 1, 2), lens.K, lens.distortion)
    return np.asarray(flat).reshape(px.shape)


def _triangulated(flat: np.ndarray, lenses: Sequence[CalibratedLens]) -> np.ndarray:
    matrices = np.stack([lens.world2cam for lens in lenses])
    return triangulated(np.broadcast_to(matrices, (len(flat), *matrices.shape)), flat, np.ones(flat.shape[:-1]))


def _palm(points: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(points[:, _PALM[0]] - points[:, _PALM[1]], axis=-1)))


def with_constant_bones(
    points: Float[np.ndarray, "T 21 3"], flat: Float[np.ndarray, "T C 21 2"], lenses: Sequence[CalibratedLens]
) -> Float[np.ndarray, "T 21 3"]:
    """Move triangulated points until bones have their median lengths, near to where the pictures show them.

    Lengths and points are found in turns, since noise biases the lengths of triangulated bones.

    Args:
        points: of the hand, m, in the world of the lenses.
        flat: where each camera shows them, straightened.
        lenses: C, whose world is in metres.
    """
    for _ in range(_TURNS):
        lengths = np.median(np.linalg.norm(_LINK_ENDS @ points, axis=-1), axis=0)
        for _ in range(_STEPS):
            points = points - _step(points, flat, lenses, lengths)
    return points


def _step(
    points: np.ndarray, flat: np.ndarray, lenses: Sequence[CalibratedLens], lengths: np.ndarray
) -> Float[np.ndarray, "T 21 3"]:
    """Solve each frame for a damped step of Gauss and Newton, towards its pictures and the lengths of its links."""
    slope, normal = _towards_pictures(points, flat, lenses)
    slope_of_lengths, normal_of_lengths = _towards_lengths(points, lengths)
    normal = normal + normal_of_lengths + np.eye(63) / _STEP_M**2
    return np.linalg.solve(normal, (slope + slope_of_lengths)[..., None]).reshape(points.shape)


def _towards_pictures(
    points: np.ndarray, flat: np.ndarray, lenses: Sequence[CalibratedLens]
) -> tuple[Float[np.ndarray, "T 63"], Float[np.ndarray, "T 63 63"]]:
    """Compute slope and normal matrix of the errors in the pictures, with weights that make them robust (Cauchy)."""
    focal = np.array([[lens.K[0, 0], lens.K[1, 1]] for lens in lenses])[:, None]  # [C, 1, 2] px
    matrices = np.stack([lens.world2cam for lens in lenses])
    turns = matrices[:, None, :, :3]
    shown, depth = projected(matrices, points[:, None])
    off = focal * (shown - flat)
    slopes = focal[..., None] * (turns[:, :, :2] - shown[..., None] * turns[:, :, 2:]) / depth[..., None, None]
    weights = 1 / _NOISE_PX**2 / (1 + (off**2).sum(-1) / _ROBUST_PX**2)
    normal = np.zeros((len(points), 21, 3, 21, 3))
    each = np.arange(21)
    normal[:, each, :, each] = np.einsum("tcn,tcnax,tcnay->ntxy", weights, slopes, slopes)
    slope = np.einsum("tcn,tcnax,tcna->tnx", weights, slopes, off)
    return slope.reshape(-1, 63), normal.reshape(-1, 63, 63)


def _towards_lengths(
    points: np.ndarray, lengths: np.ndarray
) -> tuple[Float[np.ndarray, "T 63"], Float[np.ndarray, "T 63 63"]]:
    """Compute slope and normal matrix of the errors of links' lengths.

    A link that is too long resists turning, too; without that, points would swing to and fro past their best.
    """
    links = _LINK_ENDS @ points
    long = np.linalg.norm(links, axis=-1, keepdims=True)
    slopes = (_LINK_ENDS[..., None] * (links / long)[:, :, None]).reshape(len(points), -1, 63)
    weighted = slopes.swapaxes(1, 2) / _LINK_M**2
    across = (1 - lengths[:, None] / long).clip(0)  # as a share of the stiffness along the link
    turning = (_LINK_ENDS.T / _LINK_M**2) @ (_LINK_ENDS * across)
    normal = weighted @ (slopes * (1 - across)) + np.kron(turning, np.eye(3))
    return (weighted @ (long - lengths[:, None]))[..., 0], normal
