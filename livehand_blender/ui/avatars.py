"""A hand's avatar: its thumbnail, licence and quality figures, and the choice among the avatars of the same hand."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import ClassVar

import bpy
import numpy as np
from bpy.props import StringProperty

from ...backend.avatars.library import person_name
from ...backend.avatars.metadata import AvatarMetadata
from ...backend.records.errors import LiveHandError
from ..render.hand_source import hand_source, set_avatar
from ..rig.hand import RiggedHand
from ..rig.sliders import read_beta
from .avatar_library import AvatarLibrary
from .mixins import HandTab, OnHand, Tab, polled_hand, reports_errors
from .shape import set_beta

_LARGE_SCALE, _SMALL_SCALE = 7.0, 5.0  # of icons
_COLUMNS = 3

# Approximate widths: of a character in Blender's interface font, of a panel's margins with the tabs, of an icon.
_CHARACTER_PX, _MARGINS_PX, _ICON_PX = 6, 45, 20
_MIN_CHARACTERS = 30


class LIVEHAND_OT_wear_avatar(OnHand, bpy.types.Operator):
    """Use this avatar for the active hand."""

    bl_idname = "livehand.wear_avatar"
    bl_label = "Use Avatar"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(name="Avatar", description="An avatar's file (.safetensors)", subtype="FILE_PATH")

    @classmethod
    def description(cls, context, properties):
        """Name the file in the tooltip of one button."""
        return f"Use {Path(properties.filepath).name}"

    @reports_errors
    def execute(self, context):
        """Set the hand's skin or avatar file, if the avatar is of this hand's model."""
        armature = polled_hand(context)
        path = Path(bpy.path.abspath(self.filepath))
        _check_same_hand(LIVEHAND_PT_avatar.library.metadata(path), armature)
        set_avatar(armature, path)


class LIVEHAND_OT_person_shape(OnHand, bpy.types.Operator):
    """Give the hand the shape of the person on whom its avatar was trained; its pose is kept."""

    bl_idname = "livehand.person_shape"
    bl_label = "Person's Shape"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context):
        """Set beta to the avatar's."""
        hand = RiggedHand.active(context)
        avatar = LIVEHAND_PT_avatar.library.metadata(hand_source(hand.armature).avatar_path)
        if avatar.beta is None:
            raise LiveHandError(
                f"an avatar must tell its person's shape, '{avatar.name}' does not; set the sliders of Shape"
            )
        set_beta(hand, np.array(avatar.beta))


class LIVEHAND_PT_avatar(HandTab, bpy.types.Panel):
    """The active hand's avatar."""

    bl_label = "Avatar Details"

    library: ClassVar[AvatarLibrary]

    @classmethod
    def register(cls):
        """Open the library, when Blender registers the class."""
        cls.library = AvatarLibrary()

    @classmethod
    def unregister(cls):
        """Close the library, when Blender unregisters the class."""
        cls.library.close()

    def draw(self, context):
        """Draw thumbnail and facts, then the properties."""
        layout = self.layout
        armature = polled_hand(context)
        try:
            _draw_avatar(
                context, layout, LIVEHAND_PT_avatar.library.metadata(hand_source(armature).avatar_path), armature
            )
        except LiveHandError as error:
            draw_wrapped(context, layout, str(error), icon="ERROR")
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.prop(armature.livehand, "skin")
        column.prop(armature.livehand, "avatar_path", text="File", placeholder="of your own")


class LIVEHAND_PT_choose_avatar(Tab, bpy.types.Panel):
    """The avatars of the active hand's model, with thumbnails."""

    bl_label = "Choose Avatar"
    bl_options = {"INSTANCED"}
    bl_ui_units_x = 16

    def draw(self, context):
        """Draw one button below each thumbnail."""
        armature = polled_hand(context)
        library = LIVEHAND_PT_avatar.library
        current = hand_source(armature).avatar_path.resolve()
        grid = self.layout.grid_flow(row_major=True, columns=_COLUMNS, even_columns=True, even_rows=True)
        for avatar in library.offered(context, armature):
            cell = grid.column(align=True)
            cell.template_icon(library.icon(avatar), scale=_SMALL_SCALE)
            button = cell.operator(
                "livehand.wear_avatar", text=person_name(avatar.path, avatar.name), depress=avatar.path == current
            )
            button.filepath = str(avatar.path)
        self.layout.label(text="More: Avatar Folder in Preferences")


def _draw_avatar(
    context: bpy.types.Context, layout: bpy.types.UILayout, avatar: AvatarMetadata, armature: bpy.types.Object
) -> None:
    column = layout.column(align=True)
    for line in facts(avatar):
        draw_wrapped(context, column, line)
    if avatar.beta is not None and not np.allclose(read_beta(armature), avatar.beta, atol=1e-4):
        column.operator("livehand.person_shape")
    if avatar.hand_sha256 != armature.livehand.model_sha256:
        draw_wrapped(context, column, f"of another hand: {avatar.hand_name}", icon="ERROR")


def draw_choice(layout: bpy.types.UILayout, armature: bpy.types.Object) -> None:
    """Draw a button with the current avatar's name that opens the choice."""
    try:
        avatar = LIVEHAND_PT_avatar.library.metadata(hand_source(armature).avatar_path)
        name = person_name(avatar.path, avatar.name)
        if icon := LIVEHAND_PT_avatar.library.icon(avatar):
            layout.template_icon(icon, scale=_LARGE_SCALE)
    except LiveHandError:
        name = "Choose Avatar"
    layout.popover("LIVEHAND_PT_choose_avatar", text=name, icon="USER")


def facts(avatar: AvatarMetadata) -> tuple[str, ...]:
    """List lines of text about an avatar: name, licence, figures, origin."""
    licence = f"License: {avatar.licence or 'not stated'}"
    figures = avatar.figures or ("not measured (livehand evaluate --record)",)
    return (person_name(avatar.path, avatar.name), licence, *figures, *filter(None, (avatar.made_from,)))


def _check_same_hand(avatar: AvatarMetadata, armature: bpy.types.Object) -> None:
    if avatar.hand_sha256 != armature.livehand.model_sha256:
        raise LiveHandError(
            f"an avatar must be of the hand's own model; '{avatar.name}' is of '{avatar.hand_name}' "
            f"({avatar.hand_sha256[:12]}...), {armature.name} has {armature.livehand.model_sha256[:12]}...; "
            "choose an avatar of this hand, or add a hand of that model"
        )


CLASSES = (LIVEHAND_OT_wear_avatar, LIVEHAND_OT_person_shape, LIVEHAND_PT_avatar, LIVEHAND_PT_choose_avatar)


def draw_wrapped(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = "NONE") -> None:
    """Draw labels that fit the region's width; the first has the icon."""
    width_px = context.region.width if context.region else 0
    scale = context.preferences.system.ui_scale or 1  # 0 without a window
    content_px = width_px / scale - _MARGINS_PX - (_ICON_PX if icon != "NONE" else 0)
    characters = max(_MIN_CHARACTERS, int(content_px / _CHARACTER_PX))
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, characters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")
