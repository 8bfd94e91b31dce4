"""LiveHand's nodes in a frame of their own, beside the user's nodes.

There is one block of each kind: a new one replaces the old one, and its nodes feed what the old nodes of the same role
fed. Custom properties identify the frame and its nodes, so that users can rename and move them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import bpy

from .tree import add_over, location_px, output_input

_KIND, _ROLE = "livehand_block", "livehand_role"
_COLUMN_PX, _ROW_PX, _MARGIN_PX = 260, 320, 120


class _OutsideLink(NamedTuple):
    """A socket outside a block that a node of the block feeds."""

    role: str
    output: str
    socket: bpy.types.NodeSocket


class Block:
    """A frame to which nodes are added; call `restore` after the last one."""

    def __init__(self, tree: bpy.types.NodeTree, kind: str, label: str):
        """Start a block in place of the old one of its kind, or below all nodes."""
        self.tree = tree
        old = [node for node in tree.nodes if node.get(_KIND) == kind]
        location = old[0].location.copy() if old else (0.0, _lowest(tree) - _MARGIN_PX)
        self._readers = [reader for frame in old for reader in _readers(tree, frame)]
        for frame in old:
            _remove(tree, frame)
        self.frame = tree.nodes.new("NodeFrame")
        self.frame[_KIND], self.frame.label = kind, label
        self.frame.location = location

    def add(self, idname: str, role: str, at: tuple[int, int]) -> bpy.types.Node:
        """Add a node in a column and row of the block."""
        return self._placed(self.tree.nodes.new(idname), role, at)

    def add_over(self, role: str, at: tuple[int, int]) -> tuple[bpy.types.Node, dict[str, bpy.types.NodeSocket]]:
        """Add an Alpha Over node; returns it and its inputs `background`, `foreground` and `factor`."""
        node, sockets = add_over(self.tree)
        return self._placed(node, role, at), sockets

    def link(self, output: bpy.types.NodeSocket, socket: bpy.types.NodeSocket) -> None:
        """Connect an output to an input."""
        self.tree.links.new(output, socket)

    def restore(self) -> None:
        """Feed the sockets that the old block of this kind fed."""
        nodes = {node[_ROLE]: node for node in _members(self.tree, self.frame)}
        for role, output, socket in self._readers:
            if role in nodes and output in nodes[role].outputs:
                self.link(nodes[role].outputs[output], socket)

    def feed_output(self, result: bpy.types.NodeSocket, replace: bool) -> bool:
        """Feed the compositor's output if it is free, shows a plain render, or is to be replaced.

        Returns:
            Whether the block feeds it.
        """
        socket = output_input(self.tree)
        if replace or not socket.is_linked or _is_plain_render(socket):
            self.link(result, socket)
        return socket.links[0].from_node.parent == self.frame

    def _placed(self, node: bpy.types.Node, role: str, at: tuple[int, int]) -> bpy.types.Node:
        node[_ROLE] = role
        node.parent = self.frame
        node.location = (_COLUMN_PX * at[0], -_ROW_PX * at[1])
        return node


def _is_plain_render(socket: bpy.types.NodeSocket) -> bool:
    """Return whether a socket has what *Use Nodes* begins with: a Render Layers node, which is no block's."""
    while socket.is_linked:
        link = socket.links[0]
        if link.from_node.bl_idname == "CompositorNodeRLayers":
            return link.from_socket.name == "Image" and _ROLE not in link.from_node
        if link.from_node.bl_idname != "NodeReroute":
            return False
        socket = link.from_node.inputs[0]
    return False


def _members(tree: bpy.types.NodeTree, frame: bpy.types.Node) -> Iterator[bpy.types.Node]:
    return (node for node in tree.nodes if node.parent == frame and _ROLE in node)


def _readers(tree: bpy.types.NodeTree, frame: bpy.types.Node) -> Iterator[_OutsideLink]:
    members = list(_members(tree, frame))
    for link in tree.links:
        if link.from_node in members and link.to_node not in members:
            yield _OutsideLink(link.from_node[_ROLE], link.from_socket.name, link.to_socket)


def _remove(tree: bpy.types.NodeTree, frame: bpy.types.Node) -> None:
    """Remove a block; the user's nodes in its frame are kept."""
    for node in list(_members(tree, frame)):
        tree.nodes.remove(node)
    tree.nodes.remove(frame)


def _lowest(tree: bpy.types.NodeTree) -> float:
    bottoms = (location_px(node)[1] - _ROW_PX for node in tree.nodes if node.bl_idname != "NodeFrame")
    return min(bottoms, default=_MARGIN_PX)
