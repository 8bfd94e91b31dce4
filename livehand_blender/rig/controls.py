"""Controls of whole fingers: properties of the hand that add joint angles to the bones' own rotations.

Each control scales a gesture. Per joint, drivers sum the angles of all controls on a hidden bone in the joint's
anatomical frame; the animator's bone copies its rotation before its own. A control at zero adds nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from ...backend.hand.bones import FINGERS, bone_name, control_name, master_name
from ...backend.hand.gestures import Gesture
from ...backend.hand.joint_axes import euler_rad
from ...backend.hand.model import HandModel
from ...backend.hand.poses import POSES
from ...backend.records.side import Side
from .drivers import BoneTurn, drive_by_sliders
from .hand import RiggedHand
from .sliders import FINGER_SLIDERS, write_slider

# Flexion of a curled finger's joints, degrees. It stays when the library's fist changes: saved files' drivers hold it.
_CURLED: dict[str, tuple[float, float, float]] = {
    "index": (74, 89, 64),
    "middle": (77, 92, 61),
    "ring": (68, 89, 66),
    "pinky": (69, 87, 59),
}
# Joint angles at a control's value 1, degrees. Spreading fans fingers out from the middle finger, which itself moves
# towards the thumb.
CONTROLS: dict[str, Gesture] = {
    **{f"{finger}.curl": Gesture({finger: flexion}) for finger, flexion in _CURLED.items()},
    "thumb.curl": Gesture(thumb=((10, 0, 0), (45, 0, 0), (65, 0, 0))),
    "index.spread": Gesture(abduction={"index": 15}),
    "middle.spread": Gesture(abduction={"middle": 10}),
    "ring.spread": Gesture(abduction={"ring": -12}),
    "pinky.spread": Gesture(abduction={"pinky": -20}),
    "thumb.spread": Gesture(thumb=((-25, 0, 0), (0, 0, 0), (0, 0, 0))),
    "fist": POSES["Fist"].gesture,
    "opposition": Gesture(thumb=((30, -12, 24), (5, 0, 0), (5, 0, 0))),
}
CONTROL_CONSTRAINT = "Finger Controls"


def add_controls(armature: bpy.types.Object, model: HandModel) -> None:
    """Drive the control bones, and let the fingers' bones copy them."""
    paths = list(CONTROLS)
    per_unit = np.array([euler_rad(CONTROLS[path].angles_deg(), model.side) for path in paths])  # [C, 15, 3]
    largest = {path: float(angles.flat[np.abs(angles).argmax()]) for path, angles in zip(paths, per_unit, strict=True)}
    for joint in range(1, 16):
        control = armature.pose.bones[control_name(joint, model.side)]
        control.rotation_mode = "YZX"
        for axis in range(3):
            weights = dict(zip(paths, per_unit[:, joint - 1, axis].tolist(), strict=True))
            turns = _turns(weights, largest, model.side)
            drive_by_sliders(control, "rotation_euler", axis, weights, armature, turns)
        _copy_control(armature.pose.bones[bone_name(joint, model.side)], armature, control.name)


def _turns(weights: Mapping[str, float], largest: Mapping[str, float], side: Side) -> dict[BoneTurn, float]:
    """Compute weights of the master bones: a finger curls by its master's turn about X, and spreads by that about Z.

    The joint that moves farthest, by a control's `largest` angle, turns as far as the master. The thumb spreads by
    bending, so its sign is chosen.
    """
    turns = {}
    for finger in FINGERS:
        curl, spread = f"{finger}.curl", f"{finger}.spread"
        outwards = abs(largest[spread]) * (1 if side == "right" else -1) if finger == "thumb" else largest[spread]
        master = master_name(finger, side)
        turns[BoneTurn(master, "X")] = weights[curl] / largest[curl]
        turns[BoneTurn(master, "Z")] = weights[spread] / outwards
    return turns


def has_masters(armature: bpy.types.Object) -> bool:
    """Return whether a hand has its master bones, which a user may have deleted."""
    return all(master_name(finger, armature.livehand.side) in armature.pose.bones for finger in FINGERS)


def clear_controls(hand: RiggedHand) -> None:
    """Set controls, master bones and IK sliders to zero, so that bones alone pose the fingers; their keys remain."""
    for name in ("fist", "opposition", *(f"{finger}.{slider}" for finger in FINGERS for slider in FINGER_SLIDERS)):
        write_slider(hand.armature, name, 0.0)
    if has_masters(hand.armature):
        for finger in FINGERS:
            hand.armature.pose.bones[master_name(finger, hand.side)].rotation_euler = (0, 0, 0)


def _copy_control(bone: bpy.types.PoseBone, armature: bpy.types.Object, control: str) -> None:
    constraint = bone.constraints.new("COPY_ROTATION")
    constraint.name = CONTROL_CONSTRAINT
    constraint.target, constraint.subtarget = armature, control
    constraint.mix_mode = "BEFORE"
    constraint.owner_space, constraint.target_space = "LOCAL", "LOCAL_OWNER_ORIENT"
