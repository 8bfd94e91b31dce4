"""The light of captures: a dome in world space, so that self-shadowing depends on the pose. Z up, front -Y."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from .node_graph import NodeGraph, enable_nodes


class Lobe(NamedTuple):
    """A soft light: direction towards it, linear radiance, and cosine exponent (larger is narrower)."""

    towards: tuple[float, float, float]
    radiance: tuple[float, float, float]
    exponent: float


KEY = Lobe((-0.75, -0.75, 0.75), (9.5, 9.0, 8.3), 42)
FILL = Lobe((0.8, -0.35, -0.5), (1.5, 1.7, 2.0), 14)
KICK = Lobe((-0.75, 0.45, 0.6), (1.5, 1.4, 1.3), 10)
BACK = Lobe((0.55, 0.80, 0.55), (3.6, 3.4, 3.15), 20)
GROUND, SKY = (0.22, 0.205, 0.19), (0.36, 0.39, 0.44)


def dome_world() -> bpy.types.World:
    """A gradient from ground to sky, and four lobes."""
    world = bpy.data.worlds.new("dome")
    graph = NodeGraph(enable_nodes(world))
    direction = graph.node("ShaderNodeTexCoord").outputs["Generated"]
    separate = graph.node("ShaderNodeSeparateXYZ")
    graph.connect(direction, separate.inputs[0])
    radiance = graph.mix(graph.remap(separate.outputs["Z"], -1, 1, 0, 1), GROUND, SKY)
    for lobe in (KEY, FILL, KICK, BACK):
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
