"""Another rig's motion as keyframes of our hand."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError
from ...backend.retarget.retarget import retarget
from ...backend.retarget.source_skeleton import JointMap
from ..motion.keying import Placement, key_motion
from ..rig.pose import hand_side
from .size import take_shape
from .source import align_hand, sample_source


def bake(
    context: bpy.types.Context,
    hand: bpy.types.Object,
    model: HandModel,
    source: bpy.types.Object,
    joint_map: JointMap,
    frames: Sequence[int],
    fits_shape: bool = True,
) -> int:
    """Key a hand in every one of the frames with what the source does then; returns how many.

    A source of the other side is mirrored in the world's plane x = 0. Nothing is changed where an error is raised.

    Args:
        context: of the scene that both are in.
        hand: our armature.
        model: its hand model.
        source: the other armature.
        joint_map: its joints.
        frames: consecutive.
        fits_shape: the hand takes the source's proportions and size.

    Raises:
        LiveHandError: no frame, a bone is missing, or a pose is not finite.
    """
    if not len(frames):
        raise LiveHandError("the last frame must not lie before the first")
    hand_side(hand)
    alignment = align_hand(hand, model, source, joint_map, fits_shape)
    motion = retarget(sample_source(context, source, joint_map, frames), alignment)
    if fits_shape:
        take_shape(context, hand, alignment.shape)
    placement = Placement("z_up", frames[0], matches_fps=False, mirrors=True, sets_shape=fits_shape)
    return key_motion(context.scene, hand, model, motion, placement)
