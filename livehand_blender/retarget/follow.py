"""Our hand follows another armature live, by plain constraints: no handler, no Python, whatever file the other is in.

Three sets of hidden bones, one of each per joint, outside the hand's own hierarchy:

- `SRC-` has the other bone's rotation in the world (the wrist's has its place too).
- `FIT-` is its child. Its rest frame holds what differs between both rest poses, so it stands as our joint should.
- `FOL-` hang together as our joints do and take `FIT-`'s rotation: so their own rotations are ours to copy.

The hand's bones copy those before finger controls, limits and fingertip IK, which go on to work on top;
`livehand.follow` is by how much.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np

from ...backend.hand.bones import bone_name
from ...backend.hand.model import PARENTS, HandModel
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import Side
from ...backend.retarget.rest_alignment import RestAlignment
from ...backend.retarget.source_skeleton import JointMap
from ..rig.armature import rest_frames
from ..rig.drivers import drive_by_properties
from ..rig.pose import hand_side, read_hand_pose, write_theta, write_transl
from .size import take_shape
from .source import align_hand

FOLLOW, FOLLOW_PLACE = "Follow Other Rig", "Follow Other Rig's Wrist"
_SOURCE, _FITTED, _FOLLOWING = "SRC", "FIT", "FOL"
_LENGTH_M = 0.01


def follow(
    context: bpy.types.Context,
    hand: bpy.types.Object,
    model: HandModel,
    source: bpy.types.Object,
    joint_map: JointMap,
    fits_shape: bool = True,
) -> None:
    """Let a hand follow another armature from now on; what it followed before is let go.

    Raises:
        LiveHandError: the hand is the other side's or its armature cannot be edited, or a bone is missing. Nothing is
            changed then.
    """
    side = hand_side(hand)
    if joint_map.side != side:
        raise LiveHandError(
            f"{hand.name} is a {side} hand and can follow a {side} one only, got the {joint_map.side}; "
            "bake it instead, which mirrors"
        )
    check_editable(context, hand)
    alignment = align_hand(hand, model, source, joint_map, fits_shape)
    if is_following(hand):
        _remove(context, hand)
    if fits_shape:
        take_shape(context, hand, alignment.shape)
    _add_bones(context, hand, alignment)
    _constrain(hand, source, joint_map)
    hand.livehand.follow = 1.0
    hand.update_tag()


def is_following(hand: bpy.types.Object) -> bool:
    """Whether it follows another armature."""
    return _name(_FOLLOWING, 0, hand.livehand.side) in hand.data.bones


def stop_following(context: bpy.types.Context, hand: bpy.types.Object, keeps_pose: bool = True) -> None:
    """Remove everything that `follow` added; the shape stays.

    Args:
        context: its view layer shows the hand.
        hand: our armature.
        keeps_pose: the bones are turned as they are seen now; False: back to what they were before.

    Raises:
        LiveHandError: the armature cannot be edited.
    """
    check_editable(context, hand)
    pose = read_hand_pose(hand, context.evaluated_depsgraph_get())
    _remove(context, hand)
    if keeps_pose:
        write_theta(hand, pose.theta)
        write_transl(hand, pose.transl)
    hand.update_tag()


def _name(role: str, joint: int, side: Side) -> str:
    return f"{role}-{bone_name(joint, side)}"


def _names(side: Side) -> Iterator[str]:
    for role in (_SOURCE, _FITTED, _FOLLOWING):
        for joint in range(16):
            yield _name(role, joint, side)


def check_editable(context: bpy.types.Context, hand: bpy.types.Object) -> None:
    """Whether bones can be added to a hand, or taken from it.

    Raises:
        LiveHandError: it is linked, or hidden.
    """
    if hand.library or hand.override_library or hand.data.library or hand.data.override_library:
        raise LiveHandError(f"{hand.name} must be local to this file to get new bones, it is linked; bake instead")
    if hand.name not in context.view_layer.objects or not hand.visible_get(view_layer=context.view_layer):
        raise LiveHandError(f"{hand.name} must be visible in the view layer to get new bones; show it first")


def _add_bones(context: bpy.types.Context, hand: bpy.types.Object, alignment: RestAlignment) -> None:
    side: Side = hand.livehand.side
    frames = rest_frames(hand, side)
    heads = np.array([hand.data.bones[bone_name(joint, side)].head_local for joint in range(16)], np.float64)
    # What the other bones see of our joints, at rest.
    fitted = alignment.frames.swapaxes(1, 2) @ alignment.rotations @ frames
    step_m = alignment.frames[0].T @ (alignment.wrist - alignment.heads[0]) / np.mean(hand.matrix_world.to_scale())
    with _editing(context, hand) as bones:
        for joint in range(16):
            _add_bone(bones, _name(_SOURCE, joint, side), None, heads[joint], np.eye(3))
            head = heads[joint] + (step_m if joint == 0 else 0)
            _add_bone(bones, _name(_FITTED, joint, side), _name(_SOURCE, joint, side), head, fitted[joint])
            above = _name(_FOLLOWING, PARENTS[joint], side) if joint else None
            _add_bone(bones, _name(_FOLLOWING, joint, side), above, heads[joint], frames[joint])
    hidden = hand.data.collections_all.get("Mechanism") or hand.data.collections.new("Mechanism")
    for name in _names(side):
        hand.data.bones[name].use_deform = False
        hidden.assign(hand.data.bones[name])
        hand.pose.bones[name].rotation_mode = "QUATERNION"


class _editing:
    """Within, the edit bones of an armature; modes, selection and the active object come back."""

    def __init__(self, context: bpy.types.Context, armature: bpy.types.Object):
        self.context, self.armature = context, armature

    def __enter__(self):
        objects = self.context.view_layer.objects
        self.active = objects.active
        self.mode = self.active.mode if self.active else "OBJECT"
        if self.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        self.selected = [thing for thing in objects if thing.select_get(view_layer=self.context.view_layer)]
        # All selected armatures would be edited.
        for thing in self.selected:
            thing.select_set(False)
        objects.active = self.armature
        bpy.ops.object.mode_set(mode="EDIT")
        return self.armature.data.edit_bones

    def __exit__(self, *_):
        bpy.ops.object.mode_set(mode="OBJECT")
        for thing in self.selected:
            thing.select_set(True)
        self.context.view_layer.objects.active = self.active
        if self.mode != "OBJECT":
            bpy.ops.object.mode_set(mode=self.mode)


def _add_bone(bones, name: str, parent: str | None, head: np.ndarray, frame: np.ndarray) -> None:
    bone = bones.new(name)
    bone.head, bone.tail = head, head + _LENGTH_M * frame[:, 1]
    bone.align_roll(frame[:, 2])
    bone.parent = bones[parent] if parent else None


def _constrain(hand: bpy.types.Object, source: bpy.types.Object, joint_map: JointMap) -> None:
    side: Side = hand.livehand.side
    bones = hand.pose.bones
    for joint, bone in enumerate(joint_map.bones):
        _copy(bones[_name(_SOURCE, joint, side)], "COPY_ROTATION", source, bone, "WORLD")
        fitted, following = _name(_FITTED, joint, side), _name(_FOLLOWING, joint, side)
        _copy(bones[following], "COPY_ROTATION", hand, fitted, "POSE")
        own = bones[bone_name(joint, side)]
        constraint = _copy(own, "COPY_ROTATION", hand, following, "LOCAL")
        _make_first(own, constraint, FOLLOW)
        drive_by_properties(constraint, "influence", -1, {"follow": 1.0}, hand)
    _copy(bones[_name(_SOURCE, 0, side)], "COPY_LOCATION", source, joint_map.bones[0], "WORLD")
    wrist = bones[bone_name(0, side)]
    constraint = _copy(wrist, "COPY_LOCATION", hand, _name(_FITTED, 0, side), "POSE")
    _make_first(wrist, constraint, FOLLOW_PLACE)
    drive_by_properties(constraint, "influence", -1, {"follow": 1.0}, hand)


def _copy(
    owner: bpy.types.PoseBone, kind: str, target: bpy.types.Object, bone: str, space: str
) -> bpy.types.Constraint:
    constraint = owner.constraints.new(kind)
    constraint.target, constraint.subtarget = target, bone
    constraint.owner_space = constraint.target_space = space
    return constraint


def _make_first(owner: bpy.types.PoseBone, constraint: bpy.types.Constraint, name: str) -> None:
    constraint.name = name
    owner.constraints.move(len(owner.constraints) - 1, 0)


def _remove(context: bpy.types.Context, hand: bpy.types.Object) -> None:
    side: Side = hand.livehand.side
    for joint in range(16):
        owner = hand.pose.bones[bone_name(joint, side)]
        for name in (FOLLOW, FOLLOW_PLACE):
            if name in owner.constraints:
                owner.constraints[name].driver_remove("influence")
                owner.constraints.remove(owner.constraints[name])
    with _editing(context, hand) as bones:
        for name in _names(side):
            if name in bones:
                bones.remove(bones[name])
