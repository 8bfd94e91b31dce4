"""The File Output nodes of a shot's compositor, which write wherever they point while its frames are rendered."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, get_args

import bpy

from ..compositing.tree import used_compositors
from ..scene.file_paths import output_path

FileOutputs = Literal["keep", "mute", "move"]
FILE_OUTPUTS: tuple[FileOutputs, ...] = get_args(FileOutputs)
_BASE_PATH = "directory" if "directory" in bpy.types.CompositorNodeOutputFile.bl_rna.properties else "base_path"


def apply_file_outputs(scene: bpy.types.Scene, folder: Path, choice: FileOutputs) -> str | None:
    """Keep, mute or move the nodes that write outside a folder, in memory only; returns a warning if they are kept.

    A node that is moved writes into a folder of its own name, in `folder`.
    """
    outside = [(node, place) for node, place in _paths(scene) if not _is_in(place, folder)]
    if choice == "keep":
        return _warning([place for _, place in outside])
    for node, place in outside:
        if choice == "mute":
            node.mute = True
        else:
            target = folder / bpy.path.clean_name(node.name)
            setattr(node, _BASE_PATH, output_path(target / place.name if _names_a_file(node) else target))
    return None


def _warning(paths: list[Path]) -> str | None:
    if not paths:
        return None
    count = f"{len(paths)} File Output nodes write" if len(paths) > 1 else "a File Output node writes"
    names = ", ".join(dict.fromkeys(map(str, paths)))
    return f"{count} outside the output folder: {names}; --file-outputs mute leaves that out, move puts it there"


def _paths(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Node, Path]]:
    """Yield the nodes that write, and where."""
    seen: list[bpy.types.NodeTree] = []
    for tree in used_compositors(scene):
        _add_with_groups(tree, seen)
    for tree in seen:
        for node in tree.nodes:
            if node.bl_idname == "CompositorNodeOutputFile" and not node.mute:
                yield node, Path(bpy.path.abspath(getattr(node, _BASE_PATH), library=tree.library)).absolute()


def _add_with_groups(tree: bpy.types.NodeTree, seen: list[bpy.types.NodeTree]) -> None:
    """Add to a list the tree, and those of all groups in it, each once."""
    if tree in seen:
        return
    seen.append(tree)
    for node in tree.nodes:
        inner = getattr(node, "node_tree", None)
        if inner is not None and not node.mute:
            _add_with_groups(inner, seen)


def _names_a_file(node: bpy.types.Node) -> bool:
    """Return whether the node's path is a file's, as that of many layers is until Blender 4."""
    return _BASE_PATH == "base_path" and node.format.file_format == "OPEN_EXR_MULTILAYER"


def _is_in(place: Path, folder: Path) -> bool:
    return place.resolve().is_relative_to(folder.resolve())
