"""Hands as a 3D view's scene shows them: plain values, which may leave Blender's thread."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ....backend.avatars.session import Device, Session
from ....backend.records.camera import Camera
from ....backend.records.shot import HandPose, Shot
from ....backend.rendering.frame_task import HandTask
from ....backend.rendering.grade import Grade
from ...rig.hand import mesh_of
from ...rig.pose import read_hand_pose
from ...scene.shot import visible_hands, world_vertices
from ..hands.hand_source import HandSource, hand_source, read_device, read_grade


@dataclass(frozen=True)
class ViewportHand:
    """One hand: its files, device, grade and pose, and its posed vertices [V, 3] in the world, m."""

    source: HandSource
    device: Device
    grade: Grade
    pose: HandPose
    vertices: np.ndarray

    def task(self, session: Session, camera: Camera) -> HandTask:
        """The task of rendering the hand; loads its avatar, and raises as `HandSource.renderer`."""
        return HandTask(self.source.renderer(session, self.device), Shot(self.pose, self.vertices, camera))


def read_viewport_hands(space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph) -> tuple[ViewportHand, ...]:
    """All hands that a 3D view shows.

    Raises:
        LiveHandError: a hand lacks its mesh or a bone, or is not finite.
    """
    device = read_device(depsgraph.scene)
    meshes = ((hand, mesh_of(hand.original)) for hand in visible_hands(depsgraph))
    return tuple(
        ViewportHand(
            hand_source(hand),
            device,
            read_grade(hand),
            read_hand_pose(hand, depsgraph),
            world_vertices(mesh.evaluated_get(depsgraph)),
        )
        for hand, mesh in meshes
        if mesh.visible_in_viewport_get(space)
    )
