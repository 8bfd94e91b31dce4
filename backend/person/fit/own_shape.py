"""The shape that a hand model's ten numbers cannot say: offsets of the skin along its normals, by outlines.

A vertex that many pictures show at their outline, and always on the same side of the masks', lies too deep or too high.
Neighbours move together, since one picture's outline is as wrong as its pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import spsolve

from ...hand.lbs import posed_vertices
from ...hand.model import HandModel
from ...records.hand_picture import HandPicture
from ..lit_model.model import PersonModel
from .pose_targets import PoseTargets

_NOISE_MM = 2.0  # of an outline, of which most is its pose's
_ALIKE = 2.0  # vertices along an outline that miss by the same
_ROUGH_MM, _LARGE_MM = 0.15, 15.0  # of an offset: from its neighbours' mean, and at all
_ARM_MM = 0.1
_LEAST_ACROSS = 0.5  # of a normal, across the line of sight
_ROUNDS = 6


class _Misses(NamedTuple):
    """Of K vertices at outlines: which, how far masks lie from the bare model, and per mm of offset."""

    vertex: np.ndarray
    missed_mm: np.ndarray
    per_mm: np.ndarray


def own_offsets(model: PersonModel, pictures: Sequence[HandPicture], targets: Sequence[PoseTargets]) -> np.ndarray:
    """Find the offsets [V] m of the mesh along its posed normals that bring outlines nearest; the arm's are about 0.

    Args:
        model: of the hand.
        pictures: with their poses.
        targets: of each picture.
    """
    shown = [pair for pair in zip(pictures, targets, strict=True) if not pair[0].is_held_out]
    misses = [_misses(model, picture, target) for picture, target in shown]
    vertex, missed_mm, per_mm = (np.concatenate(each) for each in zip(*misses, strict=True))
    prior, count = _prior(model.hand), len(model.hand.v_template)
    offset_mm = np.zeros(count)
    for _ in range(_ROUNDS):
        off = (missed_mm - per_mm * offset_mm[vertex]) / _NOISE_MM
        trust = 1 / np.sqrt(1 + off**2) / (_ALIKE * _NOISE_MM**2)
        curve = np.bincount(vertex, trust * per_mm**2, count)
        pull = np.bincount(vertex, trust * per_mm * missed_mm, count)
        offset_mm = np.asarray(spsolve((prior + scipy.sparse.diags(curve)).tocsc(), pull))
    return offset_mm / 1000


def _misses(model: PersonModel, picture: HandPicture, target: PoseTargets) -> _Misses:
    outline, pose, camera = target.outline, picture.pose, picture.camera
    bare = posed_vertices(model.hand, pose)[outline.vertex]
    raised = bare + model.normals(pose)[outline.vertex] / 1000
    (px, depth), (raised_px, _) = camera.project(bare), camera.project(raised)
    px_per_mm = camera.K[0, 0] / depth / 1000
    missed_mm = (((outline.px - px) * outline.normal).sum(1) + outline.inside_px) / px_per_mm
    per_mm = ((raised_px - px) * outline.normal).sum(1) / px_per_mm
    kept = np.abs(per_mm) > _LEAST_ACROSS
    return _Misses(outline.vertex[kept], missed_mm[kept], per_mm[kept])


def _prior(hand: HandModel) -> scipy.sparse.csr_matrix:
    """Build [V, V]: offsets are like their neighbours', and small, above all the arm's."""
    rough = neighbours_mean(hand) - scipy.sparse.identity(len(hand.v_template))
    small = 1 / np.where(hand.arm_weights > 0.5, _ARM_MM, _LARGE_MM) ** 2
    return (rough.T @ rough / _ROUGH_MM**2 + scipy.sparse.diags(small)).tocsr()


def neighbours_mean(hand: HandModel) -> scipy.sparse.csr_matrix:
    """Build [V, V], which takes the mean of each vertex's neighbours."""
    count = len(hand.v_template)
    first, second = np.concatenate([hand.f[:, [0, 1]], hand.f[:, [1, 2]], hand.f[:, [2, 0]]]).T
    touches = scipy.sparse.coo_matrix((np.ones(len(first)), (first, second)), (count, count)).tocsr()
    touches = ((touches + touches.T) > 0).astype(float)
    return scipy.sparse.diags(1 / np.asarray(touches.sum(1)).ravel()) @ touches
