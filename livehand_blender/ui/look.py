"""How a hand's plain mesh looks without an avatar: a texture on its atlas, for quick previews and for other engines."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..render.hand_source import hand_source
from ..rig.hand import RiggedHand
from ..rig.skin_texture import remove_texture, wear_texture, worn_texture
from .mixins import HandTab, OnHand, polled_hand, reports_errors
from .preferences import library_folder


class LIVEHAND_OT_wear_texture(OnHand, bpy.types.Operator, ImportHelper):
    """Show an image, painted or photographed on the hand's atlas, on the plain mesh; no avatar takes part."""

    bl_idname = "livehand.wear_texture"
    bl_label = "Apply Mesh Texture"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.png;*.jpg;*.jpeg;*.tif;*.tiff;*.exr", options={"HIDDEN"})

    @reports_errors
    def execute(self, context):
        """Make it the base color of the mesh's material."""
        wear_texture(RiggedHand.active(context), Path(bpy.path.abspath(self.filepath)))


class LIVEHAND_OT_wear_avatar_colors(OnHand, bpy.types.Operator):
    """Show the colors of the hand's avatar on the plain mesh: in Solid, Material Preview, EEVEE and Cycles."""

    bl_idname = "livehand.wear_avatar_colors"
    bl_label = "Avatar's Colors"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context):
        """Bake the avatar's albedo over the atlas, once a file, and make it the base color of the mesh's material."""
        from ...backend.render.albedo import baked_colors

        hand = RiggedHand.active(context)
        avatar = hand_source(hand.armature).avatar_path
        wear_texture(hand, baked_colors(avatar, hand.model, library_folder(context) / "colors", hand.side))


class LIVEHAND_OT_remove_texture(OnHand, bpy.types.Operator):
    """Give the plain mesh its single color back."""

    bl_idname = "livehand.remove_texture"
    bl_label = "Remove Mesh Texture"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context):
        """Take the picture out of the mesh's material."""
        remove_texture(RiggedHand.active(context))


class LIVEHAND_PT_look(HandTab, bpy.types.Panel):
    """The plain mesh of the active hand."""

    bl_label = "Mesh Texture"

    def draw(self, context):
        """Draw the texture that the mesh wears, if any, and the operators."""
        armature = polled_hand(context)
        image = worn_texture(armature.livehand.mesh) if armature.livehand.mesh else None
        if image is not None:
            self.layout.label(text=image.name, icon="TEXTURE")
        row = self.layout.row(align=True)
        row.operator("livehand.wear_avatar_colors", text="Avatar", icon="USER")
        row.operator("livehand.wear_texture", text="Image", icon="FILE_IMAGE")
        if image is not None:
            row.operator("livehand.remove_texture", text="", icon="X")


CLASSES = (LIVEHAND_OT_wear_texture, LIVEHAND_OT_wear_avatar_colors, LIVEHAND_OT_remove_texture, LIVEHAND_PT_look)
