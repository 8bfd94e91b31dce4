"""Somebody's armature over a range of frames -> `SourceMotion`, and our hand laid on it at rest."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError
from ...backend.retarget.rest_alignment import RestAlignment, align
from ...backend.retarget.retarget import SourceMotion
from ...backend.retarget.source_skeleton import JointMap
from .size import present_shape
from .skeleton import read_skeleton


def align_hand(
    hand: bpy.types.Object, model: HandModel, source: bpy.types.Object, joint_map: JointMap, fits_shape: bool
) -> RestAlignment:
    """Our hand on the source's rest pose, of its proportions or of its own present shape and size.

    Raises:
        LiveHandError: a bone is missing, joints lie in one place, or the source is mirrored by a negative scale.
    """
    if np.linalg.det(np.array(source.matrix_world.to_3x3())) <= 0:
        raise LiveHandError(f"{source.name} must not be scaled by negative numbers or zero; apply its scale first")
    return align(read_skeleton(source), joint_map, model, None if fits_shape else present_shape(hand))


def sample_source(
    context: bpy.types.Context, source: bpy.types.Object, joint_map: JointMap, frames: Iterable[int]
) -> SourceMotion:
    """What the mapped bones do in the scene's frames, constraints included; the frame is put back afterwards.

    Raises:
        LiveHandError: a bone is missing, or a pose is not finite.
    """
    scene = context.scene
    before = scene.frame_current_final
    rotations, wrists = [], []
    try:
        for frame in frames:
            scene.frame_set(frame)
            evaluated = source.evaluated_get(context.evaluated_depsgraph_get())
            world = np.array(evaluated.matrix_world, np.float64)
            posed = world @ np.array([_pose_bone(evaluated, bone).matrix for bone in joint_map.bones], np.float64)
            rotations.append(_nearest_rotations(posed[:, :3, :3]))
            wrists.append(posed[0, :3, 3])
    finally:
        scene.frame_set(int(np.floor(before)), subframe=before % 1)
    return SourceMotion(np.array(rotations), np.array(wrists), scene.render.fps / scene.render.fps_base, joint_map.side)


def _pose_bone(armature: bpy.types.Object, name: str) -> bpy.types.PoseBone:
    bone = armature.pose.bones.get(name)
    if bone is None:
        raise LiveHandError(f"the armature must have a bone '{name}', it has none; choose one of its bones")
    return bone


def _nearest_rotations(matrices: np.ndarray) -> np.ndarray:
    """[16, 3, 3] without scale and shear, which chains of scaled bones bring."""
    if not np.isfinite(matrices).all():
        return matrices  # refused where the motion is made
    u, _, vh = np.linalg.svd(matrices)
    return u @ vh
