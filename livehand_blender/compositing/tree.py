"""A scene's compositor nodes and their output: `Scene.node_tree` in Blender 4, node groups since 5."""

from __future__ import annotations

import bpy

# Since Blender 5 a scene refers to a node group, whose Group Output replaces the Composite node; since 5.3 to several.
_OF_SCENE = bpy.types.Scene.bl_rna.properties
_HAS_EFFECTS = "compositor_effects" in _OF_SCENE
IS_GROUP = _HAS_EFFECTS or "compositing_node_group" in _OF_SCENE
MATH = "ShaderNodeMath" if IS_GROUP else "CompositorNodeMath"
_NAME = "Compositing"


def compositor_of(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """Return the scene's compositor nodes, which are switched on and, if there were none, created empty."""
    scene.render.use_compositing = True
    if IS_GROUP:
        owner, name = _owner_of_group(scene)
        if getattr(owner, name) is None:
            setattr(owner, name, bpy.data.node_groups.new(_NAME, "CompositorNodeTree"))
        return getattr(owner, name)
    is_new = scene.node_tree is None
    scene.use_nodes = True
    if is_new:
        scene.node_tree.nodes.clear()  # Blender's default nodes
    return scene.node_tree


def used_compositors(scene: bpy.types.Scene) -> list[bpy.types.NodeTree]:
    """List the compositor nodes that a render of the scene passes through."""
    if not scene.render.use_compositing:
        return []
    if _HAS_EFFECTS:
        trees = [effect.node_group for effect in scene.compositor_effects if effect.enable_for_render]
    elif IS_GROUP:
        trees = [scene.compositing_node_group]
    else:
        trees = [scene.node_tree] if scene.use_nodes else []
    return [tree for tree in trees if tree is not None]


def _owner_of_group(scene: bpy.types.Scene) -> tuple[bpy.types.bpy_struct, str]:
    """Return what refers to the scene's node group, switched on, and by which property."""
    if not _HAS_EFFECTS:
        return scene, "compositing_node_group"
    effect = scene.compositor_effects.active or scene.compositor_effects.new(_NAME)
    effect.enable_for_render = True
    return effect, "node_group"


def output_input(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Return the input socket of the compositor's output; its node is added if there is none."""
    return _group_output(tree) if IS_GROUP else _node(tree, "CompositorNodeComposite").inputs["Image"]


def add_over(tree: bpy.types.NodeTree) -> tuple[bpy.types.Node, dict[str, bpy.types.NodeSocket]]:
    """Add an Alpha Over node for premultiplied images; also its inputs `background`, `foreground` and `factor`."""
    node = tree.nodes.new("CompositorNodeAlphaOver")
    names = ("Background", "Foreground", "Factor") if IS_GROUP else ("Image", "Image_001", "Fac")
    sockets = {socket.name if IS_GROUP else socket.identifier: socket for socket in node.inputs}
    return node, dict(zip(("background", "foreground", "factor"), (sockets[name] for name in names), strict=True))


def location_px(node: bpy.types.Node) -> tuple[float, float]:
    """Compute a node's upper left corner in the node editor, also if it is in frames."""
    x, y = node.location
    if node.parent is None:
        return x, y
    parent_x, parent_y = location_px(node.parent)
    return x + parent_x, y + parent_y


def _group_output(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    has_output = any(item.item_type == "SOCKET" and item.in_out == "OUTPUT" for item in tree.interface.items_tree)
    if not has_output:
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    return _node(tree, "NodeGroupOutput").inputs[0]


def _node(tree: bpy.types.NodeTree, idname: str) -> bpy.types.Node:
    """Find the first node of a type, or add a new one to the right of all others."""
    found = [node for node in tree.nodes if node.bl_idname == idname]
    if found:
        return found[0]
    right_px = max((location_px(node)[0] + node.width for node in tree.nodes), default=0.0)
    node = tree.nodes.new(idname)
    node.location = (right_px + 80, 0)
    return node
