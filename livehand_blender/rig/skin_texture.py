"""A painted or photographed texture on the atlas, worn by a hand's plain mesh in Solid, EEVEE and Cycles.

No avatar takes part: the picture becomes the base colour of the mesh's material. Its lower left corner is
(u, v) = (0, 0) of the atlas, as of every texture in Blender.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ...backend.records.errors import LiveHandError
from .hand import RiggedHand

_NODE = "LiveHand Texture"
_GAP = 320.0  # between nodes in the editor


def wear_texture(hand: RiggedHand, path: Path) -> None:
    """Let the hand's mesh show a picture in place of its plain skin; a texture that it wears already is replaced.

    The material keeps everything else: roughness, subsurface, what the user has changed.

    Args:
        hand: whose mesh it is.
        path: an image file that Blender reads; 8-bit files are sRGB-encoded, OpenEXR is linear.

    Raises:
        LiveHandError: the file is no image, or the mesh's material has no Principled BSDF or belongs to another file.
    """
    shader = _shader(hand.mesh)
    image = _loaded(path)
    remove_texture(hand)
    tree = shader.id_data
    node = tree.nodes.new("ShaderNodeTexImage")
    node.name = node.label = _NODE
    node.image = image
    node.location = (shader.location.x - _GAP, shader.location.y)
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    tree.nodes.active = node  # what Solid shading shows with Color: Texture


def remove_texture(hand: RiggedHand) -> None:
    """Give the hand's mesh its plain colour back; without a texture nothing happens.

    Raises:
        LiveHandError: as `wear_texture`.
    """
    tree = _shader(hand.mesh).id_data
    if _NODE in tree.nodes:
        tree.nodes.remove(tree.nodes[_NODE])


def worn_texture(mesh: bpy.types.Object) -> bpy.types.Image | None:
    """Return the picture that `wear_texture` gave the mesh; None: it has none."""
    tree = mesh.active_material and mesh.active_material.node_tree
    node = tree.nodes.get(_NODE) if tree else None
    return node.image if node else None


def _shader(mesh: bpy.types.Object) -> bpy.types.Node:
    """Return the Principled BSDF of the mesh's active material, which must be ours to change."""
    material = mesh.active_material
    if material is None or material.node_tree is None:
        raise LiveHandError(f"{mesh.name} must have a material with nodes to wear a texture; give it one")
    if material.library is not None:
        raise LiveHandError(
            f"the material {material.name} of {mesh.name} must belong to this file, it is linked from "
            f"{material.library.filepath}; make it local with Object > Relations > Make Local"
        )
    shader = next((node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"), None)
    if shader is None:
        raise LiveHandError(
            f"the material {material.name} of {mesh.name} must have a Principled BSDF to wear a texture; add one, "
            "or give the mesh another material"
        )
    return shader


def _loaded(path: Path) -> bpy.types.Image:
    """Load the picture; an image of the same file that is loaded already is read again."""
    if not path.is_file():
        raise LiveHandError(f"a texture must be an image file, there is none at {path}")
    image = bpy.data.images.load(str(path), check_existing=True)
    image.reload()
    if not image.size[0]:
        if not image.users:
            bpy.data.images.remove(image)
        raise LiveHandError(f"a texture must be an image that Blender reads, {path.name} is none")
    return image
