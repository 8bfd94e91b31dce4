"""Characters as other programs name and build them, made from `other_rigs.py`; the numbers are our own.

Bones are in MANO's order of joints, then the forearm; {s}, {S} and {Side} are a side.
"""

from typing import NamedTuple

import bpy

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")


class Character(NamedTuple):
    """How a program's hands differ.

    `bones`: the joints' and the forearm's. `metacarpals` and `tips`: theirs, in MANO's order of fingers; none: the
    character has no such bones. `mode`: how bones turn. `seed`: of shape, rolls and place.
    """

    bones: tuple
    metacarpals: tuple = ()
    tips: tuple = ()
    mode: str = "QUATERNION"
    seed: int = 4


def _hand(wrist, joint, forearm, fingers=_FINGERS):
    """The names of a hand; `joint` has {f} for the finger and {k} for the phalanx."""
    joints = (joint.replace("{f}", finger).replace("{k}", str(k)) for finger in fingers for k in (1, 2, 3))
    return (wrist, *joints, forearm)


def _each(pattern, fingers=_FINGERS):
    return tuple(pattern.replace("{f}", finger) for finger in fingers)


_CAPITALS = ("Index", "Middle", "Pinky", "Ring", "Thumb")
_MID = ("Index", "Mid", "Pinky", "Ring", "Thumb")
_BIPED = ("1", "2", "4", "3", "0")
CHARACTERS = {
    "WebXR": None,
    "Mixamo": Character(
        _hand("mixamorig:{Side}Hand", "mixamorig:{Side}Hand{f}{k}", "mixamorig:{Side}ForeArm", _CAPITALS),
        tips=_each("mixamorig:{Side}Hand{f}4", _CAPITALS),
        seed=5,
    ),
    "Unreal": Character(
        _hand("hand_{s}", "{f}_0{k}_{s}", "lowerarm_{s}"), _each("{f}_metacarpal_{s}", _FINGERS[:4]), seed=6
    ),
    "VRM": Character(
        _hand(
            "J_Bip_{S}_Hand",
            "J_Bip_{S}_{f}{k}",
            "J_Bip_{S}_LowerArm",
            ("Index", "Middle", "Little", "Ring", "Thumb"),
        ),
        seed=7,
    ),
    "MPFB": Character(
        _hand("wrist.{S}", "finger{f}-{k}.{S}", "lowerarm02.{S}", "23541"),
        tuple(f"metacarpal{number}.{{S}}" for number in (1, 2, 4, 3)),
        seed=8,
    ),
    "Auto-Rig Pro": Character(_hand("hand.{s}", "{f}{k}.{s}", "forearm.{s}"), mode="XYZ", seed=9),
    "Daz Genesis": Character(
        _hand("{s}Hand", "{s}{f}{k}", "{s}ForearmBend", _MID),
        tuple(f"{{s}}Carpal{number}" for number in (1, 2, 4, 3)),
        mode="XZY",
        seed=10,
    ),
    "Character Creator": Character(
        _hand(
            "CC_Base_{S}_Hand", "CC_Base_{S}_{f}{k}", "CC_Base_{S}_Forearm", ("Index", "Mid", "Pinky", "Ring", "Thumb")
        ),
        seed=11,
    ),
    "3ds Max Biped": Character(
        (
            "Bip001 {S} Hand",
            *(f"Bip001 {{S}} Finger{finger}{link}" for finger in _BIPED for link in ("", "1", "2")),
            "Bip001 {S} Forearm",
        ),
        tips=_each("Bip001 {S} Finger{f}Nub", _BIPED),
        mode="AXIS_ANGLE",
        seed=12,
    ),
}


def make_character(other_rigs, side, kind):
    """The armature of a character."""
    character = CHARACTERS[kind]
    made = other_rigs.make_rigged_hand(side, *([character.seed] if character else []))
    if character is None:
        return made.armature
    bones, words = made.armature.data.bones, {"{Side}": side.capitalize(), "{S}": side[0].upper(), "{s}": side[0]}
    gone = []
    for before, after in (
        ((*other_rigs.JOINTS, other_rigs.FOREARM), character.bones),
        (other_rigs.METACARPALS, character.metacarpals),
        (other_rigs.TIPS, character.tips),
    ):
        for bone, name in zip(before, after or [None] * len(before), strict=True):
            if name is None:
                gone.append(bone)
                continue
            for word, value in words.items():
                name = name.replace(word, value)
            bones[bone].name = name
    remove_bones(made.armature, gone)
    for bone in made.armature.pose.bones:
        bone.rotation_mode = character.mode
    return made.armature


def remove_bones(armature, names):
    """Without some bones, whose children hang on their parents."""
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    for name in names:
        bone = armature.data.edit_bones[name]
        for child in bone.children:
            child.parent = bone.parent
        armature.data.edit_bones.remove(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
