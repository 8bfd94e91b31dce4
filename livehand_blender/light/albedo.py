"""The diffuse colour of materials, by which objects around a hand shed light on it."""

from __future__ import annotations

import bpy
import numpy as np

from ..scene.colour import in_rec709
from ..scene.image_mean import mean_colour
from ..scene.node_values import used_nodes

UNKNOWN = 0.5
"""Albedo of what nodes colour, but for an image alone: that has its mean."""
BARE = 0.8
"""Cycles' own for objects without a material."""


def albedo_of(material: bpy.types.Material | None) -> np.ndarray:
    """[3] linear Rec.709 in 0..1: of the diffuse light that a surface sheds; metal and glass shed none."""
    if material is None:
        return np.full(3, BARE)
    tree = used_nodes(material)
    if tree is None:
        return _in_rec709(material.diffuse_color)
    shader = _shader(tree)
    if shader is None:
        return np.full(3, UNKNOWN)
    if shader.bl_idname == "ShaderNodeBsdfPrincipled":
        share = np.prod([1 - _number(shader, name) for name in ("Metallic", "Transmission Weight")])
        return share * _colour(shader, "Base Color")
    if shader.bl_idname == "ShaderNodeBsdfDiffuse":
        return _colour(shader, "Color")
    return np.zeros(3) if shader.bl_idname.startswith("ShaderNodeBsdf") else np.full(3, UNKNOWN)


def _shader(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The node that is linked to the surface of Cycles' active output."""
    output = tree.get_output_node("CYCLES")
    links = output.inputs["Surface"].links if output else ()
    return links[0].from_node if links else None


def _colour(shader: bpy.types.Node, name: str) -> np.ndarray:
    socket = shader.inputs[name]
    if not socket.is_linked:
        return _in_rec709(socket.default_value)
    source = socket.links[0].from_node
    if source.bl_idname == "ShaderNodeRGB":
        return _in_rec709(source.outputs[0].default_value)
    image = source.image if source.bl_idname == "ShaderNodeTexImage" else None
    mean = None if image is None else mean_colour(image)
    return np.full(3, UNKNOWN) if mean is None else mean.clip(0, 1)


def _in_rec709(colour: bpy.types.bpy_prop_array) -> np.ndarray:
    return np.clip(in_rec709(np.array(colour[:3], float)), 0, 1)


def _number(shader: bpy.types.Node, name: str) -> float:
    """Of an input of 0..1; 0 where it is linked or does not exist."""
    socket = shader.inputs.get(name)
    return 0.0 if socket is None or socket.is_linked else float(np.clip(socket.default_value, 0, 1))
