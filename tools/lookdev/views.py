"""The views from which a person's hand is judged: whole hands and close-ups, each in one key lamp over a dim world."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from ...backend.geometry.rotation import matrix_to_axis_angle
from ...backend.hand.gestures import theta_of
from ...backend.hand.joint_axes import finger_axes
from ...backend.hand.model import UPRIGHT, HandModel
from ...backend.hand.posed_bones import bone_frames
from ...backend.hand.poses import POSES
from ...backend.records.camera import Camera, look_at
from ...backend.records.shot import HandPose
from ...livehand_blender.capture.node_graph import enable_nodes

CAMERA_M = 0.7
# The key lamp: a square this far from the subject, this far off the view, towards the upper left.
LAMP_M, LAMP_SIDE_M, LAMP_W, _LAMP_OFF_VIEW_DEG = 0.9, 0.25, 11.0, 55.0
_WORLD_RGB, WORLD_STRENGTH = (0.75, 0.85, 1.0), 0.18


class HandView(NamedTuple):
    """A view of a pose of the library.

    Attributes:
        pose: its name.
        joint: near which the camera looks.
        offset_mm: from the joint along (distal, dorsal, radial), the hand's own axes at rest.
        towards: from there to the camera, along the same axes.
        mm_per_px: at that place.
    """

    pose: str
    joint: int
    offset_mm: tuple[float, float, float]
    towards: tuple[float, float, float]
    mm_per_px: float


# The six views of which the contrast is measured.
WHOLE_HANDS = {
    "open, back": HandView("Open", 4, (-20, 0, 0), (0.1, 1, 0.1), 0.5),
    "open, palm": HandView("Open", 4, (-20, 0, 0), (0.1, -1, 0.1), 0.5),
    "half open, back": HandView("Claw", 4, (-20, 0, 0), (0.1, 1, 0.1), 0.5),
    "half open, palm": HandView("Claw", 4, (-20, 0, 0), (0.1, -1, 0.1), 0.5),
    "fist, back": HandView("Fist", 4, (-20, 0, 0), (0.75, 0.5, 0.5), 0.5),
    "fist, palm": HandView("Fist", 4, (-20, 0, 0), (0.2, -1, 0.2), 0.5),
}
CLOSE_UPS = {
    "back": HandView("Open", 4, (-25, 0, 0), (0.0, 1, 0.0), 0.15),
    "knuckles": HandView("Open", 4, (5, 0, 0), (0.3, 1, 0.0), 0.15),
    "straight joint": HandView("Open", 2, (0, 0, 0), (0.2, 1, 0.3), 0.15),
    "bent joint": HandView("Claw", 2, (0, 0, 0), (0.6, 0.7, 0.5), 0.15),
    "nail": HandView("Open", 3, (12, 0, 0), (0.4, 1, 0.2), 0.1),
    "palm": HandView("Open", 4, (-30, 0, 0), (0.0, -1, 0.0), 0.15),
    "pads": HandView("Relaxed", 6, (0, 0, 0), (0.0, -1, 0.3), 0.15),
    "fist": HandView("Fist", 4, (0, 0, 0), (0.6, 0.8, 0.0), 0.15),
    "thumb on fist": HandView("Fist", 2, (0, 0, 0), (0.9, -0.6, 0.35), 0.15),
    "wrist": HandView("Open", 0, (-5, 0, 0), (-0.1, 1, 0.2), 0.15),
}


class Aim(NamedTuple):
    """The pose of a view, its camera, and the direction [3] from the subject to it."""

    pose: HandPose
    camera: Camera
    subject_m: np.ndarray
    towards: np.ndarray


def aim(view: HandView, model: HandModel, beta: np.ndarray, size_px: int) -> Aim:
    """Choose how a right hand is posed and seen in a view, in a square picture."""
    theta = theta_of(POSES[view.pose].gesture.angles_deg(), finger_axes(model), matrix_to_axis_angle(UPRIGHT))
    pose = HandPose(theta, beta, np.zeros(3))
    frames = bone_frames(model, pose)
    axes = frames[0, :3, :3] * (-1, 1, 1)  # columns: distal, dorsal, radial; the template's fingers point to -X
    subject = frames[view.joint, :3, 3] + axes @ np.array(view.offset_mm) / 1000
    towards = axes @ np.array(view.towards)
    towards /= np.linalg.norm(towards)
    up = axes[:, 0] if abs(axes[:, 0] @ towards) < 0.95 else axes[:, 1]
    focal_px = CAMERA_M / (view.mm_per_px / 1000)
    K = np.array([[focal_px, 0, size_px / 2], [0, focal_px, size_px / 2], [0, 0, 1]])
    return Aim(
        pose, Camera(K, look_at(subject + CAMERA_M * towards, subject, up), (size_px, size_px)), subject, towards
    )


def towards_lamp(at: Aim) -> np.ndarray:
    """Return the direction [3] from the subject to the key lamp."""
    right, down = at.camera.cam2world[:3, 0], at.camera.cam2world[:3, 1]
    angle = np.deg2rad(_LAMP_OFF_VIEW_DEG)
    return np.cos(angle) * at.towards - np.sin(angle) * (0.8 * right + 0.6 * down)


class KeyLight:
    """A dim world and one square lamp that follows the view."""

    def __init__(self, scene: bpy.types.Scene):
        """Replace the scene's world, and add the lamp."""
        scene.world = bpy.data.worlds.new("dim")
        background = enable_nodes(scene.world).nodes["Background"]
        background.inputs["Color"].default_value = (*_WORLD_RGB, 1)
        background.inputs["Strength"].default_value = WORLD_STRENGTH
        data = bpy.data.lights.new("key", "AREA")
        data.shape, data.size, data.energy = "SQUARE", LAMP_SIDE_M, LAMP_W
        self._lamp = bpy.data.objects.new("key", data)
        self._lamp.visible_camera = False
        scene.collection.objects.link(self._lamp)

    def follow(self, aim: Aim) -> None:
        """Place the lamp for a view."""
        down, to_lamp = aim.camera.cam2world[:3, 1], towards_lamp(aim)
        side = np.cross(down, to_lamp)
        side /= np.linalg.norm(side)
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([side, np.cross(to_lamp, side), to_lamp], 1)
        matrix[:3, 3] = aim.subject_m + LAMP_M * to_lamp
        self._lamp.matrix_world = Matrix(matrix.tolist())
