"""The rig that drives a hand: its armature, and which of its bones are the hand's joints."""

import bpy
from bpy.props import BoolProperty, EnumProperty, PointerProperty, StringProperty

from ...backend.hand.model import JOINT_NAMES, MANO_FINGERS

_OVERRIDE = {"LIBRARY_OVERRIDABLE"}
_SIDES = (
    ("OWN", "Same as Hand", "The same side as this hand"),
    ("right", "Right", "The rig's right hand; a left hand mirrors its motion"),
    ("left", "Left", "The rig's left hand; a right hand mirrors its motion"),
)


def _is_armature(_, thing: bpy.types.Object) -> bool:
    return thing.type == "ARMATURE"


# Blender 4.2 as a module crashes at exit if any property has had a function; there, the field offers any object.
_ONLY_ARMATURES = {"poll": _is_armature} if bpy.app.version >= (4, 5) else {}


class LIVEHAND_PG_other_rig(bpy.types.PropertyGroup):
    """The rig that a hand follows or is baked from."""

    armature: PointerProperty(
        name="Armature",
        description="The rig that this hand follows: any armature that has a hand",
        type=bpy.types.Object,
        override=_OVERRIDE,
        **_ONLY_ARMATURES,
    )
    side: EnumProperty(name="Hand", description="Which of the rig's hands", items=_SIDES, override=_OVERRIDE)
    fits_shape: BoolProperty(
        name="Fit Shape",
        description="Match the rig's proportions with the shape sliders, and its size with the object's scale",
        default=True,
        override=_OVERRIDE,
    )


def tip_property(finger: str) -> str:
    """Name the property for the bone at a fingertip."""
    return f"{finger}_tip"


LIVEHAND_PG_other_rig.__annotations__ |= {
    joint: StringProperty(name=joint.capitalize(), description="The bone that starts at this joint", override=_OVERRIDE)
    for joint in JOINT_NAMES
}
LIVEHAND_PG_other_rig.__annotations__["forearm"] = StringProperty(
    name="Forearm",
    description="The bone of the forearm, if there is one; a hand with an arm follows it",
    override=_OVERRIDE,
)
LIVEHAND_PG_other_rig.__annotations__ |= {
    tip_property(finger): StringProperty(
        name=f"{finger.capitalize()} Tip",
        description="The bone that starts at the fingertip, if there is one",
        override=_OVERRIDE,
    )
    for finger in MANO_FINGERS
}

CLASSES = (LIVEHAND_PG_other_rig,)
