"""The shape that a hand model's ten numbers cannot say, of many pictures: offsets along the normals, by outlines.

A vertex at the outline of a picture has its normal in the picture's plane, and is seen to be too far in or out. Many
pictures, each a little off itself, see it so; between them, and where none does, the skin moves with its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.mesh_tables import area_weighted_normals
from ...records.hand_picture import HandPicture
from ...rigs.model_transfer.registration import Smoothness, smoothed
from ..lit_model.model import PersonModel
from .pose_targets import PoseTargets

_OFF_MM = 1.5  # of a picture's pose: distances beyond it count less
_SMOOTHNESS = Smoothness(stiffness=30.0, decay=0.5)
_ARM_WEIGHT = 20.0  # by which the forearm, whose sleeve or bend is not known, keeps the model's shape
_STEP_M = 1e-3
_MOST_MM = 4.0


def outline_offsets(model: PersonModel, pictures: Sequence[HandPicture], targets: Sequence[PoseTargets]) -> np.ndarray:
    """Fit the offsets [V], m, along the normals to the outlines of all pictures that are not held out.

    Args:
        model: with the offsets so far, from which `targets` were found.
        pictures: in the poses that were fitted to the targets.
        targets: of each picture.
    """
    weight = _ARM_WEIGHT * np.asarray(model.hand.arm_weights, float)
    pull = np.zeros_like(weight)
    for picture, target in zip(pictures, targets, strict=True):
        if picture.is_held_out:
            continue
        vertex, along, off_mm = _off(model, picture, target)
        trust = 1 / np.sqrt(1 + (off_mm / _OFF_MM) ** 2)
        np.add.at(weight, vertex, trust * along**2)
        np.add.at(pull, vertex, trust * along * (off_mm + along * 1000 * model.offset_m[vertex]))
    wanted_mm = pull / np.maximum(weight, 1e-9)
    return smoothed(model.hand, wanted_mm, weight, _SMOOTHNESS).clip(-_MOST_MM, _MOST_MM) / 1000


def _off(model: PersonModel, picture: HandPicture, target: PoseTargets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which vertices lie at the outline, how far a mm of offset moves each across it, and how far it should."""
    outline, camera = target.outline, picture.camera
    vertices = model.vertices(picture.pose)
    moved = vertices + _STEP_M * area_weighted_normals(vertices, model.hand.f)
    (px, depth_m), (moved_px, _) = (camera.project(points[outline.vertex]) for points in (vertices, moved))
    px_per_mm = np.abs(camera.K[0, 0]) / depth_m / 1000
    along = ((moved_px - px) * outline.normal).sum(1) / px_per_mm
    return outline.vertex, along, ((outline.px - px) * outline.normal).sum(1) / px_per_mm
