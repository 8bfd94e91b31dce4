"""The LiveHand tab in the 3D view's sidebar: Avatar, Pose, Light, Render, Advanced; and the entries in the Add menu."""

import bpy

from ..render.engine import LiveHandRender
from ..render.panels import draw_mode
from ..render.preparation import draw_preparation
from ..rig.hand import active_hand
from ..rig.sliders import slider_path
from ..scene.settings import ENGINE
from .avatars import draw_choice
from .mixins import AdvancedTab, HandTab, Tab, polled_hand
from .packages import draw_gpu
from .person import draw_person
from .shape import shape_names
from .studio import draw_studio


class LIVEHAND_PT_hand(Tab, bpy.types.Panel):
    """The active hand and who it is, or buttons to add one."""

    bl_label = "Avatar"
    bl_order = 0

    def draw(self, context):
        """Draw the hand's name, and the choice of its avatar."""
        layout = self.layout
        draw_preparation(layout, LiveHandRender.preparation.progress)
        armature = active_hand(context)
        if armature is None:
            layout.operator("livehand.new_hand_scene", icon="SCENE_DATA")
            layout.operator("livehand.add_hand", text="Add Hand", icon="VIEW_PAN")
            return
        layout.label(text=armature.name, icon="VIEW_PAN")
        draw_choice(layout, armature)
        draw_person(layout, context)


class LIVEHAND_PT_light(Tab, bpy.types.Panel):
    """What lights the hands."""

    bl_label = "Light"
    bl_order = 2

    def draw(self, context):
        """Draw the choice, and the studio's buttons."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(context.scene.livehand, "light")
        draw_studio(layout, context.scene, context.view_layer)


class LIVEHAND_PT_render(Tab, bpy.types.Panel):
    """How hands are rendered."""

    bl_label = "Render"
    bl_order = 3

    def draw(self, context):
        """Draw the engine and the settings of a picture."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        if context.scene.render.engine != ENGINE:
            layout.operator("livehand.set_engine", icon="RENDER_STILL")
        draw_mode(layout, context.scene)
        layout.prop(context.scene.livehand, "blur_samples")
        column = layout.column(heading="")
        column.use_property_split = False  # their names are too long to stand in half a tab
        for name in ("skin_detail", "keep_look"):
            column.prop(context.scene.livehand, name)


class LIVEHAND_PT_advanced(Tab, bpy.types.Panel):
    """All that a first picture does not need."""

    bl_label = "Advanced"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 4

    def draw(self, context):
        """Draw the hand's mesh, and a button that resets its pose."""
        armature = active_hand(context)
        if armature is None:
            return
        layout, hand = self.layout, armature.livehand
        layout.use_property_split = True
        layout.use_property_decorate = False
        if hand.model_path:
            layout.prop(hand, "model_path", text="Model")
        layout.prop(hand, "mesh")
        if hand.mesh:
            row = layout.row()
            row.use_property_split = False
            row.prop(hand.mesh.livehand, "mesh_selectable")
        layout.operator("livehand.reset_pose", icon="LOOP_BACK")


class LIVEHAND_PT_shape(HandTab, bpy.types.Panel):
    """Shape of the active hand."""

    bl_label = "Shape"

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

    def draw(self, context):
        """Draw settings that can be keyed."""
        self.layout.use_property_split = True
        armature = polled_hand(context)
        column = self.layout.column()
        for name in ("exposure", "gain", "bias", "wrist_fade"):
            column.prop(armature.livehand, name)


class LIVEHAND_PT_performance(AdvancedTab, bpy.types.Panel):
    """Where the renderer runs, and what it keeps."""

    bl_label = "Performance"

    def draw(self, context):
        """Draw device, precision and memory."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("device", "precision"):
            layout.prop(context.scene.livehand, name)
        draw_gpu(layout, context)
        column = layout.column(heading="")
        column.use_property_split = False
        column.prop(context.scene.livehand, "free_after_render")
        layout.operator("livehand.free_memory", icon="TRASH")


class LIVEHAND_PT_origin(AdvancedTab, bpy.types.Panel):
    """What finished pictures tell of the avatars that they show."""

    bl_label = "Origin"

    def draw(self, context):
        """Draw the switch of the watermark."""
        self.layout.prop(context.scene.livehand, "watermark")


CLASSES = (
    LIVEHAND_PT_hand,
    LIVEHAND_PT_light,
    LIVEHAND_PT_render,
    LIVEHAND_PT_advanced,
    LIVEHAND_PT_shape,
    LIVEHAND_PT_match_plate,
    LIVEHAND_PT_performance,
    LIVEHAND_PT_origin,
)


def add_to_menus() -> None:
    """Add > Armature > LiveHand Hand, and New Hand Scene."""
    bpy.types.VIEW3D_MT_armature_add.append(_draw_add)


def remove_from_menus() -> None:
    """Undo `add_to_menus`."""
    bpy.types.VIEW3D_MT_armature_add.remove(_draw_add)


def _draw_add(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.add_hand", icon="VIEW_PAN")
    menu.layout.operator("livehand.new_hand_scene", icon="SCENE_DATA")
