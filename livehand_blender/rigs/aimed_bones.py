"""Bones that a rig aims at the next joint: they point as their control does, but do not twist with it.

Rigify makes the first deforming bone of each finger so. The joint's whole rotation is the control's.
"""

from __future__ import annotations

from dataclasses import replace

import bpy

from ...backend.rigs.source_skeleton import JointMap

_AIMS = {"STRETCH_TO", "DAMPED_TRACK", "TRACK_TO", "LOCKED_TRACK"}
_MOST_COPIES = 8  # of a bone of another, as DEF- of ORG- of MCH-
_SAME_PLACE = 0.01  # of a bone's length, by which heads at rest may differ
_PARALLEL = 0.9999  # cosine


def with_twists(armature: bpy.types.Object, joint_map: JointMap) -> JointMap:
    """Replace bones that are aimed by the controls whose twist they lack."""
    bones = list(joint_map.bones)
    for joint, name in enumerate(bones):
        control = _control_of_aimed(armature, name) if name else None
        if control and control not in (*bones, *joint_map.tips, joint_map.forearm):
            bones[joint] = control
    return replace(joint_map, bones=tuple(bones))


def _control_of_aimed(armature: bpy.types.Object, name: str) -> str | None:
    """Name the bone that places an aimed bone and points as it does at rest; None: the bone is not aimed."""
    aimed = armature.pose.bones.get(name)
    for _ in range(_MOST_COPIES):
        copied = aimed and _target(armature, aimed, {"COPY_TRANSFORMS"})
        if not copied:
            break
        aimed = copied
    if aimed is None or _target(armature, aimed, _AIMS) is None:
        return None
    control = _target(armature, aimed, {"COPY_LOCATION"})
    return control.name if control and _is_like(control.bone, armature.data.bones[name]) else None


def _target(armature: bpy.types.Object, bone: bpy.types.PoseBone, kinds: set[str]) -> bpy.types.PoseBone | None:
    """Find the bone of the same rig that a bone's constraint of some kinds goes to."""
    for one in bone.constraints:
        if one.type in kinds and not one.mute and one.influence == 1 and one.target == armature:
            return armature.pose.bones.get(one.subtarget)
    return None


def _is_like(one: bpy.types.Bone, other: bpy.types.Bone) -> bool:
    apart = (one.head_local - other.head_local).length
    along = (one.tail_local - one.head_local).normalized() @ (other.tail_local - other.head_local).normalized()
    return apart < _SAME_PLACE * other.length and along > _PARALLEL
