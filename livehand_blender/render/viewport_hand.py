"""Hands as a 3D view's scene shows them: plain values, which may leave Blender's thread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...backend.image.grade import Grade
from ...backend.records.camera import Camera
from ...backend.records.shot import HandPose, Quality, Shot
from ...backend.render.frame_task import HandRenderer, HandTask
from ...backend.render.session import Device, Session
from ..hands.shot import hand_hair, hand_pose, hand_pressed_m, hand_vertices, hand_wrist_fade_m
from ..hands.visible_hands import InstanceId, VisibleHand
from ..light.light import SceneLight, read_hand_lights
from ..light.solids import LocalTriangles
from .hand_source import HandSource, hand_source, load_for, read_device, read_grade


@dataclass(frozen=True)
class ViewportHand:
    """One hand: its name, its mesh's id, files, device, grade and pose; its posed vertices [V, 3] in the world, m.

    Its light is the scene's; None: that of its avatar's capture.
    """

    name: str
    instance_id: InstanceId
    source: HandSource
    device: Device
    grade: Grade
    pose: HandPose
    vertices: np.ndarray
    light: SceneLight | None = None
    wrist_fade_m: float = 0.0
    hair: float = 0.0
    pressed_m: np.ndarray | None = None

    def renderer(self, session: Session) -> HandRenderer:
        """Load its avatar; raises as `load_for`."""
        return load_for(self.name, self.source, session, self.device)

    def task(self, session: Session, camera: Camera, quality: Quality = "final") -> HandTask:
        """Make the task of rendering the hand; loads its avatar, and raises as `load_for`."""
        renderer = self.renderer(session)
        light = self.light.light() if self.light and renderer.is_relightable else None
        if light is not None:
            light = replace(light, shadow_quality="none" if quality == "preview" else "fine")
        shot = Shot(self.pose, self.vertices, camera, light, self.wrist_fade_m, self.hair, quality, self.pressed_m)
        return HandTask(renderer, shot)


def read_viewport_hands(
    space: bpy.types.SpaceView3D,
    depsgraph: bpy.types.Depsgraph,
    hands: Sequence[VisibleHand],
    local: LocalTriangles | None = None,
) -> tuple[ViewportHand, ...]:
    """Read those of the scene's hands that a 3D view shows; `local` holds triangles that were read before.

    Raises:
        LiveHandError: a hand lacks a bone or is not finite, or the world cannot be read.
    """
    device = read_device(depsgraph.scene)
    shown = [hand for hand in hands if _is_in(space, hand)]
    lights = read_hand_lights(depsgraph, shown, is_final=False, local=local)
    return tuple(
        ViewportHand(
            hand.name,
            hand.instance_id,
            hand_source(hand.armature),
            device,
            read_grade(hand.armature.evaluated_get(depsgraph)),
            hand_pose(hand, depsgraph),
            hand_vertices(hand, depsgraph),
            lights.get(hand.name),
            hand_wrist_fade_m(hand, depsgraph),
            hand_hair(hand, depsgraph),
            hand_pressed_m(hand, depsgraph),
        )
        for hand in shown
    )


def _is_in(space: bpy.types.SpaceView3D, hand: VisibleHand) -> bool:
    """Return whether a view shows it; in local view, instances follow what makes them."""
    return bool(hand.instance_id.instancer) or hand.mesh.visible_in_viewport_get(space)
