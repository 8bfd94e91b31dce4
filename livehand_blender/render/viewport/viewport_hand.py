"""Hands as they stand in a 3D view's scene: plain values, which may leave Blender's thread."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ....backend.avatars.session import Device, Session
from ....backend.records.camera import Camera
from ....backend.records.shot import HandPose, Shot
from ....backend.rendering.frame_task import HandTask
from ...rig.hand import mesh_of
from ...rig.pose import read_hand_pose
from ...scene.grade import Grade
from ...scene.shot import HandSource, hand_source, visible_hands, world_vertices


@dataclass(frozen=True)
class ViewportHand:
    """One hand: its files, the device, its colours, its pose, and its posed vertices [V, 3] in the world, m."""

    source: HandSource
    device: Device
    grade: Grade
    pose: HandPose
    vertices: np.ndarray

    def task(self, session: Session, camera: Camera) -> HandTask:
        """The work of rendering it; loads the avatar, which can take seconds.

        Raises:
            LiveHandError: a file or a package is missing, or does not fit.
        """
        hand = session.hand(self.source.model_path)
        renderer = session.renderer(self.source.avatar_path, hand, self.device)
        return HandTask(renderer, Shot(self.pose, self.vertices, camera))


def read_viewport_hands(space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph) -> tuple[ViewportHand, ...]:
    """All hands that a 3D view shows.

    Raises:
        LiveHandError: a hand lacks its mesh or a bone, or is not finite.
    """
    settings = depsgraph.scene.livehand
    device = Device(settings.device, settings.precision)
    meshes = ((hand, mesh_of(hand.original)) for hand in visible_hands(depsgraph))
    return tuple(
        ViewportHand(
            hand_source(hand),
            device,
            Grade.of_hand(hand),
            read_hand_pose(hand, depsgraph),
            world_vertices(mesh.evaluated_get(depsgraph)),
        )
        for hand, mesh in meshes
        if mesh.visible_in_viewport_get(space)
    )
