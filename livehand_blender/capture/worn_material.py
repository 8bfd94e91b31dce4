"""The skin of one person, who has an avatar, as a Cycles material of textures; its folds follow the pose as all do."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.avatars.worn_skin import WornSkin
from ...backend.surface.detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from ...backend.surface.shading_detail import FOLD_LOG_ALBEDO
from .node_graph import NodeGraph, Socket, enable_nodes
from .skin import NAIL_ROUGHNESS, UV_LAYER, SkinShape, SkinTone, connect_skin, nail_subsurface

_ALPHA = 3


def worn_material(skin: WornSkin) -> bpy.types.Material:
    """Make the material of a person's skin, for the hand that captures show."""
    material = bpy.data.materials.new("worn skin")
    graph = NodeGraph(enable_nodes(material))
    uv = graph.node("ShaderNodeUVMap", uv_map=UV_LAYER).outputs[0]

    def texture(name: str, values: np.ndarray) -> Socket:
        node = graph.node("ShaderNodeTexImage", interpolation="Linear")
        node.image = texture_image(name, values)
        graph.connect(uv, node.inputs[0])
        return node.outputs["Color"]

    relief, dorsal, palmar = graph.separate(texture("heights", skin.heights))
    dorsal_shade, palmar_shade, _ = graph.separate(texture("fold shade", skin.fold_shade))
    skin_roughness, nail, _ = graph.separate(texture("gloss", skin.gloss))
    flex = graph.attribute("flex")
    of_dorsal = graph.one_minus(graph.product(flex, FLATTENED), clamp=True)
    of_palmar = graph.total(DEEPENED_FROM, graph.product(flex, DEEPENED_BY))
    tone = SkinTone.of(skin.person)
    blanch = graph.product(graph.math("MULTIPLY", graph.attribute("knuck"), flex, clamp=True), tone.blanched)
    colour = graph.mix(blanch, texture("base color", skin.base_color), tone.blanch)
    shade = graph.total(graph.product(dorsal_shade, of_dorsal), graph.product(palmar_shade, of_palmar))
    darker = graph.combine(*(graph.math("EXPONENT", graph.product(shade, log)) for log in FOLD_LOG_ALBEDO))
    rough = graph.total(graph.product(skin_roughness, graph.one_minus(nail)), graph.product(nail, NAIL_ROUGHNESS))
    shape = SkinShape(
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
