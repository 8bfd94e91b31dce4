"""A hand's motion onto its armature as keyframes, and sampled from it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import ceil

import bpy
import numpy as np

from ...backend.hand.model import HandModel
from ...backend.motion.motion import HandMotion, mirrored, motion_from_poses
from ...backend.motion.resampling import resampled
from ...backend.motion.spaces import Space, rest_wrists, to_blender, transformed
from ...backend.records.errors import LiveHandError
from ..rig.hand import RiggedHand
from ..rig.keyframes import keyframe_theta, keyframe_transl
from ..rig.pose import read_pose
from ..rig.sliders import read_beta, write_slider
from .frames import current_frame_restored, frame_rate

_BETA_LIMIT = 10.0  # of the sliders
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Placement:
    """How a motion is transferred to a hand.

    Attributes:
        space: of the motion; unless it is `hand`, the motion is converted to Blender's world, wherever the armature is.
        start_frame: of the first frame of the motion's file.
        first: how many frames of the file are before the motion's first, as `FileInfo` has it.
        matches_fps: resample the motion to the scene's frame rate; False: key one frame of the motion per frame.
        mirrors: mirror a motion of the other side; False: raise an error.
        keys_wrist: key the rotations of wrist and forearm.
        keys_place: key the wrist's location; a forearm that turns is moved so that the wrist stays, without it.
        sets_shape: give the hand the motion's shape, or its mean if it changes.
        camera: [4, 4] Blender's matrix of the camera for a motion in a camera's space; None: a camera at the world's
            origin that looks along +Y.
    """

    space: Space
    start_frame: int = 1
    first: int = 0
    matches_fps: bool = True
    mirrors: bool = False
    keys_wrist: bool = True
    keys_place: bool = True
    sets_shape: bool = False
    camera: np.ndarray | None = None


def key_motion(
    scene: bpy.types.Scene,
    hand: RiggedHand,
    motion: HandMotion,
    placement: Placement,
    is_keyed: np.ndarray | None = None,
) -> int:
    """Key a hand with a motion; returns the number of frames that were keyed.

    Args:
        scene: with the frame rate to match.
        hand: to be keyed.
        motion: absolute, m, in the placement's space.
        placement: how it is transferred.
        is_keyed: [T] the frames of the motion that get keys; None: all.

    Raises:
        LiveHandError: the motion is for the other side and may not be mirrored, or the hand's model cannot be read.
            Nothing is changed then.
    """
    motion = motion_for_hand(motion, hand, placement.mirrors)
    speed, start_frame = 1.0, placement.start_frame + placement.first
    if placement.matches_fps and motion.fps is not None:
        speed = motion.fps / frame_rate(scene)
        delay = placement.first / speed
        late = ceil(delay - _ROUNDING)  # the scene's first frame within the motion
        start_frame = placement.start_frame + late
        motion = resampled(motion, frame_rate(scene), max(0.0, (late - delay) * speed))
    beta = np.clip(motion.betas.mean(0), -_BETA_LIMIT, _BETA_LIMIT)
    motion = _with_shape(motion, beta if placement.sets_shape else read_beta(hand.armature), hand.model)
    if placement.space != "hand":
        motion = transformed(motion, to_armature(hand.armature, placement), rest_wrists(hand.model, motion.beta))
    steps = np.arange(len(motion))
    if is_keyed is not None:
        steps = steps[is_keyed[np.minimum((steps * speed).round().astype(int), len(is_keyed) - 1)]]
    frames = start_frame + steps
    joints = range(0 if placement.keys_wrist else 1, 16)
    keyframe_theta(hand, motion.theta[steps], frames, joints, motion.forearms[steps])
    if placement.keys_place:
        keyframe_transl(hand, motion.transl[steps], frames)
    if placement.sets_shape:
        write_slider(hand.armature, "beta", beta)
    hand.armature.update_tag()
    return len(frames)


def motion_for_hand(motion: HandMotion, hand: RiggedHand, mirrors: bool) -> HandMotion:
    """Return the motion for the hand's side, mirrored if necessary.

    Raises:
        LiveHandError: it is for the other side and may not be mirrored.
    """
    if motion.side == hand.side:
        return motion
    if not mirrors:
        raise LiveHandError(
            f"{hand.armature.name} is a {hand.side} hand, the motion a {motion.side} one; turn on Mirror, or choose "
            "that hand"
        )
    return mirrored(motion)


def to_armature(armature: bpy.types.Object, placement: Placement) -> np.ndarray:
    """Compute the matrix [4, 4] from a placement's space, which is not the hand's own, to an armature's."""
    return np.linalg.inv(np.array(armature.matrix_world)) @ _to_world(placement)


def sample_motion(context: bpy.types.Context, hand: RiggedHand, frames: Iterable[int]) -> HandMotion:
    """Sample a hand's motion in frames of the scene, with constraints and drivers.

    Raises:
        LiveHandError: a channel is not finite.
    """
    scene = context.scene
    poses = []
    with current_frame_restored(scene):
        for frame in frames:
            scene.frame_set(frame)
            poses.append(read_pose(hand, context.evaluated_depsgraph_get()))
    return motion_from_poses(poses, frame_rate(scene))


def _to_world(placement: Placement) -> np.ndarray:
    """Compute the matrix [4, 4] from the motion's space to Blender's world; Blender's own camera has OpenGL's axes."""
    matrix = to_blender(placement.space)
    if placement.camera is None or placement.space not in ("opencv", "opengl"):
        return matrix
    return placement.camera @ np.linalg.inv(to_blender("opengl")) @ matrix


def _with_shape(motion: HandMotion, beta: np.ndarray, model: HandModel) -> HandMotion:
    """Convert the motion to another shape, with the wrist in the same position."""
    offset = rest_wrists(model, motion.betas) - rest_wrists(model, beta)
    return replace(motion, beta=beta, transl=motion.transl + offset)
