"""Cycles still works beside our engine, which borrows from it, and hands are hidden from its camera only."""

import bpy
import numpy as np
from livehand.livehand_blender.hands.proxy import hidden_from_camera
from livehand.livehand_blender.hands.visible_hands import InstanceId
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from PIL import Image


def test_cycles_still_renders(hand_scene, tmp_path):
    hand_scene.world = bpy.data.worlds.new("World")
    if hand_scene.world.node_tree is None:  # before Blender 5
        hand_scene.world.use_nodes = True
    render = hand_scene.render
    render.engine, render.film_transparent = "CYCLES", False
    render.resolution_x, render.resolution_y = 8, 8
    hand_scene.cycles.samples, hand_scene.cycles.use_denoising = 1, False
    render.filepath, render.image_settings.file_format = str(tmp_path / "still.png"), "PNG"
    bpy.ops.render.render(write_still=True)
    assert np.array(Image.open(tmp_path / "still.png"))[..., :3].max() > 20


def test_hands_are_hidden_in_the_context_only_and_nothing_is_tagged(hand_scene):
    mesh = mesh_of(find_hands(hand_scene)[0])
    cube = bpy.data.objects.new("Cube", bpy.data.meshes.new("Cube"))
    hidden_cube = bpy.data.objects.new("Hidden", bpy.data.meshes.new("Hidden"))
    hidden_cube.visible_camera = False
    for thing in (cube, hidden_cube):
        hand_scene.collection.objects.link(thing)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    updates = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: updates.append(True))

    def seen():
        return [thing.evaluated_get(depsgraph).visible_camera for thing in (mesh, cube, hidden_cube)]

    try:
        with hidden_from_camera(depsgraph, [InstanceId(mesh.name)]):
            assert seen() == [False, True, False]
            assert mesh.visible_camera
        assert seen() == [True, True, False]
        bpy.context.view_layer.update()
        assert not updates
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
