"""Worlds that use other data: images in files and packed, groups, drivers, objects' coordinates, other .blend files."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

probe = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "light_probe.py")))


@pytest.fixture
def tree(registered):
    probe.white_patch()
    return probe.add_world()


def mean_radiance():
    return probe.light_now().sky.radiance.mean((0, 1))


def shine(tree, output):
    tree.links.new(output, tree.nodes["Background"].inputs["Color"])


def test_an_image_beside_the_blend_and_packed_in_it(tree, tmp_path):
    (tmp_path / "textures").mkdir()
    path = tmp_path / "textures" / "grey.png"
    image = bpy.data.images.new("Grey", 16, 8)
    image.pixels.foreach_set(np.tile(np.array([0.5, 0.5, 0.5, 1], np.float32), 16 * 8))
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load("//textures/grey.png")
    shine(tree, texture.outputs["Color"])
    np.testing.assert_allclose(mean_radiance(), 0.2158, atol=2e-3)  # 128/255 in sRGB
    texture.image.pack()
    path.unlink()
    np.testing.assert_allclose(mean_radiance(), 0.2158, atol=2e-3)


def test_what_only_the_camera_sees_inside_a_group(tree):
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    path, mix, out = (
        group.nodes.new(f"{kind}") for kind in ("ShaderNodeLightPath", "ShaderNodeMix", "NodeGroupOutput")
    )
    mix.data_type = "RGBA"
    mix.inputs[6].default_value, mix.inputs[7].default_value = (0.1, 0.2, 0.3, 1), (9, 9, 9, 1)
    group.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    group.links.new(mix.outputs[2], out.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    shine(tree, node.outputs[0])
    np.testing.assert_allclose(mean_radiance(), [0.1, 0.2, 0.3], rtol=1e-3)
    mix.inputs[6].default_value = (0.4, 0.2, 0.3, 1)
    np.testing.assert_allclose(mean_radiance(), [0.4, 0.2, 0.3], rtol=1e-3)


def test_a_driver_that_follows_an_object(tree):
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    shine(tree, gradient.outputs["Color"])
    before = mean_radiance()
    knob = bpy.data.objects.new("Knob", None)
    knob.location = (5, 0, 0)
    bpy.context.scene.collection.objects.link(knob)
    driver = tree.nodes["Background"].inputs["Strength"].driver_add("default_value").driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.type, variable.targets[0].id, variable.targets[0].transform_type = "TRANSFORMS", knob, "LOC_X"
    bpy.context.view_layer.update()
    np.testing.assert_allclose(mean_radiance(), 5 * before, rtol=1e-3)


def test_coordinates_of_an_object(tree, tmp_path):
    empty = bpy.data.objects.new("Axes", None)
    empty.rotation_euler = (0, 1.2, 0.3)
    bpy.context.scene.collection.objects.link(empty)
    coordinates, separate = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeSeparateXYZ")
    positive = tree.nodes.new("ShaderNodeMath")
    coordinates.object, positive.operation = empty, "MAXIMUM"
    tree.links.new(coordinates.outputs["Object"], separate.inputs[0])
    tree.links.new(separate.outputs["Z"], positive.inputs[0])
    positive.inputs[1].default_value = 0.0
    shine(tree, positive.outputs[0])
    for normal in probe.NORMALS[:5:2]:
        probe.face(normal)
        cycles = probe.cycles_pixels(tmp_path).mean((0, 1))
        np.testing.assert_allclose(probe.expected_pixels(probe.light_now()).mean((0, 1)), cycles, rtol=0.02)


def test_a_world_linked_from_another_file(tree, tmp_path):
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    shine(tree, gradient.outputs["Color"])
    expected = mean_radiance()
    path = tmp_path / "worlds.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    probe.white_patch()
    with bpy.data.libraries.load(str(path), link=True) as (source, wanted):
        wanted.worlds = source.worlds
    bpy.context.scene.world = wanted.worlds[0]
    np.testing.assert_allclose(mean_radiance(), expected, rtol=1e-6)
