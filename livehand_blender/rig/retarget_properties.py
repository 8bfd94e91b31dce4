"""What a hand keeps of the rig that drives it: the armature, and which of its bones are its joints."""

import bpy
from bpy.props import BoolProperty, EnumProperty, PointerProperty, StringProperty

from ...backend.hand.model import JOINT_NAMES, MANO_FINGERS

_OVERRIDE = {"LIBRARY_OVERRIDABLE"}
_SIDES = (
    ("OWN", "The Hand's Own", "The same hand as this one"),
    ("right", "Right", "Its right hand; onto a left hand it is mirrored"),
    ("left", "Left", "Its left hand; onto a right hand it is mirrored"),
)


def _is_armature(_, thing: bpy.types.Object) -> bool:
    return thing.type == "ARMATURE"


# Blender 4.2 as a module crashes at exit once any property has had a function; there, any object is offered.
_ARMATURES = {"poll": _is_armature} if bpy.app.version >= (4, 5) else {}


class LIVEHAND_PG_other_rig(bpy.types.PropertyGroup):
    """An armature made elsewhere."""

    armature: PointerProperty(
        name="Armature",
        description="The rig that this hand follows: any armature with a hand, alone or on a character",
        type=bpy.types.Object,
        override=_OVERRIDE,
        **_ARMATURES,
    )
    side: EnumProperty(name="Hand", description="Which of its hands", items=_SIDES, override=_OVERRIDE)
    fits_shape: BoolProperty(
        name="Fit Shape",
        description="Give this hand the other's proportions by its shape sliders, and its size by the object's scale",
        default=True,
        override=_OVERRIDE,
    )


def tip_property(finger: str) -> str:
    """The name of the property that holds the bone at a fingertip."""
    return f"{finger}_tip"


LIVEHAND_PG_other_rig.__annotations__ |= {
    joint: StringProperty(name=joint.capitalize(), description="The bone that begins at this joint", override=_OVERRIDE)
    for joint in JOINT_NAMES
}
LIVEHAND_PG_other_rig.__annotations__ |= {
    tip_property(finger): StringProperty(
        name=f"{finger.capitalize()} Tip",
        description="The bone that begins at the fingertip, where there is one",
        override=_OVERRIDE,
    )
    for finger in MANO_FINGERS
}

CLASSES = (LIVEHAND_PG_other_rig,)
