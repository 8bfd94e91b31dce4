"""What a hand wears: its avatar's picture, licence and figures, and the choice among the avatars of the same hand."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import StringProperty

from ...backend.avatars.library import SKINS, shipped_avatar_path
from ...backend.avatars.metadata import AvatarMetadata
from ...backend.records.errors import LiveHandError
from ..render.hands.hand_source import hand_source
from .active_hand import HandTab, OnHand, Tab, polled_hand
from .avatar_library import AvatarLibrary
from .wrapped_text import draw_wrapped

_PICTURE, _THUMBNAIL = 7.0, 5.0  # scales of icons
_COLUMNS = 3


class LIVEHAND_OT_wear_avatar(OnHand, bpy.types.Operator):
    """Let the active hand look like this avatar."""

    bl_idname = "livehand.wear_avatar"
    bl_label = "Wear Avatar"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(name="Avatar", description="An avatar's file (.safetensors)", subtype="FILE_PATH")

    @classmethod
    def description(cls, context, properties):
        """Of one button: the file."""
        return f"Look like {Path(properties.filepath).name}"

    def execute(self, context):
        """Set the hand's skin or file, if the avatar is this hand's."""
        armature = polled_hand(context)
        path = Path(bpy.path.abspath(self.filepath))
        try:
            card = LIVEHAND_PT_avatar.gallery.card(path)
            _check_same_hand(card, armature)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        _wear(armature.livehand, path)
        return {"FINISHED"}


class LIVEHAND_PT_avatar(HandTab, bpy.types.Panel):
    """The avatar that the active hand wears."""

    bl_label = "Avatar"
    bl_options = {"DEFAULT_CLOSED"}

    gallery: ClassVar[AvatarLibrary]

    @classmethod
    def register(cls):
        """Blender calls it with the class."""
        cls.gallery = AvatarLibrary()

    @classmethod
    def unregister(cls):
        """Blender calls it with the class."""
        cls.gallery.close()

    def draw(self, context):
        """Picture and facts, then what can be changed."""
        layout = self.layout
        armature = polled_hand(context)
        try:
            _draw_card(layout, LIVEHAND_PT_avatar.gallery.card(hand_source(armature).avatar_path), armature)
        except LiveHandError as error:
            draw_wrapped(context, layout, str(error), icon="ERROR")
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.prop(armature.livehand, "skin")
        column.prop(armature.livehand, "avatar_path", text="File", placeholder="of your own")


class LIVEHAND_PT_choose_avatar(Tab, bpy.types.Panel):
    """Avatars of the active hand's model, to choose by sight."""

    bl_label = "Choose Avatar"
    bl_options = {"INSTANCED"}
    bl_ui_units_x = 16

    def draw(self, context):
        """One button under each picture."""
        armature = polled_hand(context)
        gallery = LIVEHAND_PT_avatar.gallery
        worn = hand_source(armature).avatar_path.resolve()
        grid = self.layout.grid_flow(row_major=True, columns=_COLUMNS, even_columns=True, even_rows=True)
        for card in gallery.offered(context, armature):
            cell = grid.column(align=True)
            cell.template_icon(gallery.icon(card), scale=_THUMBNAIL)
            button = cell.operator("livehand.wear_avatar", text=card.name, depress=card.path == worn)
            button.filepath = str(card.path)
        self.layout.label(text="More: name a folder in the add-on's preferences")


def _draw_card(layout: bpy.types.UILayout, card: AvatarMetadata, armature: bpy.types.Object) -> None:
    if icon := LIVEHAND_PT_avatar.gallery.icon(card):
        layout.template_icon(icon, scale=_PICTURE)
    column = layout.column(align=True)
    for line in facts(card):
        column.label(text=line)
    if card.hand_sha256 != armature.livehand.model_sha256:
        column.label(text=f"of another hand: {card.hand_name}", icon="ERROR")


def draw_choice(layout: bpy.types.UILayout, armature: bpy.types.Object) -> None:
    """A button with the worn avatar's name, which opens the choice."""
    try:
        name = LIVEHAND_PT_avatar.gallery.card(hand_source(armature).avatar_path).name
    except LiveHandError:
        name = "Choose Avatar"
    split = layout.split(factor=0.4)
    split.alignment = "RIGHT"
    split.label(text="Avatar")
    split.popover("LIVEHAND_PT_choose_avatar", text=name, icon="IMAGE_DATA")


def facts(card: AvatarMetadata) -> tuple[str, ...]:
    """Lines of text about an avatar: name, licence, figures, origin."""
    licence = f"Licence: {card.licence or 'not stated'}"
    figures = card.figures or ("not measured (livehand evaluate --record)",)
    return (card.name, licence, *figures, *filter(None, (card.made_from,)))


def _wear(hand: bpy.types.PropertyGroup, path: Path) -> None:
    shipped = {shipped_avatar_path(skin).resolve(): skin for skin in SKINS}
    skin = shipped.get(path.resolve())
    if skin is not None:
        hand.skin = skin
    hand.avatar_path = "" if skin is not None else str(path)


def _check_same_hand(card: AvatarMetadata, armature: bpy.types.Object) -> None:
    if card.hand_sha256 != armature.livehand.model_sha256:
        raise LiveHandError(
            f"an avatar must be of the hand's own model; '{card.name}' is of '{card.hand_name}' "
            f"({card.hand_sha256[:12]}...), {armature.name} has {armature.livehand.model_sha256[:12]}...; "
            "choose an avatar of this hand, or add a hand of that model"
        )


CLASSES = (LIVEHAND_OT_wear_avatar, LIVEHAND_PT_avatar, LIVEHAND_PT_choose_avatar)
