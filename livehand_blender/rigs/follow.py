"""Our hand follows another armature live by constraints, without handlers or Python; the armature may be linked.

Three sets of hidden bones, one bone per joint and for a forearm, outside the hand's own hierarchy:

- `SRC-` copies the other bone's rotation in the world (for the wrist, its location too).
- `FIT-` is its child. Its rest frame holds the difference between both rest poses, so it is oriented like our joint.
- `FOL-` have the hierarchy of our joints and copy `FIT-`'s rotation, so that their local rotations are ours.

A forearm turns with the rig's, or else with its wrist; its `SRC-` is where the wrist's `FIT-` is, so it ends there.

The hand's bones copy those before finger controls, limits and fingertip IK, which still work on top.
The slider `follow` is the influence.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import bpy
import numpy as np

from ...backend.hand.bones import bone_name
from ...backend.hand.model import PARENTS
from ...backend.records.errors import LiveHandError
from ...backend.rigs.doubts import sampled_doubts
from ...backend.rigs.natural_range import is_natural, rest_pose
from ...backend.rigs.rest_alignment import RestAlignment, align
from ...backend.rigs.retarget import retarget
from ..hands.followed_skin import SOURCE_ROLE
from ..rig.armature import rest_frames
from ..rig.carrier import Carrier
from ..rig.drivers import drive_by_sliders
from ..rig.hand import RiggedHand
from ..rig.pose import read_pose, write_theta, write_transl
from ..rig.sliders import write_slider
from .source import SourceRig, align_hand, posed_skeleton, sample_source, set_shape

FOLLOW, FOLLOW_PLACE = "Follow Other Rig", "Follow Other Rig's Wrist"
_SOURCE, _FITTED, _FOLLOWING = SOURCE_ROLE, "FIT", "FOL"
_LENGTH_M = 0.01
_SAMPLES = 9  # of the scene's frames, besides the present one


def follow(context: bpy.types.Context, hand: RiggedHand, source: SourceRig, fits_shape: bool = True) -> str | None:
    """Make a hand follow another armature, instead of the one that it followed before.

    A rest pose that no hand can have is replaced by the present pose. Returns what speaks against the result, in some
    of the scene's frames; None: nothing.

    Raises:
        LiveHandError: the source is a hand of the other side, the hand's armature cannot be edited, or a bone is
            missing. Nothing is changed then.
    """
    if source.joint_map.side != hand.side:
        raise LiveHandError(
            f"{hand.armature.name} is a {hand.side} hand and can follow a {hand.side} one only, got a "
            f"{source.joint_map.side} one; bake it instead, which mirrors"
        )
    check_editable(context, hand)
    alignment = align_hand(hand, source, fits_shape)
    if not is_natural(alignment.model, rest_pose(alignment)):
        alignment = natural_alignment(context, source, alignment)
    sampled = sample_source(context, source, _frames_here_and_there(context.scene))
    doubt = sampled_doubts(alignment, retarget(replace(sampled, nodes=None), alignment))
    if is_following(hand.armature):
        _remove(context, hand)
    if fits_shape:
        set_shape(context, hand, alignment.shape)
    _add_bones(context, hand, alignment)
    _constrain(hand, source, alignment)
    write_slider(hand.armature, "follow", 1.0)
    hand.armature.update_tag()
    return doubt


def _frames_here_and_there(scene: bpy.types.Scene) -> list[int]:
    """List the present frame and some of the scene's, in order."""
    spread = np.linspace(scene.frame_start, scene.frame_end, _SAMPLES).round().astype(int)
    return sorted({scene.frame_current, *spread.tolist()})


def natural_alignment(context: bpy.types.Context, source: SourceRig, alignment: RestAlignment) -> RestAlignment:
    """Return the alignment with the source's present pose, if a hand can have that; else the given one."""
    evaluated = source.armature.evaluated_get(context.evaluated_depsgraph_get())
    posed = posed_skeleton(evaluated, source.joint_map)
    present = align(posed, source.joint_map, alignment.model, alignment.shape)
    return present if is_natural(present.model, rest_pose(present)) else alignment


def is_following(armature: bpy.types.Object) -> bool:
    """Return whether a hand's armature follows another armature."""
    return _name(_FOLLOWING, bone_name(0, armature.livehand.side)) in armature.data.bones


def stop_following(context: bpy.types.Context, hand: RiggedHand, keeps_pose: bool = True) -> None:
    """Remove everything that `follow` added; the shape is kept.

    Args:
        context: its view layer shows the hand.
        hand: that follows.
        keeps_pose: keep the present pose; False: return to the bones' own pose.

    Raises:
        LiveHandError: the armature cannot be edited.
    """
    check_editable(context, hand)
    pose = read_pose(hand, context.evaluated_depsgraph_get())
    _remove(context, hand)
    if keeps_pose:
        write_theta(hand, pose.theta, pose.forearm)
        write_transl(hand, pose.transl)
    hand.armature.update_tag()


def check_editable(context: bpy.types.Context, hand: RiggedHand) -> None:
    """Check that bones can be added to a hand and removed.

    Raises:
        LiveHandError: it is linked, or hidden.
    """
    armature = hand.armature
    if armature.library or armature.override_library or armature.data.library or armature.data.override_library:
        raise LiveHandError(f"{armature.name} must be local to this file to get new bones, it is linked; bake instead")
    if armature.name not in context.view_layer.objects or not armature.visible_get(view_layer=context.view_layer):
        raise LiveHandError(f"{armature.name} must be visible in the view layer to get new bones; show it first")


def _name(role: str, bone: str) -> str:
    return f"{role}-{bone}"


def _names(hand: RiggedHand) -> list[str]:
    return [_name(role, bone.name) for role in (_SOURCE, _FITTED, _FOLLOWING) for bone in hand.bones]


def _add_bones(context: bpy.types.Context, hand: RiggedHand, alignment: RestAlignment) -> None:
    side, armature = hand.side, hand.armature
    names = [bone.name for bone in hand.bones[:16]]
    frames = rest_frames(armature, side)
    heads = np.array([hand.bone(joint).bone.head_local for joint in range(16)], np.float64)
    # Rest frames of our joints relative to the source's bones.
    fitted = alignment.frames.swapaxes(1, 2) @ alignment.rotations @ frames
    wrist_m = alignment.frames[0].T @ (alignment.wrist - alignment.heads[0]) / np.mean(armature.matrix_world.to_scale())
    arm = Carrier.of(hand) if hand.forearm is not None else None
    with _edit_bones(context, armature) as bones:
        if arm is not None:
            _add_forearm(bones, arm, heads[0], alignment)
        for joint, name in enumerate(names):
            _add_bone(bones, _name(_SOURCE, name), None, heads[joint], np.eye(3))
            head = heads[joint] + (wrist_m if joint == 0 else 0)
            _add_bone(bones, _name(_FITTED, name), _name(_SOURCE, name), head, fitted[joint])
            above = names[PARENTS[joint]] if joint else arm and arm.bone.name
            parent = above and _name(_FOLLOWING, above)
            _add_bone(bones, _name(_FOLLOWING, name), parent, heads[joint], frames[joint])
    hidden = armature.data.collections_all.get("Mechanism") or armature.data.collections.new("Mechanism")
    for name in _names(hand):
        armature.data.bones[name].use_deform = False
        hidden.assign(armature.data.bones[name])
        armature.pose.bones[name].rotation_mode = "QUATERNION"


def _add_forearm(bones, arm: Carrier, wrist: np.ndarray, alignment: RestAlignment) -> None:
    """Add the forearm's bones: the head of `FIT-` is where the forearm begins that ends at `SRC-`, the wrist [3]."""
    rotation, frame = alignment.forearm[:2] if alignment.forearm else (alignment.rotations[0], alignment.frames[0])
    turn, name = frame.T @ rotation, arm.bone.name
    _add_bone(bones, _name(_SOURCE, name), None, wrist, np.eye(3))
    _add_bone(bones, _name(_FITTED, name), _name(_SOURCE, name), wrist - turn @ arm.reach, turn @ arm.frame)
    _add_bone(bones, _name(_FOLLOWING, name), None, wrist - arm.reach, arm.frame)


@contextlib.contextmanager
def _edit_bones(context: bpy.types.Context, armature: bpy.types.Object) -> Iterator[bpy.types.ArmatureEditBones]:
    """Yield the edit bones of an armature; afterwards modes, selection and the active object are as before."""
    objects = context.view_layer.objects
    active = objects.active
    mode = active.mode if active else "OBJECT"
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    selected = [thing for thing in objects if thing.select_get(view_layer=context.view_layer)]
    for thing in selected:  # edit mode would include all selected armatures
        thing.select_set(False)
    objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        yield armature.data.edit_bones
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
        for thing in selected:
            thing.select_set(True)
        objects.active = active
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def _add_bone(bones, name: str, parent: str | None, head: np.ndarray, frame: np.ndarray) -> None:
    bone = bones.new(name)
    bone.head, bone.tail = head, head + _LENGTH_M * frame[:, 1]
    bone.align_roll(frame[:, 2])
    bone.parent = bones[parent] if parent else None


def _constrain(hand: RiggedHand, source: SourceRig, alignment: RestAlignment) -> None:
    armature, bones = hand.armature, hand.armature.pose.bones
    wrist, drivers = hand.bone(0).name, source.joint_map.drivers
    of_arm = (alignment.forearm and source.joint_map.forearm) or drivers[0]
    for bone, driver in zip(hand.bones, (*drivers, of_arm), strict=False):
        following = _name(_FOLLOWING, bone.name)
        _copy(bones[_name(_SOURCE, bone.name)], "COPY_ROTATION", source.armature, driver, "WORLD")
        _copy(bones[following], "COPY_ROTATION", armature, _name(_FITTED, bone.name), "POSE")
        _follow_first(hand, bone, _copy(bone, "COPY_ROTATION", armature, following, "LOCAL"), FOLLOW)
    _copy(bones[_name(_SOURCE, wrist)], "COPY_LOCATION", source.armature, drivers[0], "WORLD")
    carrier = Carrier.of(hand).bone
    if carrier.name != wrist:
        _copy(bones[_name(_SOURCE, carrier.name)], "COPY_LOCATION", armature, _name(_FITTED, wrist), "POSE")
    constraint = _copy(carrier, "COPY_LOCATION", armature, _name(_FITTED, carrier.name), "POSE")
    _follow_first(hand, carrier, constraint, FOLLOW_PLACE)


def _copy(
    owner: bpy.types.PoseBone, kind: str, target: bpy.types.Object, bone: str, space: str
) -> bpy.types.Constraint:
    constraint = owner.constraints.new(kind)
    constraint.target, constraint.subtarget = target, bone
    constraint.owner_space = constraint.target_space = space
    return constraint


def _follow_first(hand: RiggedHand, bone: bpy.types.PoseBone, constraint: bpy.types.Constraint, name: str) -> None:
    """Put a bone's new constraint before all others, with `follow` as its influence."""
    constraint.name = name
    constraints = bone.constraints
    constraints.move(len(constraints) - 1, 0)
    drive_by_sliders(constraint, "influence", -1, {"follow": 1.0}, hand.armature)


def _remove(context: bpy.types.Context, hand: RiggedHand) -> None:
    for bone in hand.bones:
        constraints = bone.constraints
        for name in (FOLLOW, FOLLOW_PLACE):
            if name in constraints:
                constraints[name].driver_remove("influence")
                constraints.remove(constraints[name])
    with _edit_bones(context, hand.armature) as bones:
        for name in _names(hand):
            if name in bones:
                bones.remove(bones[name])
