"""Captures of the very person of an avatar: what the command asks for, and what the material is made of."""

from argparse import ArgumentParser
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.surface.shading_detail import FOLD_LOG_ALBEDO
from livehand.livehand_blender.capture import command
from livehand.livehand_blender.capture import render as capture_render
from livehand.livehand_blender.capture.dressed_hand import DressedHand, texture_image, worn_material

SIZE = 4


@pytest.fixture
def textures():
    """Small textures of one value each, of the person of the light avatar."""
    person = SimpleNamespace(melanin=0.0, blood=1.0, folds=1.5, freckles=0.0, nail_polish=None)
    square = np.ones((SIZE, SIZE, 3), np.float32)
    return SimpleNamespace(
        person=person,
        heights=(0.1, 0.2, 0.3) * square,
        fold_shade=0.4 * square[..., :2],
        gloss=0.5 * square[..., :2],
        joint_log_color=np.array((-0.02, -0.3, -0.35)),
    )


def asked_of(monkeypatch, tmp_path, *options):
    """The plan and the hand that the command passes on."""
    asked = []

    def fake(folder, plan, provenance, threads, hand=None):
        asked.append((plan, hand, provenance))
        return plan.make(folder, load_default_hand(), provenance)

    monkeypatch.setattr(capture_render, "render_capture", fake)
    parser = ArgumentParser()
    command.add_arguments(parser)
    command.run(parser.parse_args(["-o", str(tmp_path), "--poses", "2", "--cameras", "4", *options]))
    return asked[0]


def test_the_person_of_an_avatar_s_file_is_shown_with_their_shape(monkeypatch, tmp_path):
    path = shipped_avatar_path("middle")
    plan, hand, provenance = asked_of(monkeypatch, tmp_path, "--person", str(path))
    assert isinstance(hand, DressedHand)
    assert hand.model.sha256 == load_default_hand().sha256
    assert plan.person == hand.textures.person
    assert plan.person.beta[0] == -0.8
    assert provenance["worn_skin"]
    assert "skin_tone" not in provenance  # or it would pass for the procedural skin of that tone


def test_an_avatar_s_person_has_no_hand_of_one_s_own(monkeypatch, tmp_path):
    path = shipped_avatar_path("middle")
    with pytest.raises(LiveHandError, match=r"has the built-in hand, got --hand mine\.npz; leave one of both out"):
        asked_of(monkeypatch, tmp_path, "--person", str(path), "--hand", "mine.npz")


def test_the_first_row_of_a_texture_is_the_lowest_of_its_image():
    bpy.ops.wm.read_homefile(use_empty=True)
    values = np.linspace(-0.2, 1.5, SIZE * SIZE * 2).reshape(SIZE, SIZE, 2)
    image = texture_image("two channels", values)
    pixels = np.array(image.pixels[:]).reshape(SIZE, SIZE, 4)
    assert pixels[..., :2] == pytest.approx(values)
    assert (pixels[..., 2] == 0).all()
    assert image.colorspace_settings.name == "Non-Color"


def test_the_material_shows_the_person_s_colors_folds_and_nails(textures):
    bpy.ops.wm.read_homefile(use_empty=True)
    material = worn_material(textures, np.full((SIZE, SIZE, 3), (0.6, 0.4, 0.3), np.float32))
    for (red, green, blue), flex in zip(colors_of(material, (0.0, 1.0)), (0.0, 1.0), strict=True):
        shade = 0.4 * (1 - 0.72 * flex) + 0.4 * (0.75 + 0.5 * flex)
        expected = np.array((0.6, 0.4, 0.3)) * np.exp(shade * np.array(FOLD_LOG_ALBEDO))
        assert (red, green, blue) == pytest.approx(expected, rel=0.01)


def test_skin_without_the_blood_of_its_joint_is_paler(textures):
    bpy.ops.wm.read_homefile(use_empty=True)
    material = worn_material(textures, np.full((SIZE, SIZE, 3), (0.6, 0.4, 0.3), np.float32))
    full, drained = colors_of(material, (0.0, 0.8), "drained")
    assert drained / full == pytest.approx(np.exp(0.8 * np.array((0.02, 0.3, 0.35))), rel=0.01)


def colors_of(material, flexes, attribute="flex"):
    """The base color of a plane of this material at each bend, as Cycles emits it."""
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(shader.inputs["Base Color"].links[0].from_socket, emission.inputs[0])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs[0])
    bpy.ops.mesh.primitive_plane_add()
    plane = bpy.context.object
    plane.data.uv_layers[0].name = "uv"
    plane.data.materials.append(material)
    plane.data.attributes.new(attribute, "FLOAT", "POINT")
    target = tree.nodes.new("ShaderNodeTexImage")
    target.image = bpy.data.images.new("baked", 4, 4, float_buffer=True)
    target.image.colorspace_settings.name = "Non-Color"
    tree.nodes.active = target
    bpy.context.scene.render.engine = "CYCLES"
    bpy.context.scene.cycles.samples = 1
    for flex in flexes:
        plane.data.attributes[attribute].data.foreach_set("value", [flex] * 4)
        bpy.ops.object.bake(type="EMIT")
        yield np.array(target.image.pixels[:]).reshape(4, 4, 4)[1, 1, :3]
