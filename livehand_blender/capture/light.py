"""The dome of captures as a world: in world space, so that self-shadowing depends on the pose."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.capture.dome import GROUND, LOBES, ZENITH, Lobe
from .node_graph import NodeGraph, enable_nodes


def dome_world() -> bpy.types.World:
    """A gradient from ground to sky, and four lobes."""
    world = bpy.data.worlds.new("dome")
    graph = NodeGraph(enable_nodes(world))
    direction = graph.node("ShaderNodeTexCoord").outputs["Generated"]
    separate = graph.node("ShaderNodeSeparateXYZ")
    graph.connect(direction, separate.inputs[0])
    radiance = graph.mix(graph.remap(separate.outputs["Z"], -1, 1, 0, 1), GROUND, ZENITH)
    for lobe in LOBES:
        radiance = graph.mix(1.0, radiance, _lobe_radiance(graph, direction, lobe), "ADD")
    graph.connect(radiance, graph.tree.nodes["Background"].inputs[0])
    world.cycles.sampling_method = "MANUAL"
    world.cycles.sample_map_resolution = 256
    return world


def _lobe_radiance(graph: NodeGraph, direction: bpy.types.NodeSocket, lobe: Lobe) -> bpy.types.NodeSocket:
    cosine = graph.node("ShaderNodeVectorMath", operation="DOT_PRODUCT")
    graph.connect(direction, cosine.inputs[0])
    cosine.inputs[1].default_value = np.array(lobe.towards) / np.linalg.norm(lobe.towards)
    strength = graph.math("POWER", graph.math("MAXIMUM", cosine.outputs["Value"], 0.0), float(lobe.exponent))
    return graph.mix(strength, (0.0, 0.0, 0.0), lobe.radiance)
