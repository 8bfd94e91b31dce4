"""The diffuse colour of materials, by which nearby objects reflect light on a hand."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import bpy
import mathutils
import numpy as np

from ..scene.colour import in_rec709
from ..scene.node_values import image_state, used_nodes

UNKNOWN = 0.5
"""Albedo of what nodes colour, but for an image alone: that has its mean."""
BARE = 0.8
"""Cycles' own for objects without a material."""

_STILL = ("FILE", "GENERATED")
_LINEAR = ("Non-Color", "Linear Rec.709", "Linear")
_KEPT = 256
_MOST_VALUES = 1 << 20


def albedo_of(material: bpy.types.Material | None) -> np.ndarray:
    """Read the albedo [3] for diffuse light, linear Rec.709 in 0..1; metal and glass have none."""
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
    """Find the node that is linked to the surface of Cycles' active output."""
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
    """Read the number of an input of 0..1; 0 where it is linked or does not exist."""
    socket = shader.inputs.get(name)
    return 0.0 if socket is None or socket.is_linked else float(np.clip(socket.default_value, 0, 1))


@dataclass(frozen=True)
class _Image:
    """An image, equal to another in the same state."""

    state: str
    image: bpy.types.Image = field(compare=False)


def mean_colour(image: bpy.types.Image) -> np.ndarray | None:
    """Average to [3] linear Rec.709; None without pixels, for films, tiles, and spaces neither sRGB nor linear."""
    if image.source not in _STILL:  # of others Blender gives the pixels of one frame or tile
        return None
    return _mean_colour(_Image(str(image_state(image)), image))


@lru_cache(maxsize=_KEPT)
def _mean_colour(one: _Image) -> np.ndarray | None:
    image = one.image
    if len(image.pixels) == 0:
        return None
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    rgba = values.reshape(-1, image.channels)
    colours = rgba[:: -(-len(values) // _MOST_VALUES), : min(image.channels, 3)]
    space = image.colorspace_settings.name
    if image.is_float:  # Blender has converted these
        return in_rec709(_rgb(colours))
    if space in _LINEAR:
        return _rgb(colours)
    return _rgb(_decoded()[np.rint(255 * colours).astype(int)]) if space == "sRGB" else None


def _decoded() -> np.ndarray:
    """Decode the values of an sRGB byte to linear light [256]."""
    return np.array([mathutils.Color([value / 255] * 3).from_srgb_to_scene_linear().r for value in range(256)])


def _rgb(colours: np.ndarray) -> np.ndarray:
    """Average colours [N, 1 or 3] to [3]."""
    return np.broadcast_to(colours.mean(0, dtype=float), 3).copy()
