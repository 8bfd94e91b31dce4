"""Which bones an animator keys to move the bones that deform a hand: themselves, or a generated rig's controls."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import bpy

from ...backend.records.errors import LiveHandError

Arm = Literal["FK", "IK"]
_MECHANISM = re.compile(r"^(?:DEF|ORG|MCH)-")
_LAYER = re.compile(r"^(?:DEF|ORG)-")
_SEGMENT = re.compile(r"\.\d{3}$")
_SIDE = re.compile(r"[._](?:[lrLR])$")


@dataclass(frozen=True)
class Switch:
    """A property of a bone that blends an arm from IK to FK, and its values."""

    bone: str
    name: str
    fk: float
    ik: float

    def value(self, arm: Arm) -> float:
        """Return the property's value for an arm."""
        return self.fk if arm == "FK" else self.ik


def control_of(armature: bpy.types.Object, bone: str) -> str:
    """Name the FK control of a bone: Rigify's and Auto-Rig Pro's, by their names; else the bone itself."""
    stem, side = _parts(bone)
    candidates = (f"{stem}_fk{side}", f"c_{stem}_fk{side}", f"c_{stem}{side}")
    if _LAYER.match(bone):
        candidates = (*candidates, f"{stem}{side}")
    return next((name for name in candidates if name in armature.pose.bones), bone)


def ik_control_of(armature: bpy.types.Object, wrist: str) -> str:
    """Name the control that the wrist of an arm in IK follows.

    Raises:
        LiveHandError: the rig has none by Rigify's or Auto-Rig Pro's names.
    """
    stem, side = _parts(wrist)
    for name in (f"{stem}_ik{side}", f"c_{stem}_ik{side}"):
        if name in armature.pose.bones:
            return name
    raise LiveHandError(
        f"{armature.name} must have an IK control of '{wrist}', such as Rigify's hand_ik.R, it has none; choose FK"
    )


def arm_switch(armature: bpy.types.Object, wrist: str) -> Switch | None:
    """Find the property that switches the wrist's arm between FK and IK; None: there is none."""
    _, side = _parts(wrist)
    for name, prop, fk, ik in (
        (f"upper_arm_parent{side}", "IK_FK", 1.0, 0.0),
        (f"c_hand_ik{side}", "ik_fk_switch", 1.0, 0.0),
    ):
        bone = armature.pose.bones.get(name)
        if bone is not None and prop in bone.keys():
            return Switch(name, prop, fk, ik)
    return None


def is_keyed_by_hand(bone: bpy.types.PoseBone) -> bool:
    """Tell whether a bone is an animator's: not of a generated rig's mechanism, nor moved by constraints."""
    return not _MECHANISM.match(bone.name) and not any(not one.mute and one.influence for one in bone.constraints)


def _parts(bone: str) -> tuple[str, str]:
    """Split a bone's name, without its layer and the number of its segment, into stem and side: `hand`, `.R`."""
    name = _SEGMENT.sub("", _LAYER.sub("", bone))
    side = _SIDE.search(name)
    return (name[: side.start()], side[0]) if side else (name, "")
