"""A hand's motion onto its armature, and back from it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...backend.hand.model import HandModel
from ...backend.motion.motion import HandMotion, mirrored, motion_from_poses
from ...backend.motion.resampling import resampled
from ...backend.motion.spaces import Space, rest_wrists, to_blender, transformed
from ...backend.records.errors import LiveHandError
from ..rig.keyframes import keyframe_theta, keyframe_transl
from ..rig.pose import hand_side, read_hand_pose

_BETA_LIMIT = 10.0  # of the sliders


@dataclass(frozen=True)
class Placement:
    """How a motion comes onto a hand.

    Attributes:
        space: of the motion; all but `hand` are brought into Blender's world, wherever the armature stands.
        start_frame: of its first key.
        matches_fps: the motion keeps its speed; False: one key a frame, at whatever rate the scene has.
        mirrors: a motion of the other hand is mirrored; False: it is refused.
        keys_wrist: the wrist's rotation is keyed.
        keys_place: the wrist's location is keyed.
        sets_shape: the hand takes the motion's shape, its mean where it changes.
        camera: [4, 4] Blender's matrix of the camera whose axes a motion in a camera's space has; None: one at the
            world's origin that looks along +Y.
    """

    space: Space
    start_frame: int = 1
    matches_fps: bool = True
    mirrors: bool = False
    keys_wrist: bool = True
    keys_place: bool = True
    sets_shape: bool = False
    camera: np.ndarray | None = None


def key_motion(
    scene: bpy.types.Scene, armature: bpy.types.Object, model: HandModel, motion: HandMotion, placement: Placement
) -> int:
    """Key a hand with a motion, after everything has been checked; returns how many frames were keyed.

    Args:
        scene: whose frame rate counts.
        armature: the hand.
        model: the hand's.
        motion: absolute, m, in the placement's space.
        placement: how.

    Raises:
        LiveHandError: the motion is the other hand's and may not be mirrored, or the object is no hand. Nothing is
            changed then.
    """
    side = hand_side(armature)
    motion = of_side(motion, armature, placement.mirrors)
    if placement.matches_fps and motion.fps is not None:
        motion = resampled(motion, scene.render.fps / scene.render.fps_base)
    beta = np.clip(motion.betas.mean(0), -_BETA_LIMIT, _BETA_LIMIT)
    motion = _of_shape(motion, beta if placement.sets_shape else np.array(armature.livehand.beta), model.for_side(side))
    if placement.space != "hand":
        to_armature = np.linalg.inv(np.array(armature.matrix_world)) @ _to_world(placement)
        motion = transformed(motion, to_armature, rest_wrists(model.for_side(side), motion.beta))
    frames = placement.start_frame + np.arange(len(motion))
    keyframe_theta(armature, motion.theta, frames, range(0 if placement.keys_wrist else 1, 16))
    if placement.keys_place:
        keyframe_transl(armature, motion.transl, frames)
    if placement.sets_shape:
        armature.livehand.beta = beta
    armature.update_tag()
    return len(frames)


def of_side(motion: HandMotion, armature: bpy.types.Object, mirrors: bool) -> HandMotion:
    """The motion as a hand can take it, mirrored if it may be.

    Raises:
        LiveHandError: it is the other hand's and may not be mirrored, or the object is no hand.
    """
    side = hand_side(armature)
    if motion.side == side:
        return motion
    if not mirrors:
        raise LiveHandError(
            f"{armature.name} is a {side} hand, the motion a {motion.side} one; turn on Mirror, or choose that hand"
        )
    return mirrored(motion)


def sample_motion(context: bpy.types.Context, armature: bpy.types.Object, frames: Iterable[int]) -> HandMotion:
    """What a hand does in the scene's frames, constraints and drivers included; the frame is put back afterwards.

    Raises:
        LiveHandError: the object is no hand, or a channel is not finite.
    """
    scene = context.scene
    before = scene.frame_current_final
    poses = []
    try:
        for frame in frames:
            scene.frame_set(frame)
            poses.append(read_hand_pose(armature, context.evaluated_depsgraph_get()))
    finally:
        scene.frame_set(int(np.floor(before)), subframe=before % 1)
    return motion_from_poses(poses, scene.render.fps / scene.render.fps_base)


def _to_world(placement: Placement) -> np.ndarray:
    """[4, 4] from the motion's space to Blender's world; Blender's own camera has OpenGL's axes."""
    matrix = to_blender(placement.space)
    if placement.camera is None or placement.space not in ("opencv", "opengl"):
        return matrix
    return placement.camera @ np.linalg.inv(to_blender("opengl")) @ matrix


def _of_shape(motion: HandMotion, beta: np.ndarray, model: HandModel) -> HandMotion:
    """The motion of a hand of another shape, the wrist where it was."""
    wrists = rest_wrists(model, motion.betas) - rest_wrists(model, beta)
    return replace(motion, beta=beta, transl=motion.transl + wrists)
