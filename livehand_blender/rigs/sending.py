"""A take onto a character's own bones, as keys: the reverse of `follow`.

Frame by frame, from the arm to the fingertips, each control is turned until its bone has the rotation that our joint
has, with the rig's own constraints at work; metacarpals go to rest. Then all of it is keyed at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import bpy
import numpy as np

from ...backend.geometry.rotation import matrix_to_axis_angle
from ...backend.hand.model import JOINT_NAMES
from ...backend.motion.resampling import resampled
from ...backend.motion.writers.take import TakenHand
from ...backend.records.errors import LiveHandError
from ...backend.rigs.natural_range import is_natural, rest_pose
from ...backend.rigs.rest_alignment import RestAlignment, align
from ...backend.rigs.sent_motion import sent_motion
from ...backend.rigs.shape_fit import HandShape
from ..motion.frames import current_frame_restored, frame_rate
from .controls import Arm
from .follow import natural_alignment
from .rig_poser import RigPoser
from .source import SourceRig, read_skeleton, sample_source

_ROUNDING = 1e-6
_MOST_DEG, _MOST_M = 1.0, 0.005  # from which a bone is named that is not where it should be


@dataclass(frozen=True)
class Sent:
    """What was keyed.

    Attributes:
        frames: how many.
        bones: how many controls got keys.
        worst_deg: the largest difference of a joint's rotation from the hand's.
        worst_m: the largest distance of the wrist from the hand's.
        doubt: what speaks against the result; None: nothing.
    """

    frames: int
    bones: int
    worst_deg: float
    worst_m: float
    doubt: str | None


def send(
    context: bpy.types.Context,
    hand: TakenHand,
    rig: SourceRig,
    frames: Sequence[int],
    fits_shape: bool = False,
    arm: Arm = "FK",
) -> Sent:
    """Key a rig's bones with a hand's motion.

    Args:
        context: of the scene that contains the rig.
        hand: of the rig's side.
        rig: with the bones that are the hand's joints.
        frames: consecutive, one for each of the motion.
        fits_shape: the rig's proportions tell what a joint's rotation means; False: the hand's own, so that the rig's
            bones point exactly where the hand's do.
        arm: which controls of a generated rig move the wrist.

    Raises:
        LiveHandError: the sides or the counts differ, a bone is missing, the rig is linked or has a negative scale, or
            has no IK control. Nothing is changed then.
    """
    _check(hand, rig, frames)
    alignment = _alignment(context, hand, rig, fits_shape)
    wanted = sent_motion(hand.motion, alignment)
    poser = RigPoser(context, rig, arm)
    with current_frame_restored(context.scene), poser.channels_restored():
        missed_m = max(poser.pose(frame, wanted, index) for index, frame in enumerate(frames))
    poser.key(frames)
    found = sample_source(context, rig, frames)
    off_deg, turned_deg = _differences_deg(found.frames, wanted.frames)
    worst_m = float(np.linalg.norm(found.wrists - wanted.wrists, axis=1).max())
    doubt = _doubt(rig, off_deg, turned_deg, worst_m, missed_m)
    return Sent(len(frames), poser.count, float(off_deg.max()), worst_m, doubt)


def send_at_rate(
    context: bpy.types.Context,
    hand: TakenHand,
    rig: SourceRig,
    fps: float,
    start_frame: int,
    fits_shape: bool = False,
    arm: Arm = "FK",
) -> Sent:
    """Key a rig's bones with a hand of a take of this rate, resampled to the scene's; the take begins at a frame.

    Raises:
        LiveHandError: as `send`.
    """
    rate = frame_rate(context.scene)
    late = hand.first * rate / fps
    first = ceil(late - _ROUNDING)
    motion = resampled(replace(hand.motion, fps=fps), rate, max(0.0, (first - late) * fps / rate))
    frames = range(start_frame + first, start_frame + first + len(motion))
    return send(context, replace(hand, motion=motion), rig, frames, fits_shape, arm)


def _check(hand: TakenHand, rig: SourceRig, frames: Sequence[int]) -> None:
    armature = rig.armature
    if hand.side != rig.joint_map.side:
        raise LiveHandError(
            f"a {hand.side} hand must be sent to a {hand.side} one, got the {rig.joint_map.side} hand of "
            f"{armature.name}; choose the bones of the other side"
        )
    if len(frames) != len(hand.motion):
        raise LiveHandError(f"a motion of {len(hand.motion)} frames must get as many, got {len(frames)}")
    if armature.library is not None:
        raise LiveHandError(
            f"{armature.name} must be local to this file, or a library override, to get keys; it is linked: choose "
            "Object > Library Override > Make"
        )
    if np.linalg.det(np.array(armature.matrix_world.to_3x3())) <= 0:
        raise LiveHandError(f"{armature.name} must not be scaled by negative numbers or zero; apply its scale first")


def _alignment(context: bpy.types.Context, hand: TakenHand, rig: SourceRig, fits_shape: bool) -> RestAlignment:
    shape = None if fits_shape else HandShape(hand.motion.betas.mean(0), hand.scale)
    alignment = align(read_skeleton(rig.armature), rig.joint_map, hand.own_model, shape)
    if is_natural(alignment.model, rest_pose(alignment)):
        return alignment
    return natural_alignment(context, rig, alignment)


def _differences_deg(frames: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measure by how much bones of frames [T, 16, 3, 3] differ at most, [16]: in all, and where they point."""
    off = matrix_to_axis_angle(frames @ others.swapaxes(-1, -2))
    sines = np.linalg.norm(np.cross(frames[..., 1], others[..., 1]), axis=-1)
    turned = np.arctan2(sines, (frames[..., 1] * others[..., 1]).sum(-1))
    return np.rad2deg(np.linalg.norm(off, axis=-1)).max(0), np.rad2deg(turned).max(0)


def _doubt(rig: SourceRig, off_deg: np.ndarray, turned_deg: np.ndarray, worst_m: float, missed_m: float) -> str | None:
    words = []
    for joint, bone in enumerate(rig.joint_map.bones):
        if bone and turned_deg[joint] > _MOST_DEG:
            words.append(f"{bone} is {turned_deg[joint]:.0f} degrees from {JOINT_NAMES[joint]}")
        elif bone and off_deg[joint] > _MOST_DEG:
            words.append(f"{bone} lacks {off_deg[joint]:.0f} degrees of twist, which its control does not give it")
    if missed_m > _MOST_M:
        words.append(f"the arm is {100 * missed_m:.0f} cm too short or too long for the wrist's place")
    elif worst_m > _MOST_M:
        words.append(f"the wrist is {100 * worst_m:.1f} cm from the hand's: its bone is held by others")
    return "; ".join(words) or None
