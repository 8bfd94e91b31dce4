"""Sequences of theta and transl -> keyframes, in bulk: seconds where single insertions take minutes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import bpy
import mathutils
import numpy as np

from ...backend.geometry.rotation import axis_angle_to_matrix, continuous
from ...backend.hand.bones import FINGERS, finger_joints, master_name
from ...backend.records.errors import LiveHandError
from .carrier import Carrier
from .controls import clear_controls, has_masters
from .hand import RiggedHand
from .pose import bone_quaternions
from .sliders import FINGER_SLIDERS, slider_path

ROTATION_CHANNELS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}  # else Euler
# What a keyframe holds: numbers of each channel, and their type.
_KEY_CHANNELS = {
    **dict.fromkeys(("co", "handle_left", "handle_right"), (2, np.float32)),
    **dict.fromkeys(("amplitude", "back", "period"), (1, np.float32)),
    **dict.fromkeys(("interpolation", "easing", "type", "handle_left_type", "handle_right_type"), (1, np.int32)),
}


def keyframe_theta(
    hand: RiggedHand,
    thetas: np.ndarray,
    frames: Sequence[float] | np.ndarray,
    joints: Sequence[int] = range(16),
    forearms: np.ndarray | None = None,
) -> None:
    """Key bones with thetas [T, 16, 3], rad, at increasing frames [T]; keys between first and last are replaced.

    Only the bones of `joints` are keyed, in quaternion mode. Neighbouring quaternions have the same sign, so that
    bones take the short way between keys. Finger controls and IK sliders are set to zero; if they have keys of their
    own, those still add to these.

    With joint 0, the forearm of a hand that has one is keyed too: with forearms [T, 3], rad, as `HandPose` has them, or
    straight; and its location, so that the wrist stays where it is in each of the frames.

    Raises:
        LiveHandError: shapes disagree, a number is not finite, the frames do not increase, or the hand is linked.
    """
    frames = _check(hand, frames, thetas, (16, 3), "thetas")
    forearms = np.zeros((len(frames), 3)) if forearms is None else forearms
    _check(hand, frames, forearms, (3,), "forearms")
    clear_controls(hand)
    turns_arm = hand.forearm is not None and 0 in joints
    transls = _present_transls(hand, frames) if turns_arm else None
    quaternions = continuous(bone_quaternions(hand, thetas, forearms))  # [T, 16 or 17, 4]
    for number in (*joints, 16) if turns_arm else joints:
        bone = hand.bones[number]
        bone.rotation_mode = "QUATERNION"
        key_channels(hand.armature, bone, "rotation_quaternion", frames, quaternions[:, number])
    if transls is not None:
        keyframe_transl(hand, transls, frames)


def keyframe_transl(hand: RiggedHand, transls: np.ndarray, frames: Sequence[float] | np.ndarray) -> None:
    """Key the location of the bone that carries the hand with transls [T, 3], m in armature space, at frames [T].

    A forearm's location depends on its rotation: key that first, by `keyframe_theta`, in the same frames.

    Raises:
        LiveHandError: as `keyframe_theta`.
    """
    frames = _check(hand, frames, transls, (3,), "transls")
    carrier = Carrier.of(hand)
    locations = carrier.locations(transls, _present_rotations(hand.armature, carrier, frames))
    key_channels(hand.armature, carrier.bone, "location", frames, locations)


def key_finger(hand: RiggedHand, finger: str, frame: float) -> None:
    """Key a finger's present pose: its bones' rotations, its target and its controls."""
    for path, group in finger_channels(hand, finger):
        hand.armature.keyframe_insert(path, frame=frame, group=group)


def key_hand(hand: RiggedHand, frame: float) -> None:
    """Key a hand's present pose: all its `hand_channels`."""
    for path, group in hand_channels(hand):
        hand.armature.keyframe_insert(path, frame=frame, group=group)


def finger_channels(hand: RiggedHand, finger: str) -> Iterator[tuple[str, str]]:
    """Yield (data path, group) of each channel of a finger that an animator keys."""
    for joint in finger_joints(finger):
        yield _rotation_channel(hand.bone(joint))
    target = hand.target(finger)
    yield target.path_from_id("location"), target.name
    if has_masters(hand.armature):
        yield _rotation_channel(hand.armature.pose.bones[master_name(finger, hand.side)])
    for slider in FINGER_SLIDERS:
        yield slider_path(f"{finger}.{slider}"), finger.title()


def hand_channels(hand: RiggedHand) -> Iterator[tuple[str, str]]:
    """Yield (data path, group) of each channel of a hand's pose that an animator keys."""
    carrier = Carrier.of(hand).bone
    yield carrier.path_from_id("location"), carrier.name
    for bone in dict.fromkeys((carrier, hand.bone(0))):
        yield _rotation_channel(bone)
    for control in ("fist", "opposition"):
        yield slider_path(control), "Hand"
    for finger in FINGERS:
        yield from finger_channels(hand, finger)


def _rotation_channel(bone: bpy.types.PoseBone) -> tuple[str, str]:
    return bone.path_from_id(ROTATION_CHANNELS.get(bone.rotation_mode, "rotation_euler")), bone.name


def _present_transls(hand: RiggedHand, frames: np.ndarray) -> np.ndarray:
    """Compute [T, 3] m that the keys and channels of the bone that carries the hand move it by in frames [T]."""
    carrier = Carrier.of(hand)
    locations = _present_values(hand.armature, carrier.bone, "location", frames)
    return carrier.transls(locations, _present_rotations(hand.armature, carrier, frames))


def _present_rotations(armature: bpy.types.Object, carrier: Carrier, frames: np.ndarray) -> np.ndarray:
    """Compute rotations [T, 3, 3] of that bone in armature space in frames [T]."""
    mode = carrier.bone.rotation_mode
    values = _present_values(armature, carrier.bone, ROTATION_CHANNELS.get(mode, "rotation_euler"), frames)
    match mode:
        case "QUATERNION":
            own = np.array([mathutils.Quaternion(value).normalized().to_matrix() for value in values])
        case "AXIS_ANGLE":
            lengths = np.maximum(np.linalg.norm(values[:, 1:], axis=1, keepdims=True), 1e-12)
            own = axis_angle_to_matrix(values[:, :1] * values[:, 1:] / lengths)
        case order:
            own = np.array([mathutils.Euler(value, order).to_matrix() for value in values])
    return carrier.frame @ own @ carrier.frame.T


def _present_values(
    armature: bpy.types.Object, bone: bpy.types.PoseBone, channel: str, frames: np.ndarray
) -> np.ndarray:
    """Evaluate an array property [T, n] of a bone in frames [T], by its curves, or as it is where it has none."""
    values = np.tile(np.array(getattr(bone, channel), np.float64), (len(frames), 1))
    path = bone.path_from_id(channel)
    for curve in _curves(armature):
        if curve.data_path == path and not curve.is_empty:
            values[:, curve.array_index] = [curve.evaluate(frame) for frame in frames]
    return values


def _check(hand: RiggedHand, frames, values: np.ndarray, shape: tuple[int, ...], name: str) -> np.ndarray:
    if hand.armature.library is not None:
        raise LiveHandError(
            f"{hand.armature.name} must be local to this file, or a library override, to get keys; it is linked, and "
            "they would not be saved: choose Object > Library Override > Make"
        )
    frames = np.asarray(frames, np.float64)
    if frames.ndim != 1 or len(frames) == 0 or np.shape(values) != (len(frames), *shape):
        wanted = [len(frames) if frames.ndim else "T", *shape]
        raise LiveHandError(f"{name} must be {wanted}, one per frame, got {list(np.shape(values))}")
    if not (np.isfinite(frames).all() and np.isfinite(values).all()):
        raise LiveHandError(f"{name} and frames must be finite, got NaN or infinity")
    if (np.diff(frames) <= 0).any():
        raise LiveHandError("frames must increase, got a repeated or an earlier frame")
    return frames


def key_channels(
    armature: bpy.types.Object, bone: bpy.types.PoseBone, channel: str, frames: np.ndarray, values: np.ndarray
) -> None:
    """Key values [T, n] for the n channels of one array property of a bone, at increasing frames [T]."""
    path = bone.path_from_id(channel)
    for index in range(values.shape[1]):
        curve = _ensure_curve(armature, path, index, bone.name)
        _set_keys(curve, frames, values[:, index])


def key_values(owner: bpy.types.ID, path: str, group: str, frames: np.ndarray, values: np.ndarray) -> None:
    """Key values [T] of a property of a data-block, by its path, at increasing frames [T]."""
    _set_keys(_ensure_curve(owner, path, 0, group), frames, values)


def _ensure_curve(owner: bpy.types.ID, path: str, index: int, group: str) -> bpy.types.FCurve:
    animation = owner.animation_data or owner.animation_data_create()
    if animation.action is None:
        animation.action = bpy.data.actions.new(f"{owner.name} Action")
    elif animation.action.library is not None:  # keys in it would not be saved
        animation.action = animation.action.copy()
    action = animation.action
    if not hasattr(action, "slots"):  # Blender 4.2 and 4.3
        return action.fcurves.find(path, index=index) or action.fcurves.new(path, index=index, action_group=group)
    curve = action.fcurve_ensure_for_datablock(owner, path, index=index)
    if curve.group is None:
        groups = action.layers[0].strips[0].channelbag(animation.action_slot).groups
        curve.group = groups.get(group) or groups.new(group)
    return curve


def _curves(armature: bpy.types.Object) -> Iterable[bpy.types.FCurve]:
    """Return the curves that animate an armature."""
    animation = armature.animation_data
    action = animation.action if animation else None
    if action is None:
        return ()
    if not hasattr(action, "slots"):  # Blender 4.2 and 4.3
        return action.fcurves
    strips = [strip for layer in action.layers for strip in layer.strips]
    bags = [strip.channelbag(animation.action_slot) for strip in strips if animation.action_slot]
    return [curve for bag in bags if bag for curve in bag.fcurves]


def _set_keys(curve: bpy.types.FCurve, frames: np.ndarray, values: np.ndarray) -> None:
    """Replace the keys from the first frame to the last; those outside stay as they are."""
    points = curve.keyframe_points
    old = {name: _read_keys(points, name) for name in _KEY_CHANNELS}
    times = old["co"][:, 0]
    before, after = (times < frames[0]).nonzero()[0], (times > frames[-1]).nonzero()[0]
    points.clear()
    points.add(len(before) + len(frames) + len(after))
    for name, channel in old.items():
        new = _read_keys(points, name)
        middle = new[len(before) : len(before) + len(frames)]
        if name == "co":
            middle[:] = np.stack([frames, values], -1)
        points.foreach_set(name, np.concatenate([channel[before], middle, channel[after]]).ravel())
    curve.update()


def _read_keys(points: bpy.types.FCurveKeyframePoints, name: str) -> np.ndarray:
    """Read [K, n] of a channel of `_KEY_CHANNELS`."""
    width, kind = _KEY_CHANNELS[name]
    flat = np.empty(width * len(points), kind)
    points.foreach_get(name, flat)
    return flat.reshape(-1, width)
