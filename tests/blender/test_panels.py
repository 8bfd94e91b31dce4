"""Panels draw without an error: a stand-in layout checks every name against Blender's own."""

from pathlib import Path
from types import SimpleNamespace

import blf
import bpy
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.system import packages as dependencies
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.sliders import SLIDERS
from livehand.livehand_blender.ui import avatars, compositing, hand_model, look, motion, packages, panels, picker, video
from livehand.livehand_blender.ui import rigs as retarget

UI = bpy.types.UILayout.bl_rna.functions
MODULES = (avatars, hand_model, look, motion, panels, picker, retarget, video)
PANELS = [
    cls
    for one in MODULES
    for cls in one.CLASSES
    if issubclass(cls, bpy.types.Panel) and cls is not avatars.LIVEHAND_PT_choose_avatar  # a pop-up of its own width
]


class Layout:
    """Records what is drawn; rejects arguments, icons, properties and operators that Blender does not have.

    `parts` are what stands in it: further layouts, and (text, whether it has an icon).
    """

    use_property_split = False

    def __init__(self, drawn, is_row=False, is_split=False):
        self.drawn, self.is_row, self.use_property_split, self.parts = drawn, is_row, is_split, []

    def _inner(self, function, arguments, is_row=False):
        check_arguments(function, arguments)
        inner = Layout(self.drawn, is_row, self.use_property_split)
        self.parts.append(inner)
        return inner

    def column(self, **arguments):
        return self._inner("column", arguments)

    def row(self, **arguments):
        return self._inner("row", arguments, is_row=True)

    def split(self, **arguments):
        return self._inner("split", arguments, is_row=True)

    def grid_flow(self, **arguments):
        return self._inner("grid_flow", arguments)

    def template_icon(self, icon_value, **arguments):
        check_arguments("template_icon", arguments)

    def popover(self, panel, **arguments):
        check_arguments("popover", arguments)
        assert hasattr(bpy.types, panel)
        self.drawn.append(panel)

    def box(self):
        return self._inner("box", {})

    def separator(self, **arguments):
        check_arguments("separator", arguments)

    def label(self, **arguments):
        check_arguments("label", arguments)
        self.drawn.append(arguments["text"])
        self.parts.append((arguments["text"], "icon" in arguments))

    def progress(self, **arguments):
        check_arguments("progress", arguments)
        self.drawn.append((arguments["text"], arguments["factor"]))
        self.parts.append((arguments["text"], False))

    def prop(self, owner, name, **arguments):
        check_arguments("prop", arguments)
        assert name in owner.bl_rna.properties or owner.path_resolve(name) is not None
        self.drawn.append(name.strip('["]'))
        declared = owner.bl_rna.properties.get(name)
        text = arguments.get("text", declared.name if declared else name)
        # A split layout has a number's or a menu's name in its left half, and a switch's beside the box in the right.
        is_left = self.use_property_split and declared is not None and declared.type != "BOOLEAN"
        self.parts.append((text * (2 if is_left else 1), False))

    def prop_search(self, owner, name, data, collection, **arguments):
        assert hasattr(data, collection)
        self.prop(owner, name, **arguments)

    def operator(self, name, **arguments):
        check_arguments("operator", arguments)
        module, _, function = name.partition(".")
        rna = getattr(getattr(bpy.ops, module), function).get_rna_type()
        self.drawn.append(name)
        self.parts.append((arguments.get("text", rna.name), "icon" in arguments))
        return OperatorSettings(rna, self.drawn)


class OperatorSettings:
    """Accepts the properties that an operator has, and records their values."""

    def __init__(self, rna, drawn):
        object.__setattr__(self, "rna", rna)
        object.__setattr__(self, "drawn", drawn)

    def __setattr__(self, name, value):
        assert name in self.rna.properties
        self.drawn.append(value)


def check_arguments(function, arguments):
    parameters = UI[function].parameters
    assert set(arguments) <= set(parameters.keys())
    if "icon" in arguments:
        assert arguments["icon"] in parameters["icon"].enum_items


def draw(panel):
    return drawn_layout(panel).drawn


def drawn_layout(panel):
    layout = Layout([])
    panel.draw(SimpleNamespace(layout=layout, bl_rna=panel.bl_rna), bpy.context)
    return layout


# Measured in Blender's window: a sidebar 250 px wide has 205 px for a panel's content.
NARROW_PX, FONT_PX, MARGIN_PX, ICON_PX = 205, 11, 6, 20


def clipped(layout, width_px=NARROW_PX):
    """The texts for which a layout of this width has no room, in Blender's own font."""
    blf.size(0, FONT_PX)
    share_px = width_px / (len(layout.parts) if layout.is_row else 1)
    for part in layout.parts:
        if isinstance(part, Layout):
            yield from clipped(part, share_px)
        elif blf.dimensions(0, part[0])[0] + MARGIN_PX + ICON_PX * part[1] > share_px:
            yield part[0]


def test_without_a_hand_the_tab_offers_to_add_one():
    assert draw(panels.LIVEHAND_PT_hand) == ["livehand.new_hand_scene", "livehand.add_hand"]
    assert draw(panels.LIVEHAND_PT_advanced) == []
    assert not panels.LIVEHAND_PT_shape.poll(bpy.context)


def test_a_hand_shows_its_avatar_and_a_choice():
    hand = add_hand(bpy.context, load_default_hand())
    drawn = draw(avatars.LIVEHAND_PT_avatar)
    assert drawn[:2] == ["Erik", "License: GPL-3.0-or-later"]
    assert drawn[-2:] == ["skin", "avatar_path"]
    assert draw(panels.LIVEHAND_PT_hand) == [
        "LiveHand",
        "LIVEHAND_PT_choose_avatar",
        "livehand.new_person",
        "livehand.adjust_person",
        "livehand.person_from_pictures",
    ]
    offered = draw(avatars.LIVEHAND_PT_choose_avatar)
    assert offered[:6:2] == ["livehand.wear_avatar"] * 3
    assert [Path(path).stem for path in offered[1:6:2]] == ["light", "middle", "deep"]
    hand.livehand.model_sha256 = "ab" * 32
    assert any(text.startswith("of another hand: hand_") for text in draw(avatars.LIVEHAND_PT_avatar))
    assert not [word for word in draw(avatars.LIVEHAND_PT_choose_avatar) if word == "livehand.wear_avatar"]


def test_the_panel_reports_a_missing_avatar():
    add_hand(bpy.context, load_default_hand()).livehand.avatar_path = "/nowhere/a.safetensors"
    drawn = draw(avatars.LIVEHAND_PT_avatar)
    assert "/nowhere/a.safetensors" in "".join(drawn[:-2])
    assert "LIVEHAND_PT_choose_avatar" in draw(panels.LIVEHAND_PT_hand)
    assert drawn[-1] == "avatar_path"


def test_a_hand_shows_ten_sliders():
    add_hand(bpy.context, load_default_hand())
    assert draw(panels.LIVEHAND_PT_shape)[:12] == ["beta"] * 10 + ["hair", "livehand.random_shape"]


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_picker_has_every_bone_in_the_order_of_the_fingers(side):
    assert not picker.LIVEHAND_PT_posing.poll(bpy.context)
    hand = add_hand(bpy.context, load_default_hand().for_side(side))
    drawn = draw(picker.LIVEHAND_PT_posing)
    shown = [name for name in drawn if name in hand.pose.bones]
    assert len(shown) == len(set(shown)) == 17 + 5
    knuckles = [name[:-3] for name in shown if name[-3] == "1"]
    fingers = ["thumb", "index", "middle", "ring", "pinky"]
    assert knuckles == (fingers if side == "right" else fingers[::-1])
    assert all(drawn.count(name) == 1 for name in SLIDERS if name not in ("beta", "follow"))


def test_a_hand_without_its_control_bones_shows_why_it_has_no_picker():
    hand = add_hand(bpy.context, load_default_hand())
    bpy.ops.object.mode_set(mode="EDIT")
    hand.data.edit_bones.remove(hand.data.edit_bones["IK-index.R"])
    bpy.ops.object.mode_set(mode="OBJECT")
    assert draw(picker.LIVEHAND_PT_posing) == ["No Finger Controls", "livehand.add_hand"]


def test_a_hand_can_be_matched_to_a_plate():
    assert not panels.LIVEHAND_PT_match_plate.poll(bpy.context)
    add_hand(bpy.context, load_default_hand())
    assert panels.LIVEHAND_PT_match_plate.poll(bpy.context)
    assert draw(panels.LIVEHAND_PT_match_plate) == ["exposure", "gain", "bias", "wrist_fade"]


def test_the_compositor_offers_both_set_ups():
    panel = compositing.LIVEHAND_PT_compositing
    assert draw(panel) == ["livehand.setup_compositing", "livehand.load_sequence_over_plate"]
    for kind, is_shown in (("CompositorNodeTree", True), ("ShaderNodeTree", False)):
        assert panel.poll(SimpleNamespace(space_data=SimpleNamespace(tree_type=kind))) is is_shown


def test_the_render_panel_offers_the_engine_until_it_is_set(monkeypatch):
    monkeypatch.setattr(packages, "cuda_of_driver", lambda: None)
    assert "livehand.set_engine" in draw(panels.LIVEHAND_PT_render)
    bpy.ops.livehand.set_engine()
    assert draw(panels.LIVEHAND_PT_render) == ["mode", "blur_samples", "skin_detail", "keep_look"]
    performance = ["device", "precision", "free_after_render", "livehand.free_memory"]
    assert draw(panels.LIVEHAND_PT_performance) == performance


def test_the_light_panel_says_where_there_is_none():
    assert draw(panels.LIVEHAND_PT_light) == ["light", "No Light: Hands Are Dark", "livehand.add_studio"]
    bpy.ops.livehand.add_studio()
    assert draw(panels.LIVEHAND_PT_light) == ["light", "livehand.add_studio", "livehand.remove_studio"]


def test_the_tab_is_avatar_pose_light_render_and_all_else_is_advanced():
    of_tab = [
        one
        for one in bpy.types.Panel.__subclasses__()
        if getattr(one, "bl_category", "") == "LiveHand" and one.bl_space_type == "VIEW_3D" and one.bl_label
    ]
    shown = [one for one in of_tab if "INSTANCED" not in getattr(one, "bl_options", ())]
    top = sorted((one for one in shown if not hasattr(one, "bl_parent_id")), key=lambda one: one.bl_order)
    assert [one.bl_label for one in top] == ["Packages", "Avatar", "Pose", "Light", "Render", "Advanced"]
    assert [one.bl_label for one in top if "DEFAULT_CLOSED" in getattr(one, "bl_options", ())] == ["Advanced"]
    below = {one.bl_label for one in shown if getattr(one, "bl_parent_id", "") == "LIVEHAND_PT_advanced"}
    assert below == {
        "Shape", "Match Plate", "Performance", "Avatar Details", "Mesh Texture", "Motion", "Video", "Retarget",
        "Custom Hand", "Origin",
    }  # fmt: skip
    assert all("DEFAULT_CLOSED" in one.bl_options for one in shown if hasattr(one, "bl_parent_id"))


@pytest.mark.parametrize(
    ("mode", "is_transparent", "is_determined"), [("SCENE", True, 1), ("SCENE", False, 0), ("HAND", True, 0)]
)
def test_a_film_that_hides_the_scenes_world_is_pointed_out(mode, is_transparent, is_determined):
    scene = bpy.context.scene
    scene.livehand.mode, scene.render.film_transparent = mode, is_transparent
    assert draw(panels.LIVEHAND_PT_render).count("film_transparent") == is_determined


def test_the_add_menu_has_an_entry():
    drawn = []
    panels._draw_add(SimpleNamespace(layout=Layout(drawn)), bpy.context)
    assert drawn == ["livehand.add_hand", "livehand.new_hand_scene"]


@pytest.mark.parametrize("panel", PANELS, ids=lambda panel: panel.__name__)
def test_every_text_fits_a_narrow_tab(panel, monkeypatch):
    fake = dependencies.Requirement("no_such_module_of_livehand", "fake>=1")
    monkeypatch.setattr(dependencies, "REQUIREMENTS", (fake,))
    bpy.context.scene.livehand.mode, bpy.context.scene.render.film_transparent = "SCENE", True
    empty = list(clipped(drawn_layout(panel))) if not hasattr(panel, "poll") or panel.poll(bpy.context) else []
    hand = add_hand(bpy.context, load_default_hand(), name="Right Hand")
    hand.livehand.other_rig.armature = hand
    assert empty + list(clipped(drawn_layout(panel))) == []


def test_the_bound_sees_what_a_window_clipped():
    layout = Layout([])
    row = layout.row()
    for name in ("FK", "IK", "Masters", "Mechanism"):
        row.label(text=name)
    assert list(clipped(layout)) == ["Mechanism"]
