"""Hands of a scene over a range of frames -> a take in Blender's world, wherever their armatures are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import bpy
import numpy as np

from ...backend.motion.motion import motion_from_poses
from ...backend.motion.spaces import rest_wrists, transformed
from ...backend.motion.writers.take import Take, TakenHand, take_of
from ...backend.records.errors import LiveHandError
from ..rig.hand import RiggedHand
from ..rig.pose import read_pose
from .frames import current_frame_restored, frame_rate


def sample_take(context: bpy.types.Context, hands: Sequence[RiggedHand], frames: Iterable[int]) -> Take:
    """Sample hands in frames of the scene, constraints, drivers and parents included.

    A hand's size is that of its armature's object in the first frame.

    Raises:
        LiveHandError: there is no hand or no frame, two hands are of one side, a channel is not finite, or an armature
            is scaled by negative numbers or zero.
    """
    scene = context.scene
    poses: list[list] = [[] for _ in hands]
    worlds: list[list] = [[] for _ in hands]
    with current_frame_restored(scene):
        for frame in frames:
            scene.frame_set(frame)
            depsgraph = context.evaluated_depsgraph_get()
            for hand, of_hand, world in zip(hands, poses, worlds, strict=True):
                of_hand.append(read_pose(hand, depsgraph))
                world.append(np.array(hand.armature.evaluated_get(depsgraph).matrix_world, np.float64))
    rate = frame_rate(scene)
    taken = [_taken(*one, rate) for one in zip(hands, poses, worlds, strict=True)]
    return take_of(taken, rate)


def _taken(hand: RiggedHand, poses: list, worlds: list, rate: float) -> TakenHand:
    motion, matrices = motion_from_poses(poses, rate), np.array(worlds)
    if (np.linalg.det(matrices[:, :3, :3]) <= 0).any():
        raise LiveHandError(
            f"{hand.armature.name} must not be scaled by negative numbers or zero; apply its scale first"
        )
    scale = float(np.linalg.norm(matrices[0, :3, :3], axis=0).mean())
    world = transformed(motion, matrices, rest_wrists(hand.model, motion.betas))
    return TakenHand(world, hand.model, scale, own=motion)
