"""Blender scene -> the hands that are rendered -> backend `Shot`. Reads the depsgraph only, and changes nothing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...backend.avatars.library import shipped_avatar_path
from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import Shot
from ..rig.hand import find_hands, mesh_of
from ..rig.pose import read_hand_pose


@dataclass(frozen=True)
class HandSource:
    """Where a hand and its look come from; a model's path of None is the built-in hand."""

    model_path: Path | None
    avatar_path: Path


def visible_hands(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """Evaluated armatures of all hands whose mesh is visible in this evaluation (the armature itself may be hidden)."""
    # Instances live for one step of the iteration only: keep pointers, never the objects.
    shown = {instance.object.original.as_pointer() for instance in depsgraph.object_instances if instance.show_self}
    # The depsgraph's own list leaves hidden objects out, so the armatures are the scene's.
    hands = find_hands(depsgraph.scene)
    return [hand.evaluated_get(depsgraph) for hand in hands if mesh_of(hand).as_pointer() in shown]


def hand_source(armature: bpy.types.Object) -> HandSource:
    """The files a hand asks for, with Blender's `//` resolved against the .blend that owns the hand."""
    owner, hand = armature.original, armature.original.livehand
    model_path, avatar_path = (
        Path(bpy.path.abspath(path, library=owner.library)) if path else None
        for path in (hand.model_path, hand.avatar_path)
    )
    return HandSource(model_path, avatar_path or shipped_avatar_path(hand.skin))


def read_shot(armature: bpy.types.Object, depsgraph: bpy.types.Depsgraph, camera: Camera, vertex_count: int) -> Shot:
    """One hand as it stands in the evaluated frame.

    Args:
        armature: one of `visible_hands`.
        depsgraph: of the frame.
        camera: the view.
        vertex_count: of the hand model; the evaluated mesh must have as many.

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
    return Shot(pose, vertices, camera)


def world_vertices(mesh_object: bpy.types.Object) -> np.ndarray:
    """[V, 3] m, of an evaluated mesh object."""
    mesh = mesh_object.to_mesh()
    try:
        local = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", local)
    finally:
        mesh_object.to_mesh_clear()
    matrix = np.array(mesh_object.matrix_world)
    return local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
