"""The hand of captures in the skin of one person, who has an avatar: a Cycles material of textures.

Its folds and its blood follow the pose as those of the procedural skin do.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...backend.avatars.worn_textures import WornTextures
from ...backend.hand.model import HandModel
from ...backend.surface.detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from ...backend.surface.shading_detail import FOLD_LOG_ALBEDO
from ...backend.teacher.detailed_surface import detailed_surface
from .bake import bake_skin
from .node_graph import NodeGraph, Socket, enable_nodes
from .skin import NAIL_ROUGHNESS, UV_LAYER, PosedRelief, SkinTone, connect_skin, nail_subsurface
from .surface import SkinSurface

_ALPHA, _BAKED_PX = 3, 1024
_LEAST_SCATTERED = 0.98  # of light, in skin that is no nail


@dataclass(frozen=True)
class DressedHand:
    """A built-in hand model in the skin of one person."""

    model: HandModel
    textures: WornTextures


def dressed_surface(hand: DressedHand, maps_folder: Path) -> SkinSurface:
    """Add the detailed hand to the scene, with the person's veins and skin.

    The folder gets the baked maps of the person whom the avatar's networks know, or has them.
    """
    textures = hand.textures
    detail = detailed_surface(hand.model).worn(hand.model, textures.vein, textures.padding_mm, textures.drains)
    surface = SkinSurface.create(hand.model, detail.with_tendons(textures.person.tendons), textures.person.veins_mm)
    known = bake_skin(surface.object, maps_folder, SkinTone.of(textures.trained_on), _BAKED_PX)
    size = len(textures.network_albedo)
    is_nail = _map(known["mask"], size)[..., 1] < _LEAST_SCATTERED
    surface.object.data.materials.append(
        worn_material(textures, textures.base_color(_map(known["albedo"], size), is_nail))
    )
    return surface


def _map(path: Path, size: int) -> np.ndarray:
    """Read a baked map [size, size, 3], the row of the smallest v first; 0 where it is not all skin."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    blocks = values.reshape(size, height // size, size, width // size, 4)[..., :3]
    return np.where((blocks.sum(-1) > 0).all((1, 3))[..., None], blocks.mean((1, 3)), 0)


def worn_material(textures: WornTextures, base_color: np.ndarray) -> bpy.types.Material:
    """Make the material of a person's skin, for the hand that captures show."""
    material = bpy.data.materials.new("worn skin")
    graph = NodeGraph(enable_nodes(material))
    uv = graph.node("ShaderNodeUVMap", uv_map=UV_LAYER).outputs[0]

    def texture(name: str, values: np.ndarray) -> Socket:
        node = graph.node("ShaderNodeTexImage", interpolation="Linear")
        node.image = texture_image(name, values)
        graph.connect(uv, node.inputs[0])
        return node.outputs["Color"]

    relief, dorsal, palmar = graph.separate(texture("heights", textures.heights))
    dorsal_shade, palmar_shade, _ = graph.separate(texture("fold shade", textures.fold_shade))
    skin_roughness, nail, _ = graph.separate(texture("gloss", textures.gloss))
    flex = graph.attribute("flex")
    of_dorsal = graph.one_minus(graph.product(flex, FLATTENED), clamp=True)
    of_palmar = graph.total(DEEPENED_FROM, graph.product(flex, DEEPENED_BY))
    tone = SkinTone.of(textures.person)
    blanch = graph.product(graph.math("MULTIPLY", graph.attribute("knuck"), flex, clamp=True), tone.blanched)
    colour = graph.mix(blanch, texture("base color", base_color), tone.blanch)
    drained = graph.attribute("drained")
    logs = (-float(log) for log in textures.joint_log_color)
    paler = graph.combine(*(graph.math("EXPONENT", graph.product(drained, log)) for log in logs))
    colour = graph.mix(1.0, colour, paler, "MULTIPLY")
    shade = graph.total(graph.product(dorsal_shade, of_dorsal), graph.product(palmar_shade, of_palmar))
    darker = graph.combine(*(graph.math("EXPONENT", graph.product(shade, log)) for log in FOLD_LOG_ALBEDO))
    rough = graph.total(graph.product(skin_roughness, graph.one_minus(nail)), graph.product(nail, NAIL_ROUGHNESS))
    shape = PosedRelief(
        relief=relief,
        dorsal=graph.product(dorsal, of_dorsal),
        palmar=graph.product(palmar, of_palmar),
        roughness=rough,
        subsurface=nail_subsurface(graph, nail, graph.attribute("naily")),
    )
    connect_skin(graph, graph.tree.nodes["Principled BSDF"], graph.mix(1.0, colour, darker, "MULTIPLY"), shape, tone)
    return material


def texture_image(name: str, values: np.ndarray) -> bpy.types.Image:
    """Make a linear image of values [A, A, C], at most three, the row of the smallest v first, as Blender's are."""
    size, channels = len(values), values.shape[-1]
    image = bpy.data.images.new(name, size, size, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((size, size, 4), np.float32)
    pixels[..., :channels] = values
    pixels[..., channels:_ALPHA] = 0
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()  # or Cycles may ask for a file
    return image
