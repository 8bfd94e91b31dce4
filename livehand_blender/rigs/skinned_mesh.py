"""A hand's surface as a Blender mesh: skinned to the bones of an exported skeleton, with correctives and a skin."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...backend.motion.spaces import TO_BLENDER
from ...backend.motion.writers.skeleton import bone_names
from ...backend.motion.writers.take import TakenHand
from ..rig.keyframes import key_values

_UP = TO_BLENDER["y_up"]
_LEAST_WEIGHT = 1e-4
_MOST_VALUE = 3.0  # of a morph target: the square root of 8 and a little
_INDEX = 1.4  # of refraction, of skin


@dataclass(frozen=True)
class MeshTextures:
    """Textures of A x A texels, the smallest v first: albedo (sRGB-encoded), normal in tangent space, roughness."""

    albedo: np.ndarray
    normal: np.ndarray
    roughness: np.ndarray


@dataclass(frozen=True)
class ExportedMesh:
    """A hand at rest in the template's frame, N vertices, M faces.

    Attributes:
        vertices: [N, 3] m.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        weights: [N, 17] of the 16 joints and of the forearm.
        morphs: displacements [K, N, 3] m of shape keys.
        values: [T, K] of the keys in the frames of the hand's motion.
        skin: its textures; None: a plain mesh.
    """

    vertices: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    weights: np.ndarray
    morphs: np.ndarray | None = None
    values: np.ndarray | None = None
    skin: MeshTextures | None = None


def plain_surface(hand: TakenHand) -> ExportedMesh:
    """Return the surface of a hand's own model, in the take's mean shape."""
    model = hand.own_model
    weights = np.concatenate([model.lbs_weights, model.arm_weights[:, None]], 1)
    weights[:, 0] -= model.arm_weights
    vertices = model.v_template + model.shapedirs @ hand.motion.betas.mean(0)
    return ExportedMesh(vertices, model.f, model.vt[model.ft], weights)


def add_mesh(
    context: bpy.types.Context, hand: TakenHand, armature: bpy.types.Object, surface: ExportedMesh
) -> bpy.types.Object:
    """Add a hand's surface to the context's collection, moved by the armature of its skeleton."""
    name = f"{hand.side.capitalize()} Hand"
    data = bpy.data.meshes.new(name)
    data.from_pydata((hand.scale * surface.vertices @ _UP.T).tolist(), [], surface.faces.tolist())
    data.polygons.foreach_set("use_smooth", np.ones(len(surface.faces), bool))
    data.uv_layers.new(name="Atlas").data.foreach_set("uv", surface.corner_uv.astype(np.float32).ravel())
    mesh = bpy.data.objects.new(name, data)
    context.collection.objects.link(mesh)
    for column, bone in enumerate(bone_names(hand.side)):
        _add_group(mesh, bone, surface.weights[:, column])
    if surface.morphs is not None and surface.values is not None:
        _add_morphs(mesh, hand, surface.vertices + surface.morphs, surface.values)
    if surface.skin:
        data.materials.append(_material(name, surface.skin))
    mesh.parent = armature
    mesh.modifiers.new("Armature", "ARMATURE").object = armature
    return mesh


def _add_group(mesh: bpy.types.Object, bone: str, weights: np.ndarray) -> None:
    moved = np.flatnonzero(weights > _LEAST_WEIGHT)
    if len(moved):
        group = mesh.vertex_groups.new(name=bone)
        for vertex, weight in zip(moved.tolist(), weights[moved].tolist(), strict=True):
            group.add([vertex], weight, "REPLACE")


def _add_morphs(mesh: bpy.types.Object, hand: TakenHand, moved: np.ndarray, values: np.ndarray) -> None:
    """Add a shape key for each of `moved` [K, N, 3], keyed with `values` [T, K] in the frames of the hand."""
    frames = hand.frames.astype(np.float64)
    mesh.shape_key_add(name="Basis")
    for number, (vertices, of_key) in enumerate(zip(moved, values.T, strict=True)):
        key = mesh.shape_key_add(name=f"Corrective {number + 1}")
        key.slider_min, key.slider_max = -_MOST_VALUE, _MOST_VALUE
        key.data.foreach_set("co", (hand.scale * vertices @ _UP.T).astype(np.float32).ravel())
        key_values(mesh.data.shape_keys, f'key_blocks["{key.name}"].value', "Correctives", frames, of_key)


def _material(name: str, skin: MeshTextures) -> bpy.types.Material:
    """Make a Principled skin of images, as the exporters know it."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):  # later versions always use nodes, and warn
        material.use_nodes = True
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["IOR"].default_value = _INDEX
    albedo = _image_node(tree, f"{name} Albedo", skin.albedo, "sRGB")
    tree.links.new(albedo.outputs["Color"], shader.inputs["Base Color"])
    rough = np.stack([np.ones_like(skin.roughness), skin.roughness, np.zeros_like(skin.roughness)], -1)
    split = tree.nodes.new("ShaderNodeSeparateColor")
    rough_node = _image_node(tree, f"{name} Roughness", rough, "Non-Color")
    tree.links.new(rough_node.outputs["Color"], split.inputs["Color"])
    tree.links.new(split.outputs["Green"], shader.inputs["Roughness"])
    tree.links.new(split.outputs["Blue"], shader.inputs["Metallic"])
    normal = tree.nodes.new("ShaderNodeNormalMap")
    bent = _image_node(tree, f"{name} Normal", skin.normal / 2 + 0.5, "Non-Color")
    tree.links.new(bent.outputs["Color"], normal.inputs["Color"])
    tree.links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    return material


def _image_node(tree: bpy.types.NodeTree, name: str, pixels: np.ndarray, space: str) -> bpy.types.Node:
    """Add an 8-bit image of values [A, A, 3], as the file stores them, packed so that exporters find it."""
    image = bpy.data.images.new(name, pixels.shape[1], pixels.shape[0])
    image.colorspace_settings.name = space
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    return node
