"""Reads a visible hand as the backend's `Shot`."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.records.light import Light
from ...backend.records.shot import HandPose, Shot
from ..rig.pads import read_pressed_m
from ..rig.pose import read_hand_pose
from .visible_hands import VisibleHand


def read_shot(
    hand: VisibleHand, depsgraph: bpy.types.Depsgraph, camera: Camera, vertex_count: int, light: Light | None = None
) -> Shot:
    """Read one hand of the evaluated frame.

    Args:
        hand: one of `visible_hands`.
        depsgraph: of the frame.
        camera: the view.
        vertex_count: of the hand model; the evaluated mesh must have the same.
        light: what falls on the hand; None: the light of its avatar's capture.

    Raises:
        LiveHandError: a modifier changes the vertex count, or the pose or the mesh is not finite.
    """
    vertices = hand_vertices(hand, depsgraph)
    if len(vertices) != vertex_count:
        raise LiveHandError(
            f"the mesh of '{hand.name}' must keep its hand model's {vertex_count} vertices, it has "
            f"{len(vertices)} after modifiers; hide those that add or remove vertices (Subdivision, Mask) from renders"
        )
    fade_m, hair = hand_wrist_fade_m(hand, depsgraph), hand_hair(hand, depsgraph)
    pressed_m = hand_pressed_m(hand, depsgraph)
    return Shot(hand_pose(hand, depsgraph), vertices, camera, light, fade_m, hair, pressed_m=pressed_m)


def hand_pose(hand: VisibleHand, depsgraph: bpy.types.Depsgraph) -> HandPose:
    """Read the hand's pose; a mirrored right hand is a left one.

    Raises:
        LiveHandError: it is not finite.
    """
    pose = read_hand_pose(hand.armature, depsgraph)
    return pose.mirrored() if hand.is_mirrored else pose


def hand_wrist_fade_m(hand: VisibleHand, depsgraph: bpy.types.Depsgraph) -> float:
    """Measure how long the hand's fade is, on the hand at rest."""
    return 0.001 * hand.armature.evaluated_get(depsgraph).livehand.wrist_fade


def hand_hair(hand: VisibleHand, depsgraph: bpy.types.Depsgraph) -> float:
    """Read the share of its hairs that the hand shows."""
    return hand.armature.evaluated_get(depsgraph).livehand.hair


def hand_pressed_m(hand: VisibleHand, depsgraph: bpy.types.Depsgraph) -> np.ndarray | None:
    """Measure how far [V] the hand's skin is flattened, of the hand at rest; None: nowhere."""
    return read_pressed_m(hand.mesh, depsgraph)


def hand_vertices(hand: VisibleHand, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """Compute vertices [V, 3] of the hand's evaluated mesh in the world, m."""
    return _placed(_local_vertices(hand.mesh.evaluated_get(depsgraph)), hand.matrix)


def world_vertices(mesh_object: bpy.types.Object) -> np.ndarray:
    """Compute the vertices [V, 3] of an evaluated mesh object in the world, m."""
    return _placed(_local_vertices(mesh_object), np.array(mesh_object.matrix_world))


def _local_vertices(mesh_object: bpy.types.Object) -> np.ndarray:
    mesh = mesh_object.to_mesh()
    try:
        local = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", local)
    finally:
        mesh_object.to_mesh_clear()
    return local.reshape(-1, 3)


def _placed(local: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return local @ matrix[:3, :3].T + matrix[:3, 3]
