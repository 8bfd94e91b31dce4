"""The content of a node tree as plain values: trees with equal values emit alike."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator
from hashlib import sha256
from typing import Any

import bpy
import numpy as np

_IGNORED = {
    "rna_type",
    "location",
    "location_absolute",
    "width",
    "height",
    "dimensions",
    "select",
    "parent",
    "color",
    "use_custom_color",
    "show_options",
    "show_preview",
    "show_texture",
    "hide",
    "internal_links",
    "inputs",
    "outputs",
    "color_tag",
    "debug_zone_body_lazy_function_graph",
    "debug_zone_lazy_function_graph",
    "warning_propagation",
}
_MAX_DEPTH = 4


def used_nodes(owner: bpy.types.Light | bpy.types.World | bpy.types.Material) -> bpy.types.NodeTree | None:
    """Return the nodes that shade it; None if it has none, or they are switched off."""
    with warnings.catch_warnings():  # in later versions nodes are always on, and the switch warns that it will go
        warnings.simplefilter("ignore", DeprecationWarning)
        return owner.node_tree if getattr(owner, "use_nodes", True) else None


def tree_values(tree: bpy.types.NodeTree) -> list[Any]:
    """List nodes, links and values of a tree and of the groups in it, images by path, size and time of change."""
    nodes = [
        # A Value or RGB node keeps its value in its output.
        [
            node.name,
            node.bl_idname,
            _values(node, 0),
            *map(_defaults, (node.inputs, () if node.inputs else node.outputs)),
        ]
        for node in tree.nodes
    ]
    links = [
        [link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier, link.is_muted]
        for link in tree.links
    ]
    return [nodes, links]


def images_of(tree: bpy.types.NodeTree) -> list[bpy.types.Image]:
    """List the images of a tree and of the groups in it."""
    return [node.image for node in _all_nodes(tree, set()) if getattr(node, "image", None)]


def objects_of(tree: bpy.types.NodeTree) -> list[bpy.types.Object]:
    """List the objects whose coordinates nodes of a tree use, and of the groups in it."""
    return [node.object for node in _all_nodes(tree, set()) if getattr(node, "object", None)]


def _all_nodes(tree: bpy.types.NodeTree, seen: set[str]) -> Iterator[bpy.types.Node]:
    for node in tree.nodes:
        yield node
        inner = getattr(node, "node_tree", None)
        if inner is not None and inner.name_full not in seen:
            seen.add(inner.name_full)
            yield from _all_nodes(inner, seen)


def _defaults(sockets: Iterable[bpy.types.NodeSocket]) -> list[Any]:
    return [_plain(getattr(one, "default_value", None)) for one in sockets]


def _values(owner: bpy.types.bpy_struct, depth: int) -> list[Any]:
    """List every property of a node or of what it holds: colour ramps, curve mappings, texture mappings."""
    if depth > _MAX_DEPTH:
        return []
    return [
        [one.identifier, _value(one, getattr(owner, one.identifier), depth)]
        for one in owner.bl_rna.properties
        if one.identifier not in _IGNORED and not one.identifier.startswith("bl_")
    ]


def _value(one: bpy.types.Property, value: Any, depth: int) -> Any:
    if value is None or one.type not in {"POINTER", "COLLECTION"}:
        return _plain(value)
    if one.type == "COLLECTION":
        return [_values(item, depth + 1) for item in value]
    if isinstance(value, bpy.types.Image):
        return image_state(value)
    if isinstance(value, bpy.types.NodeTree):
        return tree_values(value)
    if isinstance(value, bpy.types.Object):
        return [value.name_full, [list(row) for row in value.matrix_world]]
    if isinstance(value, bpy.types.Text):
        return value.as_string()
    return value.name_full if isinstance(value, bpy.types.ID) else _values(value, depth + 1)


def image_state(image: bpy.types.Image) -> list[Any]:
    """List what shows that an image has changed: its file's size and time, or its pixels where no file holds them."""
    path = bpy.path.abspath(image.filepath, library=image.library)
    try:
        status = os.stat(path)
        file = [status.st_size, status.st_mtime_ns]
    except OSError:
        file = None
    packed = image.packed_file
    return [
        image.name_full,
        path,
        file,
        image.source,
        image.colorspace_settings.name,
        packed and packed.size,
        list(image.size),
        _pixels(image),
    ]


def _pixels(image: bpy.types.Image) -> str:
    """Hash the pixels of an image that no file holds."""
    if image.source != "GENERATED" and not image.is_dirty:
        return ""
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return sha256(pixels.tobytes()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, (str, int, float, bool)) or value is None:
        return value
    if isinstance(value, set):
        return sorted(value)
    try:
        return [_plain(item) for item in value]
    except TypeError:
        return str(type(value))
