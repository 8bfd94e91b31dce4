"""What LiveHand keeps in a .blend: `Object.livehand` on a hand's armature, `Scene.livehand` for rendering."""

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import retarget_properties as other_rig
from .retarget_properties import LIVEHAND_PG_other_rig

# Every property may be changed on a hand that is linked from another file.
_OVERRIDE = {"LIBRARY_OVERRIDABLE"}
# Blender 4.5 and later warn of a `//` path unless the property says that it takes one; earlier ones always do.
_FILE = {"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else {"ANIMATABLE"}
_SKINS = (("light", "Light", "Light skin"), ("deep", "Deep", "Deep brown skin, light palms"))
_SIDES = (("right", "Right", "A right hand"), ("left", "Left", "A left hand"))
_DEVICES = (
    ("auto", "Automatic", "The GPU where torch can use one, or else the processor"),
    ("cpu", "CPU", "The processor"),
    ("cuda", "CUDA", "An NVIDIA GPU"),
)
_MODES = (
    ("HAND", "Hand Only", "The hands alone, on transparent ground: the fast way, for compositing elsewhere"),
    (
        "SCENE",
        "Hand in Scene",
        "The finished shot: Cycles renders the scene, with the hands' shadows, and the hands in it",
    ),
)
_PRECISIONS = (
    ("fp32", "Full", "32-bit floats"),
    ("bf16", "Half", "16-bit floats where they help; faster on recent GPUs"),
)


def _evaluate_again(hand, context) -> None:
    """Without an update function a script's change would not reach the drivers until something else moves."""
    hand.id_data.update_tag()


# Blender 4.2 as a module crashes at exit once any property has had an update function; there, scripts call
# `update_tag()` on the armature after changing beta alone.
_ON_CHANGE = {"update": _evaluate_again} if bpy.app.version >= (4, 5) else {}


class LIVEHAND_PG_finger(bpy.types.PropertyGroup):
    """Controls of one finger; at zero the finger is where its bones say."""

    curl: FloatProperty(
        name="Curl",
        description="Bends all joints of the finger, 1 into a fist; added to the bones' own rotations",
        soft_min=-0.3,
        soft_max=1.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    spread: FloatProperty(
        name="Spread",
        description="Turns the finger away from its neighbors; added to the bones' own rotations",
        soft_min=-1.0,
        soft_max=1.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    ik: FloatProperty(
        name="IK",
        description="How far the fingertip follows its target: 0 is FK, the bones alone, and 1 is IK",
        min=0.0,
        max=1.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )


class LIVEHAND_PG_hand(bpy.types.PropertyGroup):
    """A hand: which model it was built from, what it looks like, its shape, and how it is matched to a plate."""

    is_hand: BoolProperty(name="Is a LiveHand", default=False, override=_OVERRIDE)
    side: EnumProperty(name="Side", items=_SIDES, override=_OVERRIDE)
    model_path: StringProperty(
        name="Hand Model",
        description="File the hand was built from; empty for the built-in hand",
        subtype="FILE_PATH",
        options=_FILE,
        override=_OVERRIDE,
    )
    model_sha256: StringProperty(
        name="Model Hash", description="SHA-256 of the hand model's file, which an avatar asks for", override=_OVERRIDE
    )
    skin: EnumProperty(
        name="Skin",
        description="The look of the hand, of those that come with LiveHand",
        items=_SKINS,
        override=_OVERRIDE,
    )
    avatar_path: StringProperty(
        name="Avatar",
        description="A trained look of your own (.safetensors), which goes before the skin above; empty for that",
        subtype="FILE_PATH",
        options=_FILE,
        override=_OVERRIDE,
    )
    mesh: PointerProperty(
        name="Mesh",
        description="The mesh that this armature deforms and that is rendered",
        type=bpy.types.Object,
        override=_OVERRIDE,
    )
    beta: FloatVectorProperty(
        name="Shape",
        description="Shape coefficients; the trained look fits best near zero",
        size=10,
        default=(0.0,) * 10,
        # Shape keys are clamped by Blender outside this range.
        min=-10.0,
        max=10.0,
        soft_min=-3.0,
        soft_max=3.0,
        options={"ANIMATABLE"},
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    thumb: PointerProperty(name="Thumb", type=LIVEHAND_PG_finger, override=_OVERRIDE)
    index: PointerProperty(name="Index", type=LIVEHAND_PG_finger, override=_OVERRIDE)
    middle: PointerProperty(name="Middle", type=LIVEHAND_PG_finger, override=_OVERRIDE)
    ring: PointerProperty(name="Ring", type=LIVEHAND_PG_finger, override=_OVERRIDE)
    pinky: PointerProperty(name="Little", type=LIVEHAND_PG_finger, override=_OVERRIDE)
    fist: FloatProperty(
        name="Fist",
        description="Closes the whole hand; added to the bones' own rotations",
        soft_min=0.0,
        soft_max=1.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    opposition: FloatProperty(
        name="Opposition",
        description="Brings the thumb before the fingers; added to the bones' own rotations",
        soft_min=0.0,
        soft_max=1.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    follow: FloatProperty(
        name="Follow",
        description="How far the hand does what the rig does that it follows: 0 not at all, 1 wholly",
        default=1.0,
        min=0.0,
        max=1.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    other_rig: PointerProperty(type=LIVEHAND_PG_other_rig, override=_OVERRIDE)
    limit_joints: BoolProperty(
        name="Limit Joints",
        description="Keep the finger joints within a hand's usual range",
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Stops by which the hand is rendered lighter",
        soft_min=-4.0,
        soft_max=4.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    gain: FloatVectorProperty(
        name="Gain",
        description="Factors for the hand's red, green and blue",
        subtype="COLOR",
        size=3,
        default=(1.0, 1.0, 1.0),
        min=0.0,
        soft_max=2.0,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )
    bias: FloatVectorProperty(
        name="Bias",
        description="Light added to the hand's red, green and blue after exposure and gain, as haze or flare adds it",
        subtype="COLOR",
        size=3,
        default=(0.0, 0.0, 0.0),
        min=-1.0,
        max=1.0,
        soft_min=-0.1,
        soft_max=0.1,
        override=_OVERRIDE,
        **_ON_CHANGE,
    )


class LIVEHAND_PG_scene(bpy.types.PropertyGroup):
    """How hands are rendered."""

    mode: EnumProperty(name="Render", description="What a frame shows", items=_MODES)
    blur_samples: IntProperty(
        name="Blur Samples",
        description="Sharp renders of the hand that a frame with motion blur or depth of field is the mean of",
        default=16,
        min=1,
        max=256,
        soft_max=64,
    )
    free_after_render: BoolProperty(
        name="Free Memory After Render",
        description="Forget the loaded avatars when a render in Blender's window is done; the next loads them again",
        default=True,
    )
    device: EnumProperty(name="Device", description="Where the renderer runs", items=_DEVICES)
    precision: EnumProperty(name="Precision", description="Floats the networks compute with", items=_PRECISIONS)
    keep_look: BoolProperty(
        name="Keep Look",
        description="Show the hand's colors as the Standard view transform does, though the scene uses AgX or Filmic",
    )


class LIVEHAND_PG_view_layer(bpy.types.PropertyGroup):
    """What a view layer gives beside Blender's own passes."""

    use_pass_hand: BoolProperty(
        name="Hand",
        description="Pass Hand, the hands unhidden by the scene with alpha, and HandAlpha, how much of a pixel is hand",
    )


CLASSES = (*other_rig.CLASSES, LIVEHAND_PG_finger, LIVEHAND_PG_hand, LIVEHAND_PG_scene, LIVEHAND_PG_view_layer)


def attach() -> None:
    """Give objects, scenes and view layers their `livehand`; the classes must be registered."""
    bpy.types.Object.livehand = PointerProperty(type=LIVEHAND_PG_hand, override=_OVERRIDE)
    bpy.types.Scene.livehand = PointerProperty(type=LIVEHAND_PG_scene)
    bpy.types.ViewLayer.livehand = PointerProperty(type=LIVEHAND_PG_view_layer)


def detach() -> None:
    """Undo `attach`."""
    del bpy.types.ViewLayer.livehand
    del bpy.types.Scene.livehand
    del bpy.types.Object.livehand
