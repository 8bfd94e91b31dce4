"""The pictures of a character's materials: missing ones are looked for beside the file, or become plain colours."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path, PureWindowsPath

import bpy

_MOST_FILES = 20_000  # beside a character, that are looked at
_FLAT_NORMAL = (0.5, 0.5, 1.0, 1.0)
_GREY = (0.8, 0.8, 0.8, 1.0)
_FROM_FILES = {"FILE", "TILED"}


def find_pictures(folder: Path) -> None:
    """Give images of the open file whose file is missing the one of that name in a folder, or in folders below it."""
    missing = [image for image in bpy.data.images if is_missing(image)]
    if not missing:
        return
    beside = _files_by_name(folder)
    for image in missing:
        # A path as any system writes it.
        found = beside.get(PureWindowsPath(image.filepath.replace("//", "", 1)).name.lower())
        if found is not None:
            image.filepath = str(found)
            image.reload()


def images_of(materials: Iterable[bpy.types.Material | None]) -> set[bpy.types.Image]:
    """Collect all images that the materials' nodes use, in node groups too."""
    return {node.image for node in _image_nodes(materials)}


def is_missing(image: bpy.types.Image) -> bool:
    """Return whether an image comes from a file that does not exist."""
    if image.source not in _FROM_FILES or image.packed_files or image.is_dirty:
        return False
    path = bpy.path.abspath(image.filepath, library=image.library)
    if image.source == "TILED":
        path = path.replace("<UDIM>", str(image.tiles[0].number))
    return not Path(path).is_file()


@contextlib.contextmanager
def plain_colours(materials: Iterable[bpy.types.Material | None], missing: set[bpy.types.Image]) -> Iterator[None]:
    """Replace these images in nodes, within, by an image of one colour: what their material has without them."""
    nodes = [(node, node.image) for node in _image_nodes(materials) if node.image in missing]
    stand_ins = []
    try:
        for node, image in nodes:
            stand_ins.append(_plain_image(image.name, _colour_without(node)))
            node.image = stand_ins[-1]
        yield
    finally:
        for node, image in nodes:
            node.image = image
        for image in stand_ins:
            bpy.data.images.remove(image)


def _image_nodes(materials: Iterable[bpy.types.Material | None]) -> list[bpy.types.Node]:
    trees = [material.node_tree for material in materials if material is not None and material.node_tree]
    seen, nodes = set(), []
    while trees:
        tree = trees.pop()
        if tree in seen:
            continue
        seen.add(tree)
        nodes += [node for node in tree.nodes if getattr(node, "image", None)]
        trees += [node.node_tree for node in tree.nodes if getattr(node, "node_tree", None)]
    return nodes


def _colour_without(node: bpy.types.Node) -> tuple[float, ...]:
    """Read the linear colour of the input that an image's colour goes to."""
    for link in node.outputs[0].links:
        if link.to_node.type == "NORMAL_MAP":
            return _FLAT_NORMAL
        if link.to_socket.type == "RGBA":
            return tuple(link.to_socket.default_value)
        if link.to_socket.type == "VALUE":
            return (*[link.to_socket.default_value] * 3, 1.0)
    return _GREY


def _plain_image(name: str, colour: tuple[float, ...]) -> bpy.types.Image:
    image = bpy.data.images.new(f"{name} (missing)", 1, 1, alpha=True, float_buffer=True, is_data=True)
    image.pixels.foreach_set([*colour[:3], 1.0])
    image.pack()
    return image


def _files_by_name(folder: Path) -> dict[str, Path]:
    """Map names in lower case to files in a folder and below; those nearest to the folder count."""
    found: dict[str, Path] = {}
    seen = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            found.setdefault(name.lower(), Path(parent) / name)
        seen += len(names)
        if seen > _MOST_FILES:
            break
    return found
