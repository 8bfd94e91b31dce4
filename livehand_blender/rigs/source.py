"""Another armature -> `SourceSkeleton`; over a range of frames -> `SourceMotion`; and our hand aligned to it at rest.

A hand's size in the world is its object's scale.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError
from ...backend.rigs.rest_alignment import RestAlignment, align, source_ends, source_nodes
from ...backend.rigs.retarget import SourceMotion
from ...backend.rigs.shape_fit import HandShape
from ...backend.rigs.source_skeleton import JointMap, SourceSkeleton
from ..motion.frames import current_frame_restored, frame_rate
from ..rig.hand import RiggedHand
from ..rig.sliders import read_beta, write_slider


@dataclass(frozen=True, eq=False)
class SourceRig:
    """A hand of another armature.

    Attributes:
        armature: its object.
        joint_map: which of its bones are the hand's joints.
    """

    armature: bpy.types.Object
    joint_map: JointMap


def align_hand(hand: RiggedHand, source: SourceRig, fits_shape: bool) -> RestAlignment:
    """Align our hand to the source's rest pose, with the source's proportions or with its own present shape and size.

    Raises:
        LiveHandError: a bone is missing, joints coincide, or the source has a negative scale.
    """
    if np.linalg.det(np.array(source.armature.matrix_world.to_3x3())) <= 0:
        raise LiveHandError(
            f"{source.armature.name} must not be scaled by negative numbers or zero; apply its scale first"
        )
    shape = None if fits_shape else current_shape(hand)
    return align(read_skeleton(source.armature), source.joint_map, hand.model, shape)


def current_shape(hand: RiggedHand) -> HandShape:
    """Read a hand's present shape and size."""
    scale = float(np.mean(hand.armature.matrix_world.to_scale()))
    return HandShape(read_beta(hand.armature), scale)


def set_shape(context: bpy.types.Context, hand: RiggedHand, shape: HandShape) -> None:
    """Give a hand a shape and a size; its object's location is unchanged."""
    armature = hand.armature
    armature.scale = [axis * shape.scale / current_shape(hand).scale for axis in armature.scale]
    write_slider(armature, "beta", shape.beta)
    armature.update_tag()
    context.view_layer.update()


def sample_source(context: bpy.types.Context, source: SourceRig, frames: Iterable[float]) -> SourceMotion:
    """Sample the motion of the mapped bones in frames of the scene, or between them, with constraints.

    Raises:
        LiveHandError: a bone is missing, or a pose is not finite.
    """
    scene = context.scene
    rotations, nodes, ends, forearms = [], [], [], []
    with current_frame_restored(scene):
        for frame in frames:
            scene.frame_set(int(np.floor(frame)), subframe=frame % 1)
            evaluated = source.armature.evaluated_get(context.evaluated_depsgraph_get())
            posed = posed_skeleton(evaluated, source.joint_map)
            rotations.append(posed.frames[[posed.index(name) for name in source.joint_map.drivers]])
            nodes.append(source_nodes(posed, source.joint_map))
            ends.append(source_ends(posed, source.joint_map))
            if source.joint_map.forearm:
                forearms.append(posed.frames[posed.index(source.joint_map.forearm)])
    positions = np.array(nodes)
    rate, side = frame_rate(scene), source.joint_map.side
    arms = np.array(forearms) if forearms else None
    return SourceMotion(np.array(rotations), positions[:, 0], rate, side, positions, np.array(ends), arms)


def posed_skeleton(evaluated: bpy.types.Object, joint_map: JointMap) -> SourceSkeleton:
    """Read the mapped bones of an evaluated armature in the world, without their hierarchy.

    Raises:
        LiveHandError: a bone is missing.
    """
    names = joint_map.named
    bones = [_pose_bone(evaluated, name) for name in names]
    world = np.array(evaluated.matrix_world, np.float64)
    posed = world @ np.array([bone.matrix for bone in bones], np.float64)
    tails = np.array([bone.tail for bone in bones], np.float64) @ world[:3, :3].T + world[:3, 3]
    return SourceSkeleton(names, (-1,) * len(names), posed[:, :3, 3], tails, _nearest_rotations(posed[:, :3, :3]))


def _pose_bone(armature: bpy.types.Object, name: str) -> bpy.types.PoseBone:
    bone = armature.pose.bones.get(name)
    if bone is None:
        raise LiveHandError(f"the armature must have a bone '{name}', it has none; choose one of its bones")
    return bone


def _nearest_rotations(matrices: np.ndarray) -> np.ndarray:
    """Compute [16, 3, 3] without the scale and shear that chains of scaled bones produce."""
    if not np.isfinite(matrices).all():
        return matrices  # `SourceMotion` raises the error
    u, _, vh = np.linalg.svd(matrices)
    return u @ vh


def read_skeleton(armature: bpy.types.Object) -> SourceSkeleton:
    """Read the rest pose of an armature's bones in the world, by the object's present transform with its scale."""
    roots = [bone for bone in armature.data.bones if bone.parent is None]
    bones = [bone for root in roots for bone in (root, *root.children_recursive)]  # parents first
    index = {bone.name: number for number, bone in enumerate(bones)}
    world = np.array(armature.matrix_world, np.float64)
    rest = world @ np.array([bone.matrix_local for bone in bones], np.float64).reshape(-1, 4, 4)
    tails = np.array([bone.tail_local for bone in bones], np.float64).reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
    return SourceSkeleton(
        names=tuple(index),
        parents=tuple(index[bone.parent.name] if bone.parent else -1 for bone in bones),
        heads=rest[:, :3, 3],
        tails=tails,
        frames=rest[:, :3, :3] / np.linalg.norm(rest[:, :3, :3], axis=1, keepdims=True),
    )
