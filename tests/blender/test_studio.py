"""Studio lights: added and removed in one click, and a plain hand in them looks as a photographer would light it."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.capture.node_graph import enable_nodes
from livehand.livehand_blender.light.studio import add_studio, has_studio, needs_light
from livehand.livehand_blender.rig.build import add_hand
from mathutils import Vector
from PIL import Image


def studio_lamps():
    return [thing for thing in bpy.context.scene.objects if thing.type == "LIGHT"]


def test_the_operator_adds_lamps_in_a_collection_and_a_dim_world():
    bpy.ops.livehand.add_hand()
    world = bpy.context.scene.world = bpy.data.worlds.new("Mine")
    assert bpy.ops.livehand.add_studio() == {"FINISHED"}
    assert {lamp.users_collection[0].name for lamp in studio_lamps()} == {"Studio Lights"}
    assert [lamp.data.type for lamp in studio_lamps()] == ["AREA"] * 3
    assert bpy.context.scene.world != world
    bpy.ops.livehand.add_studio()
    assert len(studio_lamps()) == 3
    assert bpy.ops.livehand.remove_studio() == {"FINISHED"}
    assert studio_lamps() == []
    assert bpy.context.scene.world == world
    assert "Studio Lights" not in bpy.data.collections
    assert [one.name for one in bpy.data.worlds] == ["Mine"]
    assert not bpy.ops.livehand.remove_studio.poll()


def test_the_tab_asks_for_lamps_where_a_dim_world_alone_lights_the_hands():
    scene, layer = bpy.context.scene, bpy.context.view_layer
    scene.world = None
    assert needs_light(scene, layer)
    scene.world = bpy.data.worlds.new("As in a new file")
    background = enable_nodes(scene.world).nodes["Background"].inputs["Color"]
    background.default_value = (0.05, 0.05, 0.05, 1)
    assert needs_light(scene, layer)
    background.default_value = (0.5, 0.5, 0.5, 1)
    assert not needs_light(scene, layer)
    scene.world = None
    bpy.ops.livehand.add_studio()
    assert not needs_light(scene, layer)
    for lamp in studio_lamps():
        lamp.hide_render = True
    assert needs_light(scene, layer)


def test_removing_keeps_what_the_user_has_added():
    bpy.ops.livehand.add_studio()
    mine = bpy.data.objects.new("My Lamp", bpy.data.lights.new("My Lamp", "POINT"))
    bpy.data.collections["Studio Lights"].objects.link(mine)
    bpy.context.scene.collection.objects.link(mine)
    world = bpy.context.scene.world = bpy.data.worlds.new("Mine")
    bpy.ops.livehand.remove_studio()
    assert studio_lamps() == [mine]
    assert bpy.context.scene.world == world


def test_add_hand_offers_it_and_undo_takes_it_back():
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.livehand.add_hand(studio=True)
    bpy.ops.ed.undo_push(message="after")
    assert len(studio_lamps()) == 3
    assert has_studio(bpy.context.scene)
    bpy.ops.ed.undo()
    assert studio_lamps() == []
    assert not has_studio(bpy.context.scene)
    bpy.ops.livehand.add_hand()
    assert studio_lamps() == []


def test_all_lamps_shine_at_the_hand_from_the_cameras_sides():
    hand = add_hand(bpy.context, load_default_hand())
    hand.location, hand.scale = (1, 2, 3), (2, 2, 2)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (4, 2, 3.5)  # it looks along -X: its left is -Y
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    bpy.context.view_layer.update()
    add_studio(bpy.context, hand)
    bpy.context.view_layer.update()
    lamps = {lamp.name.split()[-1]: lamp.matrix_world for lamp in studio_lamps()}
    for matrix in lamps.values():
        towards = Vector((1, 2, 3)) - matrix.translation
        assert towards.angle(-matrix.col[2].to_3d()) < 0.3
        assert 1.4 < towards.length < 2.4
    key, fill, rim = (lamps[name].translation - Vector((1, 2, 3)) for name in ("Key", "Fill", "Rim"))
    assert key.x > 0.3
    assert key.y < -0.3
    assert fill.x > 0.3
    assert fill.y > 0.3
    assert rim.x < -0.3


@pytest.mark.parametrize("distance", [Vector((0, -0.7, 0.12)), Vector((0.1, 0.7, 0.1))], ids=["back", "palm"])
def test_a_hand_of_plain_skin_is_lit_as_in_a_photograph(tmp_path, distance):
    bpy.ops.livehand.add_hand()
    scene, hand = bpy.context.scene, bpy.context.active_object
    bpy.context.view_layer.update()
    middle = sum((hand.matrix_world @ Vector(corner) for corner in hand.livehand.mesh.bound_box), Vector()) / 8
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.data.lens = middle + distance, 125
    camera.rotation_euler = (-distance).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.context.view_layer.update()
    bpy.ops.livehand.add_studio()
    lightness = rendered_lightness(scene, tmp_path / "hand.png")
    low, high = np.percentile(lightness, (2, 98))
    assert 52 < lightness.mean() < 66
    assert high - low > 35
    assert high < 95


def rendered_lightness(scene, path):
    """L* of the hand's pixels in Cycles, in the Standard view."""
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 32, False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = 56, 66
    scene.render.film_transparent, scene.view_settings.view_transform = True, "Standard"
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    rgba = np.array(Image.open(path)) / 255
    srgb = rgba[rgba[..., 3] == 1, :3]
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return 116 * np.where(luminance > 216 / 24389, np.cbrt(luminance), luminance * 24389 / 3132 + 16 / 116) - 16
