"""Compositor nodes for a hand that LiveHand renders alone, combined with another scene's render by depth."""

from __future__ import annotations

import bpy

from ...backend.records.errors import LiveHandError
from ..scene.camera import output_size_px
from .block import Block
from .tree import MATH, compositor_of


def hand_over_scene(scene: bpy.types.Scene, behind: bpy.types.Scene | None, replace_output: bool) -> bool:
    """Build the nodes in the scene's compositor, and switch on the Depth passes that they read.

    Where the hand is nearer, the result is `hand + (1 - alpha) * behind`; elsewhere it is the scene behind.

    Args:
        scene: with the hand; of both scenes, the first view layer that is rendered is used.
        behind: rendered by any engine through the same camera; None: only the hand's render.
        replace_output: feed the compositor's output even if something else feeds it.

    Returns:
        Whether these nodes feed the compositor's output.

    Raises:
        LiveHandError: the scene behind is the scene itself, or renders images of another size.
    """
    _check(scene, behind)
    block = Block(compositor_of(scene), "hand_over_scene", "LiveHand: Hand over Scene")
    if behind is None:
        result = _render(block, scene, "result", (0, 0)).outputs["Image"]
    else:
        result = _hand_in_front(block, scene, behind)
    block.restore()
    return block.feed_output(result, replace_output)


def _check(scene: bpy.types.Scene, behind: bpy.types.Scene | None) -> None:
    if behind is None:
        return
    if behind == scene:
        raise LiveHandError(
            f"the scene behind the hand must not be its own scene, got '{scene.name}'; add a linked copy of the "
            "scene (New Scene > Linked Copy) with another render engine"
        )
    sizes = output_size_px(scene.render), output_size_px(behind.render)
    if sizes[0] != sizes[1]:
        (width, height), (width_behind, height_behind) = sizes
        raise LiveHandError(
            f"both scenes must render images of the same size, '{scene.name}' renders {width} x {height} and "
            f"'{behind.name}' {width_behind} x {height_behind}; change one resolution"
        )


def _hand_in_front(block: Block, scene: bpy.types.Scene, behind: bpy.types.Scene) -> bpy.types.NodeSocket:
    hand = _render(block, scene, "hand", (0, 0))
    ground = _render(block, behind, "scene", (0, 1))
    nearer = block.add(MATH, "nearer", (1, 1))
    nearer.operation, nearer.label = "LESS_THAN", "Hand Is Nearer"
    block.link(hand.outputs["Depth"], nearer.inputs[0])
    block.link(ground.outputs["Depth"], nearer.inputs[1])
    over, inputs = block.add_over("result", (2, 0))
    block.link(ground.outputs["Image"], inputs["background"])
    block.link(hand.outputs["Image"], inputs["foreground"])
    block.link(nearer.outputs["Value"], inputs["factor"])
    return over.outputs["Image"]


def _render(block: Block, scene: bpy.types.Scene, role: str, at: tuple[int, int]) -> bpy.types.Node:
    """Add a Render Layers node that has Image and Depth."""
    view_layer = next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])
    view_layer.use_pass_z = True
    node = block.add("CompositorNodeRLayers", role, at)
    node.scene, node.layer = scene, view_layer.name
    return node
