"""Helpers for building shader node trees, so that a material reads like a formula."""

from __future__ import annotations

from typing import Any

import bpy

Socket = Any
"""A node socket, or a plain value for an input's default."""


def enable_nodes(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """Create the node tree of a new material or world."""
    if bpy.app.version < (5, 0, 0):  # later versions always have nodes, and warn
        owner.use_nodes = True
    return owner.node_tree


class NodeGraph:
    """Builds nodes in one tree; every method returns an output socket of the node that it adds."""

    def __init__(self, tree: bpy.types.NodeTree):
        self.tree = tree

    def node(self, kind: str, **settings: Any) -> bpy.types.Node:
        """Add a new node with its settings."""
        node = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        return node

    def connect(self, value: Socket, target: bpy.types.NodeSocket) -> None:
        """Link a socket to an input, or set the input's value."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, target)
        else:
            target.default_value = value

    def math(self, operation: str, a: Socket, b: Socket = None, clamp: bool = False) -> Socket:
        """Add one arithmetic operation."""
        node = self.node("ShaderNodeMath", operation=operation, use_clamp=clamp)
        for value, target in zip((a, b), node.inputs, strict=False):
            if value is not None:
                self.connect(value, target)
        return node.outputs[0]

    def product(self, *factors: Socket) -> Socket:
        """Multiply all factors."""
        result = factors[0]
        for factor in factors[1:]:
            result = self.math("MULTIPLY", result, factor)
        return result

    def total(self, *terms: Socket) -> Socket:
        """Sum all terms."""
        result = terms[0]
        for term in terms[1:]:
            result = self.math("ADD", result, term)
        return result

    def one_minus(self, value: Socket, clamp: bool = False) -> Socket:
        """Subtract the value from 1."""
        return self.math("SUBTRACT", 1.0, value, clamp)

    def mix(self, factor: Socket, a: Socket, b: Socket, blend: str = "MIX") -> Socket:
        """Mix colour a towards colour b; colours may be (r, g, b) linear."""
        node = self.node("ShaderNodeMix", data_type="RGBA", blend_type=blend)
        self.connect(factor, node.inputs[0])
        for value, target in ((a, node.inputs[6]), (b, node.inputs[7])):
            self.connect((*value, 1) if isinstance(value, tuple) else value, target)
        return node.outputs[2]

    def remap(self, value: Socket, from_min: float, from_max: float, to_min: float, to_max: float) -> Socket:
        """Remap linearly, clamped."""
        return self._map_range(value, (from_min, from_max, to_min, to_max), "LINEAR")

    def smooth(self, value: Socket, from_min: float, from_max: float, to_min: float, to_max: float) -> Socket:
        """Remap by smoothstep."""
        return self._map_range(value, (from_min, from_max, to_min, to_max), "SMOOTHSTEP")

    def _map_range(self, value: Socket, bounds: tuple[float, ...], interpolation: str) -> Socket:
        node = self.node("ShaderNodeMapRange", interpolation_type=interpolation)
        self.connect(value, node.inputs[0])
        for bound, target in zip(bounds, node.inputs[1:5], strict=True):
            target.default_value = bound
        return node.outputs[0]

    def scaled(self, vector: Socket, factors: tuple[float, float, float]) -> Socket:
        """Multiply a vector's components by the factors."""
        node = self.node("ShaderNodeVectorMath", operation="MULTIPLY")
        self.connect(vector, node.inputs[0])
        self.connect(factors, node.inputs[1])
        return node.outputs[0]

    def vector_noise(self, position: Socket, scale: float, detail: float) -> Socket:
        """Add three noises with means of about 0.5, as a vector."""
        return self._noise(position, Scale=scale, Detail=detail).outputs["Color"]

    def moved(self, vector: Socket, by: Socket, factor: float) -> Socket:
        """Move a vector by another one times a factor."""
        node = self.node("ShaderNodeVectorMath", operation="MULTIPLY_ADD")
        self.connect(by, node.inputs[0])
        node.inputs[1].default_value = (factor,) * 3
        self.connect(vector, node.inputs[2])
        return node.outputs[0]

    def attribute(self, name: str, output: str = "Fac") -> Socket:
        """Read a mesh attribute: `Fac` or `Vector`."""
        return self.node("ShaderNodeAttribute", attribute_name=name).outputs[output]

    def noise(self, position: Socket, scale: float, detail: float, roughness: float) -> Socket:
        """Add fractal noise with a mean of about 0.5."""
        return self._noise(position, Scale=scale, Detail=detail, Roughness=roughness).outputs["Fac"]

    def _noise(self, position: Socket, **settings: float) -> bpy.types.Node:
        node = self.node("ShaderNodeTexNoise")
        self.connect(position, node.inputs["Vector"])
        for name, value in settings.items():
            node.inputs[name].default_value = value
        return node

    def voronoi(self, position: Socket, scale: float, feature: str) -> Socket:
        """Compute the distance of a Voronoi pattern: `F1` to the cell's centre, `DISTANCE_TO_EDGE` to its border."""
        node = self.node("ShaderNodeTexVoronoi", feature=feature)
        self.connect(position, node.inputs["Vector"])
        node.inputs["Scale"].default_value = scale
        return node.outputs["Distance"]

    def combine(self, *channels: Socket) -> Socket:
        """Combine up to three channels to a colour."""
        node = self.node("ShaderNodeCombineColor")
        for value, target in zip(channels, node.inputs, strict=False):
            self.connect(value, target)
        return node.outputs[0]

    def separate(self, colour: Socket) -> tuple[Socket, Socket, Socket]:
        """Separate a colour into its three channels."""
        node = self.node("ShaderNodeSeparateColor")
        self.connect(colour, node.inputs[0])
        return tuple(node.outputs)  # type: ignore[return-value]
