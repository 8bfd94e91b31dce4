"""What materials shed of light: base colour, less metal and glass; a guess where nodes colour them."""

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.light.albedo import BARE, UNKNOWN, albedo_of

COLOUR = (0.2, 0.5, 0.1)


@pytest.fixture
def material():
    """Of one colour."""
    made = bpy.data.materials.new("Paint")
    made.use_nodes = True
    made.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*COLOUR, 1)
    return made


def with_shader(material, kind):
    tree = material.node_tree
    shader = tree.nodes.new(kind)
    shader.inputs["Color"].default_value = (*COLOUR, 1)
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def test_a_principled_base_colour(material):
    np.testing.assert_allclose(albedo_of(material), COLOUR, atol=1e-6)


@pytest.mark.parametrize("name", ["Metallic", "Transmission Weight"])
def test_metal_and_glass_shed_less(material, name):
    material.node_tree.nodes["Principled BSDF"].inputs[name].default_value = 0.75
    np.testing.assert_allclose(albedo_of(material), np.multiply(COLOUR, 0.25), atol=1e-6)


def test_other_shaders(material):
    np.testing.assert_allclose(albedo_of(with_shader(material, "ShaderNodeBsdfDiffuse")), COLOUR, atol=1e-6)
    np.testing.assert_allclose(albedo_of(with_shader(material, "ShaderNodeBsdfGlass")), 0)
    np.testing.assert_allclose(albedo_of(with_shader(material, "ShaderNodeEmission")), UNKNOWN)


def test_a_colour_from_a_node_and_from_a_texture(material):
    tree = material.node_tree
    base = tree.nodes["Principled BSDF"].inputs["Base Color"]
    rgb = tree.nodes.new("ShaderNodeRGB")
    rgb.outputs[0].default_value = (0.3, 0.4, 1.5, 1)
    tree.links.new(rgb.outputs[0], base)
    np.testing.assert_allclose(albedo_of(material), [0.3, 0.4, 1], atol=1e-6)
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], base)
    np.testing.assert_allclose(albedo_of(material), UNKNOWN)


@pytest.mark.parametrize(
    ("space", "is_float", "expected"),
    [("sRGB", False, 0.2140), ("Non-Color", False, 0.5), ("sRGB", True, 0.5), ("ACEScg", False, UNKNOWN)],
)
def test_an_image_has_its_mean_colour_in_linear_light(material, space, is_float, expected):
    """Of a picture one half of which is black: half of the colour, whether it is encoded or not."""
    image = bpy.data.images.new("Half", 8, 4, float_buffer=is_float)
    image.colorspace_settings.name = space
    pixels = np.zeros((4, 8, 4), np.float32)
    pixels[:, :, 3], pixels[:2, :, :3] = 1, (0.5, 1, 0)
    image.pixels.foreach_set(pixels.ravel())
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    mean = [expected / 2, 0.5, 0] if space != "ACEScg" else [UNKNOWN] * 3
    np.testing.assert_allclose(albedo_of(material), mean, atol=2e-3)
    pixels[:2, :, :3] = 0
    image.pixels.foreach_set(pixels.ravel())
    np.testing.assert_allclose(albedo_of(material), 0 if space != "ACEScg" else UNKNOWN, atol=2e-3)


def test_a_texture_without_an_image(material):
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    np.testing.assert_allclose(albedo_of(material), UNKNOWN)


@pytest.mark.parametrize("source", ["SEQUENCE", "MOVIE", "TILED"])
def test_films_and_tiles_are_not_told_by_one_frame(material, source):
    image = bpy.data.images.new("Film", 8, 4)
    image.pixels.foreach_set(np.ones(8 * 4 * 4, np.float32))
    image.source = source
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    np.testing.assert_allclose(albedo_of(material), UNKNOWN)


def test_without_a_material_or_an_output(material):
    np.testing.assert_allclose(albedo_of(None), BARE)
    material.node_tree.nodes.remove(material.node_tree.nodes["Material Output"])
    np.testing.assert_allclose(albedo_of(material), UNKNOWN)
