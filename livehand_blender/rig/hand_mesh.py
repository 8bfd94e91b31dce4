"""The mesh of a hand: the model's vertices and faces, weights, atlas, shape keys and a plain skin material.

The vertex order is the model's, which an avatar's atlas and the renderer rely on.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.hand.bones import bone_name, deform_name, forearm_deform_name
from ...backend.hand.corrective_keys import factor_correctives, quaternion_form
from ...backend.hand.model import HandModel
from .armature import rest_frames
from .drivers import drive_by_beta, drive_by_rotation

# Blender clamps a key's value to its slider's range, which ends here; drivers are clamped too.
KEY_LIMIT = 10.0
_SKIN_COLOUR = (0.56, 0.31, 0.22, 1.0)


def build_mesh(model: HandModel, armature: bpy.types.Object, name: str) -> bpy.types.Object:
    """Create a mesh object skinned and parented to the armature, linked to the same collections."""
    data = _new_mesh(model, name)
    mesh = bpy.data.objects.new(name, data)
    for collection in armature.users_collection:
        collection.objects.link(mesh)
    mesh.parent = armature
    _add_weights(mesh, model)
    _add_shape_keys(mesh, model, armature)
    _add_correctives(mesh, model, armature)
    modifier = mesh.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature
    # Preserving volume means dual quaternions; MANO is linear blend skinning.
    modifier.use_deform_preserve_volume = False
    mesh.livehand.is_skin = True
    return mesh


def _new_mesh(model: HandModel, name: str) -> bpy.types.Mesh:
    data = bpy.data.meshes.new(name)
    data.from_pydata(model.v_template.tolist(), [], model.f.tolist())
    uv_layer = data.uv_layers.new(name="UVMap")
    uv_layer.data.foreach_set("uv", model.vt[model.ft].astype(np.float32).ravel())
    data.polygons.foreach_set("use_smooth", np.ones(len(model.f), bool))
    data.materials.append(_skin_material())
    data.update()
    return data


def _skin_material() -> bpy.types.Material:
    """Create a material of skin colour in Solid, EEVEE and Cycles."""
    material = bpy.data.materials.new("LiveHand Skin")
    material.diffuse_color = _SKIN_COLOUR
    material.roughness = 0.5
    if material.node_tree is None:
        material.use_nodes = True
    assert material.node_tree is not None
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = _SKIN_COLOUR
    shader.inputs["Roughness"].default_value = 0.5
    return material


def _add_weights(mesh: bpy.types.Object, model: HandModel) -> None:
    weights = {deform_name(joint, model.side): model.lbs_weights[:, joint] for joint in range(16)}
    if model.has_arm:
        weights[deform_name(0, model.side)] = model.lbs_weights[:, 0] - model.arm_weights
        weights[forearm_deform_name(model.side)] = model.arm_weights
    for name, of_vertices in weights.items():
        group = mesh.vertex_groups.new(name=name)
        for vertex in np.flatnonzero(of_vertices > 0):
            group.add([int(vertex)], float(of_vertices[vertex]), "REPLACE")


def _add_shape_keys(mesh: bpy.types.Object, model: HandModel, armature: bpy.types.Object) -> None:
    mesh.shape_key_add(name="Basis")
    for k in np.flatnonzero(model.shapedirs.any((0, 1))).tolist():
        key = _add_key(mesh, f"beta{k}", model.v_template + model.shapedirs[..., k])
        drive_by_beta(key, "value", -1, np.eye(10)[k], armature)


def _add_correctives(mesh: bpy.types.Object, model: HandModel, armature: bpy.types.Object) -> None:
    frames = rest_frames(armature, model.side)
    for number, corrective in enumerate(factor_correctives(model.posedirs)):
        bone = bone_name(corrective.joint, model.side)
        key = _add_key(mesh, f"pose {number} {bone}", model.v_template + corrective.displacement)
        terms = quaternion_form(corrective.form, frames[corrective.joint])
        drive_by_rotation(key, "value", terms, armature, bone)


def _add_key(mesh: bpy.types.Object, name: str, vertices: np.ndarray) -> bpy.types.ShapeKey:
    key = mesh.shape_key_add(name=name, from_mix=False)
    key.data.foreach_set("co", vertices.astype(np.float32).ravel())
    key.slider_min, key.slider_max = -KEY_LIMIT, KEY_LIMIT
    return key
