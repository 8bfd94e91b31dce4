"""Panels draw without an error: a stand-in layout checks every name against Blender's own."""

from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.runtime import dependencies
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands
from livehand.livehand_blender.rig.sliders import SLIDERS
from livehand.livehand_blender.ui import avatars, compositing, panels, picker
from livehand.livehand_blender.ui.preferences import LIVEHAND_AP_preferences

UI = bpy.types.UILayout.bl_rna.functions


class Layout:
    """Records what is drawn; rejects arguments, icons, properties and operators that Blender does not have."""

    def __init__(self, drawn):
        self.drawn = drawn

    def column(self, **arguments):
        check_arguments("column", arguments)
        return Layout(self.drawn)

    def row(self, **arguments):
        check_arguments("row", arguments)
        return Layout(self.drawn)

    def split(self, **arguments):
        check_arguments("split", arguments)
        return Layout(self.drawn)

    def grid_flow(self, **arguments):
        check_arguments("grid_flow", arguments)
        return Layout(self.drawn)

    def template_icon(self, icon_value, **arguments):
        check_arguments("template_icon", arguments)

    def popover(self, panel, **arguments):
        check_arguments("popover", arguments)
        assert hasattr(bpy.types, panel)
        self.drawn.append(panel)

    def box(self):
        return Layout(self.drawn)

    def separator(self, **arguments):
        check_arguments("separator", arguments)

    def label(self, **arguments):
        check_arguments("label", arguments)
        self.drawn.append(arguments["text"])

    def prop(self, owner, name, **arguments):
        check_arguments("prop", arguments)
        assert name in owner.bl_rna.properties or owner.path_resolve(name) is not None
        self.drawn.append(name.strip('["]'))

    def operator(self, name, **arguments):
        check_arguments("operator", arguments)
        rna = getattr(bpy.ops.livehand, name.partition(".")[2]).get_rna_type()
        self.drawn.append(name)
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
    drawn = []
    panel.draw(SimpleNamespace(layout=Layout(drawn), bl_rna=panel.bl_rna), bpy.context)
    return drawn


def test_without_a_hand_the_tab_offers_to_add_one():
    assert "livehand.add_hand" in draw(panels.LIVEHAND_PT_hand)
    assert not panels.LIVEHAND_PT_shape.poll(bpy.context)


def test_a_hand_shows_its_avatar_and_a_choice():
    hand = add_hand(bpy.context, load_default_hand())
    drawn = draw(avatars.LIVEHAND_PT_avatar)
    assert drawn[:2] == ["light", "Licence: GPL-3.0-or-later"]
    assert drawn[-2:] == ["skin", "avatar_path"]
    assert "LIVEHAND_PT_choose_avatar" in draw(panels.LIVEHAND_PT_hand)
    offered = draw(avatars.LIVEHAND_PT_choose_avatar)
    assert offered[:4:2] == ["livehand.wear_avatar"] * 2
    assert [Path(path).name for path in offered[1:4:2]] == ["light.safetensors", "deep.safetensors"]
    hand.livehand.model_sha256 = "ab" * 32
    assert "of another hand: hand_default" in draw(avatars.LIVEHAND_PT_avatar)
    assert not [word for word in draw(avatars.LIVEHAND_PT_choose_avatar) if word == "livehand.wear_avatar"]


def test_the_panel_reports_a_missing_avatar():
    add_hand(bpy.context, load_default_hand()).livehand.avatar_path = "/nowhere/a.safetensors"
    drawn = draw(avatars.LIVEHAND_PT_avatar)
    assert "/nowhere/a.safetensors" in "".join(drawn[:-2])
    assert "LIVEHAND_PT_choose_avatar" in draw(panels.LIVEHAND_PT_hand)
    assert drawn[-1] == "avatar_path"


def test_a_hand_shows_ten_sliders():
    add_hand(bpy.context, load_default_hand())
    assert draw(panels.LIVEHAND_PT_shape)[:11] == ["beta"] * 10 + ["livehand.random_shape"]


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_picker_has_every_bone_in_the_order_of_the_fingers(side):
    assert not picker.LIVEHAND_PT_posing.poll(bpy.context)
    hand = add_hand(bpy.context, load_default_hand().for_side(side))
    drawn = draw(picker.LIVEHAND_PT_posing)
    shown = [name for name in drawn if name in hand.pose.bones]
    assert len(shown) == len(set(shown)) == 16 + 5
    knuckles = [name[:-3] for name in shown if name[-3] == "1"]
    fingers = ["thumb", "index", "middle", "ring", "pinky"]
    assert knuckles == (fingers if side == "right" else fingers[::-1])
    assert all(drawn.count(name) == 1 for name in SLIDERS if name not in ("beta", "follow"))


def test_a_hand_of_an_earlier_version_shows_why_it_has_no_picker():
    bpy.ops.wm.open_mainfile(filepath=str(Path(__file__).with_name("earlier_version.blend")))
    bpy.context.view_layer.objects.active = find_hands(bpy.context.scene)[0]
    (message,) = draw(picker.LIVEHAND_PT_posing)
    assert "without finger controls" in message


def test_a_hand_can_be_matched_to_a_plate():
    assert not panels.LIVEHAND_PT_match_plate.poll(bpy.context)
    add_hand(bpy.context, load_default_hand())
    assert panels.LIVEHAND_PT_match_plate.poll(bpy.context)
    assert draw(panels.LIVEHAND_PT_match_plate) == ["exposure", "gain", "bias"]


def test_the_compositor_offers_both_set_ups():
    panel = compositing.LIVEHAND_PT_compositing
    assert draw(panel) == ["livehand.setup_compositing", "livehand.load_sequence_over_plate"]
    for kind, is_shown in (("CompositorNodeTree", True), ("ShaderNodeTree", False)):
        assert panel.poll(SimpleNamespace(space_data=SimpleNamespace(tree_type=kind))) is is_shown


def test_the_render_panel_offers_the_engine_until_it_is_set():
    assert "livehand.set_engine" in draw(panels.LIVEHAND_PT_render)
    bpy.ops.livehand.set_engine()
    assert draw(panels.LIVEHAND_PT_render)[:5] == ["mode", "light", "rough_light", "blur_samples", "device"]
    assert "keep_look" in draw(panels.LIVEHAND_PT_render)


@pytest.mark.parametrize("panel", [panels.LIVEHAND_PT_render, LIVEHAND_AP_preferences])
def test_missing_packages_are_named_with_a_way_to_install_them(panel, monkeypatch):
    assert "livehand.copy_install_command" not in draw(panel)
    fake = dependencies.Requirement("no_such_module_of_livehand", "fake>=1")
    monkeypatch.setattr(dependencies, "REQUIREMENTS", (fake,))
    monkeypatch.setattr("livehand.livehand_blender.ui.preferences.REQUIREMENTS", (fake,))
    assert "livehand.copy_install_command" in draw(panel)


@pytest.mark.parametrize(
    ("mode", "is_transparent", "is_told"), [("SCENE", True, 1), ("SCENE", False, 0), ("HAND", True, 0)]
)
def test_a_film_that_hides_the_scenes_world_is_pointed_out(mode, is_transparent, is_told):
    scene = bpy.context.scene
    scene.livehand.mode, scene.render.film_transparent = mode, is_transparent
    assert draw(panels.LIVEHAND_PT_render).count("film_transparent") == is_told


def test_the_add_menu_has_an_entry():
    drawn = []
    panels._draw_add(SimpleNamespace(layout=Layout(drawn)), bpy.context)
    assert drawn == ["livehand.add_hand"]
