"""The LiveHand tab in the 3D view's sidebar, and the entry in the Add menu."""

import bpy

from ..render.panels import draw_mode
from ..rig.hand import active_hand
from ..rig.sliders import slider_path
from ..scene.settings import ENGINE
from .avatars import draw_choice
from .mixins import HandTab, Tab, polled_hand
from .shape import shape_names
from .studio import draw_studio


class LIVEHAND_PT_hand(Tab, bpy.types.Panel):
    """The active hand."""

    bl_label = "Hand"

    def draw(self, context):
        """Draw facts about the hand, or a button to add one."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        armature = active_hand(context)
        if armature is None:
            layout.label(text="Select a hand, or add one:")
            layout.operator("livehand.add_hand", text="Add Hand", icon="VIEW_PAN")
            return
        hand = armature.livehand
        layout.label(text=f"{armature.name} ({hand.side})", icon="VIEW_PAN")
        layout.label(text=f"Model: {hand.model_path or 'built-in'}")
        draw_choice(layout, armature)
        layout.prop(hand, "mesh")
        if hand.mesh:
            row = layout.row()
            row.use_property_split = False
            row.prop(hand.mesh.livehand, "mesh_selectable")
        layout.operator("livehand.reset_pose", icon="LOOP_BACK")


class LIVEHAND_PT_shape(HandTab, bpy.types.Panel):
    """Shape of the active hand."""

    bl_label = "Shape"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draw ten sliders that can be keyed; their names stand in them, as a narrow tab has no room beside them."""
        armature = polled_hand(context)
        column = self.layout.column(align=True)
        for index, name in enumerate(shape_names(armature.livehand)):
            column.prop(armature, slider_path("beta"), index=index, text=name, slider=True)
        column.prop(armature.livehand, "hair", slider=True)
        row = self.layout.row(align=True)
        row.operator("livehand.random_shape", text="Random")
        row.operator("livehand.reset_shape", text="Reset")
        self.layout.operator("livehand.match_measurements")


class LIVEHAND_PT_match_plate(HandTab, bpy.types.Panel):
    """Color correction of the active hand, to match a plate."""

    bl_label = "Match Plate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draw settings that can be keyed."""
        self.layout.use_property_split = True
        armature = polled_hand(context)
        column = self.layout.column()
        for name in ("exposure", "gain", "bias", "wrist_fade"):
            column.prop(armature.livehand, name)


class LIVEHAND_PT_render(Tab, bpy.types.Panel):
    """How hands are rendered."""

    bl_label = "Render"

    def draw(self, context):
        """Draw engine and settings."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        if context.scene.render.engine != ENGINE:
            layout.operator("livehand.set_engine", icon="RENDER_STILL")
        draw_mode(layout, context.scene)
        for name in ("light", "blur_samples", "device", "precision"):
            layout.prop(context.scene.livehand, name)
        column = layout.column(heading="")
        column.use_property_split = False  # their names are too long to stand in half a tab
        for name in ("skin_detail", "keep_look", "free_after_render"):
            column.prop(context.scene.livehand, name)
        draw_studio(layout, context.scene, context.view_layer)
        layout.operator("livehand.free_memory", icon="TRASH")


CLASSES = (LIVEHAND_PT_hand, LIVEHAND_PT_shape, LIVEHAND_PT_match_plate, LIVEHAND_PT_render)


def add_to_menus() -> None:
    """Add > Armature > LiveHand Hand."""
    bpy.types.VIEW3D_MT_armature_add.append(_draw_add)


def remove_from_menus() -> None:
    """Undo `add_to_menus`."""
    bpy.types.VIEW3D_MT_armature_add.remove(_draw_add)


def _draw_add(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.add_hand", icon="VIEW_PAN")
