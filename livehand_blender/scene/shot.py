"""Reads the visible hands of a Blender scene, and the backend `Shot` of each, from the depsgraph."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.records.light import Light
from ...backend.records.shot import Shot
from ..rig.hand import find_hands, mesh_of
from ..rig.pose import read_hand_pose


def visible_hands(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """Evaluated armatures of all hands whose mesh is visible in the depsgraph; the armature itself may be hidden."""
    # Instances are valid for one step of the iteration only: keep pointers, never the objects.
    shown = {instance.object.original.as_pointer() for instance in depsgraph.object_instances if instance.show_self}
    # The depsgraph's list of objects lacks hidden ones, so the armatures come from the scene.
    hands = find_hands(depsgraph.scene)
    return [hand.evaluated_get(depsgraph) for hand in hands if mesh_of(hand).as_pointer() in shown]


def read_shot(
    armature: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    camera: Camera,
    vertex_count: int,
    light: Light | None = None,
) -> Shot:
    """Read one hand of the evaluated frame.

    Args:
        armature: one of `visible_hands`.
        depsgraph: of the frame.
        camera: the view.
        vertex_count: of the hand model; the evaluated mesh must have the same.
        light: what falls on the hand; None: the light of its avatar's capture.

    Raises:
        LiveHandError: a modifier changes the vertex count, or the pose or the mesh is not finite.
    """
    pose = read_hand_pose(armature, depsgraph)
    vertices = world_vertices(mesh_of(armature.original).evaluated_get(depsgraph))
    if len(vertices) != vertex_count:
        raise LiveHandError(
            f"the mesh of '{armature.name}' must keep its hand model's {vertex_count} vertices, it has "
            f"{len(vertices)} after modifiers; hide those that add or remove vertices (Subdivision, Mask) from renders"
        )
    return Shot(pose, vertices, camera, light)


def world_vertices(mesh_object: bpy.types.Object) -> np.ndarray:
    """The vertices [V, 3] of an evaluated mesh object in the world, m."""
    mesh = mesh_object.to_mesh()
    try:
        local = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", local)
    finally:
        mesh_object.to_mesh_clear()
    matrix = np.array(mesh_object.matrix_world)
    return local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
