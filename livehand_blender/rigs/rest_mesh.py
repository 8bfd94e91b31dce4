"""A skinned mesh, at rest and in the world -> `SkinnedSurface`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from ...backend.records.errors import LiveHandError
from ...backend.rigs.hand_from_mesh.skinned_surface import SkinnedSurface
from ...backend.rigs.source_skeleton import SourceSkeleton


class RestMesh(NamedTuple):
    """A mesh as evaluated at rest, without its subdivision.

    Attributes:
        data: a copy, which the caller must remove.
        surface: the same mesh as arrays.
        smoothed_m: [N] how far its subdivision moves each vertex.
    """

    data: bpy.types.Mesh
    surface: SkinnedSurface
    smoothed_m: np.ndarray


def read_rest_mesh(
    context: bpy.types.Context, mesh: bpy.types.Object, armature: bpy.types.Object, skeleton: SourceSkeleton
) -> RestMesh:
    """Read the mesh with all modifiers except Subdivision, in the armature's rest pose.

    Raises:
        LiveHandError: the mesh has no faces, or the armature's bones do not deform it.
    """
    with _at_rest(context, mesh, armature):
        depsgraph = context.evaluated_depsgraph_get()
        data = bpy.data.meshes.new_from_object(
            mesh.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
        )
    try:
        surface = _surface(data, mesh, armature, skeleton)
        with _at_rest(context, mesh, armature, is_subdivided=True):
            smooth = _world_vertices(mesh.evaluated_get(context.evaluated_depsgraph_get()), mesh.matrix_world)
        moved = smooth[: len(surface.vertices_m)] - surface.vertices_m  # subdivision appends vertices
        return RestMesh(data, surface, np.linalg.norm(moved, axis=1))
    except LiveHandError:
        bpy.data.meshes.remove(data)
        raise


@contextlib.contextmanager
def _at_rest(
    context: bpy.types.Context, mesh: bpy.types.Object, armature: bpy.types.Object, is_subdivided: bool = False
) -> Iterator[None]:
    position = armature.data.pose_position
    shown = {modifier: modifier.show_viewport for modifier in mesh.modifiers if modifier.type == "SUBSURF"}
    try:
        armature.data.pose_position = "REST"
        for modifier in shown:
            modifier.show_viewport = is_subdivided and modifier.show_render
        context.view_layer.update()
        yield
    finally:
        armature.data.pose_position = position
        for modifier, was_shown in shown.items():
            modifier.show_viewport = was_shown
        context.view_layer.update()


def _surface(
    data: bpy.types.Mesh, mesh: bpy.types.Object, armature: bpy.types.Object, skeleton: SourceSkeleton
) -> SkinnedSurface:
    data.calc_loop_triangles()
    if not data.loop_triangles:
        raise LiveHandError(f"'{mesh.name}' must have faces, got none; choose the hand's mesh")
    weights = _weights(data, mesh, armature, skeleton)
    if not weights.any():
        raise LiveHandError(
            f"bones of '{armature.name}' must deform '{mesh.name}', none does; choose the mesh that is skinned to them"
        )
    matrix = np.array(mesh.matrix_world, np.float64)
    faces = _read(data.loop_triangles, "vertices", np.int32, 3).astype(np.int64)
    if np.linalg.det(matrix[:3, :3]) < 0:  # Blender flips the faces of an object with negative scale
        faces = faces[:, ::-1].copy()
    polygons = _read(data.loop_triangles, "polygon_index", np.int32, 1).ravel().astype(np.int64)
    return SkinnedSurface(_placed(data, matrix), faces, polygons, weights)


def _world_vertices(evaluated: bpy.types.Object, matrix_world: Matrix) -> np.ndarray:
    try:
        return _placed(evaluated.to_mesh(), np.array(matrix_world, np.float64))
    finally:
        evaluated.to_mesh_clear()


def _placed(data: bpy.types.Mesh, matrix: np.ndarray) -> np.ndarray:
    return _read(data.vertices, "co", np.float32, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _weights(
    data: bpy.types.Mesh, mesh: bpy.types.Object, armature: bpy.types.Object, skeleton: SourceSkeleton
) -> np.ndarray:
    deforming = {bone.name for bone in armature.data.bones if bone.use_deform}
    column = {group.index: skeleton.names.index(group.name) for group in mesh.vertex_groups if group.name in deforming}
    weights = np.zeros((len(data.vertices), len(skeleton.names)))
    for row, vertex in enumerate(data.vertices):
        for element in vertex.groups:
            if element.group in column:
                weights[row, column[element.group]] = element.weight
    return weights


def _read(elements: bpy.types.bpy_prop_collection, name: str, kind: type, width: int) -> np.ndarray:
    flat = np.empty(len(elements) * width, kind)
    elements.foreach_get(name, flat)
    return flat.reshape(-1, width)
