"""The settings saved in a .blend: `Object.livehand` on a hand's armature, `Scene.livehand` for rendering."""

from functools import partial

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

from . import follow_properties as retarget_properties
from .follow_properties import LIVEHAND_PG_other_rig

# Every property can be changed on a hand that is linked from another file.
_OVERRIDE = {"LIBRARY_OVERRIDABLE"}
# Blender 4.5 and later warn of a `//` path unless the property declares it; earlier versions always accept it.
_FILE_OPTIONS = {"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else {"ANIMATABLE"}
# Files keep the numbers. The names are those of `backend.avatars.library.PERSONS`.
_SKINS = (
    ("light", "Erik", "A man with light skin", "NONE", 0),
    ("middle", "Maya", "A woman with brown skin", "NONE", 2),
    ("deep", "Joseph", "An old man with deep brown skin and light palms", "NONE", 1),
    ("lena", "Lena", "A woman of 24 with light, freckled skin", "NONE", 3),
    ("tomas", "Tomas", "A man of 58 with broad hands, light skin and hair", "NONE", 4),
    ("mei", "Mei", "A woman of 36 with slender hands and tan skin", "NONE", 5),
    ("ravi", "Ravi", "A man of 31 with brown skin", "NONE", 6),
    ("amara", "Amara", "A woman of 45 with deep brown skin", "NONE", 7),
    ("samuel", "Samuel", "A man of 74 with deep brown skin, veins and folds", "NONE", 8),
)
_SIDES = (("right", "Right", "A right hand"), ("left", "Left", "A left hand"))
_DEVICES = (
    ("auto", "Automatic", "The fastest: the CPU with its compiled kernels, or without them a GPU if torch can use one"),
    ("cpu", "CPU", "The processor"),
    ("cuda", "CUDA", "An NVIDIA GPU"),
    ("mps", "Metal", "The GPU of a Mac with Apple silicon; what torch lacks for it, the CPU does"),
)
_MODES = (
    ("HAND", "Hand Only", "Render only the hands, on a transparent background: the fast way, for compositing"),
    ("SCENE", "Hand in Scene", "Render the finished shot: the scene by Cycles, and in it the hands with their shadows"),
)
_LIGHTS = (
    ("SCENE", "Scene", "The scene's lights and world light the hands, and its objects shadow them"),
    ("CAPTURE", "Capture's Own", "Each hand keeps the light in which its avatar was captured"),
)
_PRECISIONS = (
    ("fp32", "Full", "32-bit floats"),
    ("bf16", "Half", "16-bit floats where they help; faster on recent GPUs"),
)


def _evaluate_again(group: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Tell Blender, which does not notice it, that a property was written by a script."""
    group.id_data.update_tag()


# Blender 4.2 as a module crashes at exit if a class has properties with functions when it is registered. There, scripts
# must call `update_tag()` on the armature after changing these properties.
_ON_CHANGE = {"update": _evaluate_again} if bpy.app.version >= (4, 5) else {}

_Pointer = partial(PointerProperty, override=_OVERRIDE)
_Enum = partial(EnumProperty, override=_OVERRIDE)
_String = partial(StringProperty, override=_OVERRIDE)
_File = partial(_String, subtype="FILE_PATH", options=_FILE_OPTIONS)
_Float = partial(FloatProperty, override=_OVERRIDE, **_ON_CHANGE)
_Vector = partial(FloatVectorProperty, override=_OVERRIDE, **_ON_CHANGE)


class LIVEHAND_PG_hand(bpy.types.PropertyGroup):
    """A hand: its model and avatar, and how it is matched to a plate; shape and controls are `rig.sliders`."""

    is_hand: BoolProperty(name="Is a LiveHand", default=False, override=_OVERRIDE)
    is_skin: BoolProperty(name="Is a Hand's Mesh", default=False, override=_OVERRIDE)
    mesh_selectable: BoolProperty(
        name="Mesh Selectable",
        description="A click on the hand selects its mesh, to sculpt or paint it; otherwise its armature",
        default=False,
        override=_OVERRIDE,
    )
    side: _Enum(name="Side", items=_SIDES)
    model_path: _File(name="Hand Model", description="File of the hand model; empty for the built-in hand")
    model_sha256: _String(
        name="Model Hash", description="SHA-256 of the hand model's file, by which avatars identify their hand"
    )
    skin: _Enum(name="Person", description="Which of LiveHand's own avatars the hand uses", items=_SKINS)
    avatar_path: _File(
        name="Avatar",
        description="File of an avatar that you trained (.safetensors), used instead of the person above; may be empty",
    )
    mesh: _Pointer(
        name="Mesh", description="The mesh that this armature deforms and that is rendered", type=bpy.types.Object
    )
    bone_shapes: _Pointer(
        name="Bone Shapes", description="Holds the shapes of the bones, outside every scene", type=bpy.types.Collection
    )
    other_rig: _Pointer(type=LIVEHAND_PG_other_rig)
    exposure: _Float(name="Exposure", description="Brightens the rendered hand, in stops", soft_min=-4.0, soft_max=4.0)
    gain: _Vector(
        name="Gain",
        description="Factors for the hand's red, green and blue",
        subtype="COLOR",
        size=3,
        default=(1.0, 1.0, 1.0),
        min=0.0,
        soft_max=2.0,
    )
    bias: _Vector(
        name="Bias",
        description="Added to the hand's red, green and blue after exposure and gain, like haze or lens flare",
        subtype="COLOR",
        size=3,
        default=(0.0, 0.0, 0.0),
        min=-1.0,
        max=1.0,
        soft_min=-0.1,
        soft_max=0.1,
    )
    wrist_fade: _Float(
        name="Wrist Fade",
        subtype="DISTANCE_CAMERA",  # Blender's one for millimeters
        description="Length over which the hand turns transparent towards the cut end of its arm or wrist",
        min=0.0,
        soft_max=100.0,
    )
    hair: _Float(
        name="Hair",
        description="How much hair grows on the back of hand, fingers and arm, in the scene's light; on avatars whose "
        "skin is known: those that ship",
        min=0.0,
        max=1.0,
    )


class LIVEHAND_PG_scene(bpy.types.PropertyGroup):
    """How hands are rendered."""

    mode: EnumProperty(name="Render", description="What a frame shows", items=_MODES)
    light: EnumProperty(
        name="Light",
        description="What lights the hands; avatars with a baked light always keep their own",
        items=_LIGHTS,
    )
    skin_detail: BoolProperty(
        name="Skin Detail",
        description="The exact outline, and folds, fine lines and rims of nails that are finer than an avatar learns, "
        "where they are known: those of the avatars that ship, in the scene's light",
        default=True,
    )
    blur_samples: IntProperty(
        name="Blur Samples",
        description="With motion blur or depth of field, a frame is the mean of this many sharp renders of the hand, "
        "and takes as many times as long; too few show separate ghosts",
        default=32,
        min=1,
        max=256,
        soft_max=64,
    )
    free_after_render: BoolProperty(
        name="Free Memory After Render",
        description="Unload the avatars when a render in Blender's window is done, unless a view shows them; the next "
        "render loads them again",
        default=True,
    )
    device: EnumProperty(name="Device", description="Where the renderer runs", items=_DEVICES)
    precision: EnumProperty(
        name="Precision", description="Floating-point numbers that the networks compute with", items=_PRECISIONS
    )
    watermark: BoolProperty(
        name="Watermark",
        description="Write an invisible mark of the avatar and its license into the hands of finished pictures",
    )
    keep_look: BoolProperty(
        name="Ignore View Transform",
        description="Show the hand's colors as in the Standard view transform, even if the scene uses AgX or Filmic",
    )


class LIVEHAND_PG_view_layer(bpy.types.PropertyGroup):
    """LiveHand's passes of a view layer."""

    use_pass_hand: BoolProperty(
        name="Hand",
        description="Two passes: Hand, the hands with alpha, not hidden by the scene, and HandAlpha, how much of a "
        "pixel the hands cover",
    )
    use_pass_fade: BoolProperty(
        name="Hand Fade",
        description="The pass HandFade: what Wrist Fade leaves of the hand, from 0 at the cut end to 1",
    )


CLASSES = (
    *retarget_properties.CLASSES,
    LIVEHAND_PG_hand,
    LIVEHAND_PG_scene,
    LIVEHAND_PG_view_layer,
)
_OWNERS = (
    (bpy.types.Object, LIVEHAND_PG_hand, {"override": _OVERRIDE}),
    (bpy.types.Scene, LIVEHAND_PG_scene, {}),
    (bpy.types.ViewLayer, LIVEHAND_PG_view_layer, {}),
)


def attach() -> None:
    """Add `livehand` to objects, scenes and view layers; the classes must be registered."""
    for owner, group, options in _OWNERS:
        owner.livehand = PointerProperty(type=group, **options)


def detach() -> None:
    """Undo `attach`."""
    for owner, _, _ in reversed(_OWNERS):
        del owner.livehand
