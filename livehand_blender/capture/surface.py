"""The detailed hand as a Blender mesh that is built once; its vertices and bend attribute follow the pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np
import torch
from mathutils.bvhtree import BVHTree

from ...backend.capture.person import Person
from ...backend.geometry.torch_rotation import axis_angle_to_matrix
from ...backend.hand.lbs import SkinTensors, forearm_offsets, joint_transforms
from ...backend.hand.model import HandModel
from ...backend.records.shot import HandPose
from ...backend.surface.blood import tightness
from ...backend.surface.detail_maps_file import SkinFlexion
from ...backend.teacher.dependencies import needs
from ...backend.teacher.detailed_surface import DetailedSurface
from ...backend.teacher.frames import template_to_build
from .skin import MASKS, UV_LAYER

with needs("scipy"):
    from scipy.spatial import KDTree

_POSE_ATTRIBUTES = ("flex", "crossing", "drained")
_CROSSING_REACH_M = 0.005  # from a line where parts cross: as far as light is scattered under the skin


@dataclass(frozen=True)
class SkinSurface:
    """A detailed surface, its hand model, its Blender object and the height of its veins."""

    model: HandModel
    detail: DetailedSurface
    object: bpy.types.Object
    veins_mm: float

    @classmethod
    def create(cls, model: HandModel, detail: DetailedSurface, veins_mm: float = Person.veins_mm) -> SkinSurface:
        """Add the surface, unposed and without material, to the current scene."""
        mesh = bpy.data.meshes.new("skin")
        _fill_mesh(mesh, detail)
        surface = bpy.data.objects.new("skin", mesh)
        bpy.context.scene.collection.objects.link(surface)
        return cls(model, detail, surface, veins_mm)

    @cached_property
    def _skin(self) -> SkinTensors:
        return SkinTensors.of(self.model, dtype=torch.float64)

    def set_pose(self, pose: HandPose) -> None:
        """Move the mesh to the pose."""
        mesh = self.object.data
        vertices = self.posed_vertices(pose).astype(np.float32)
        mesh.vertices.foreach_set("co", vertices.ravel())
        flex = self._flex(pose.theta).astype(np.float32)
        mesh.attributes["flex"].data.foreach_set("value", flex)
        drained = self.detail.drains * tightness(torch.as_tensor(flex)).numpy()
        mesh.attributes["drained"].data.foreach_set("value", drained.astype(np.float32))
        mesh.attributes["crossing"].data.foreach_set("value", crossing(vertices, self.detail.faces))
        mesh.update()

    def posed_vertices(self, pose: HandPose) -> np.ndarray:
        """Pose vertices [N, 3] m: the template's blend shapes, interpolated by subdivision, then skinned linearly."""
        rotations = axis_angle_to_matrix(torch.as_tensor(pose.theta, dtype=torch.float64))
        features = (rotations[1:].numpy() - np.eye(3)).reshape(-1)
        offsets = self.model.posedirs @ features + self.model.shapedirs @ pose.beta
        relief = self.detail.relief_m(pose.theta, self.veins_mm, pose.forearm)
        v_posed = self.detail.vertices_m + relief + self.detail.subdivision @ offsets
        joints = self.model.J_regressor @ (self.model.v_template + self.model.shapedirs @ pose.beta)
        transforms = joint_transforms(rotations, torch.as_tensor(joints), self._skin.parents).numpy()
        blended = np.einsum("vj,jab->vab", self.detail.lbs_weights, transforms[:, :3])
        if pose.forearm.any():
            of_wrist = (torch.as_tensor(array) for array in (transforms[0, :3], pose.forearm, joints[0]))
            blended += forearm_offsets(torch.as_tensor(self.detail.arm_weights), *of_wrist).numpy()
        return np.einsum("vab,vb->va", blended[..., :3], v_posed) + blended[..., 3] + pose.transl

    def _flex(self, theta: np.ndarray) -> np.ndarray:
        return SkinFlexion(self.detail.masks["jid"].astype(int), self.detail.flex_axis).flex(theta)


def crossing(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute [N] float32: 1 where the surface crosses itself, falling to 0 at 5 mm from there."""
    tree = BVHTree.FromPolygons(vertices.tolist(), faces.tolist())
    pairs = np.array(tree.overlap(tree), int).reshape(-1, 2)
    first, second = faces[pairs[:, 0]], faces[pairs[:, 1]]
    are_neighbours = (first[:, :, None] == second[:, None]).any((1, 2))
    lines = vertices[np.unique(first[~are_neighbours])]
    if not len(lines):
        return np.zeros(len(vertices), np.float32)
    distance, _ = KDTree(lines).query(vertices, distance_upper_bound=_CROSSING_REACH_M)
    return (1 - np.minimum(distance / _CROSSING_REACH_M, 1)).astype(np.float32)


def _fill_mesh(mesh: bpy.types.Mesh, detail: DetailedSurface) -> None:
    vertices, faces = detail.vertices_m, detail.faces
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    for name in (*MASKS, *_POSE_ATTRIBUTES):
        attribute = mesh.attributes.new(name, "FLOAT", "POINT")
        if name in MASKS:
            attribute.data.foreach_set("value", detail.masks[name].astype(np.float32))
    rest = mesh.attributes.new("rest", "FLOAT_VECTOR", "POINT")
    rest.data.foreach_set("vector", template_to_build(vertices).astype(np.float32).ravel())
    mesh.uv_layers.new(name=UV_LAYER).data.foreach_set("uv", detail.uv.astype(np.float32).ravel())
