"""Another rig's motion as keyframes of our hand: a rig of the scene, or an animated rig in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import bpy

from ...backend.records.errors import LiveHandError
from ...backend.rigs.doubts import motion_doubts
from ...backend.rigs.retarget import retarget
from ..motion.keying import Placement, key_motion, motion_for_hand
from ..rig.hand import RiggedHand
from .importing import RigFile, read_rig_file
from .source import SourceRig, align_hand, current_shape, sample_source, set_shape


class KeyedFrames(NamedTuple):
    """What was keyed.

    Attributes:
        frames: how many.
        armature: name of the source.
        doubt: what speaks against the result; None: nothing.
    """

    frames: int
    armature: str
    doubt: str | None


def bake(
    context: bpy.types.Context, hand: RiggedHand, source: SourceRig, frames: Sequence[int], fits_shape: bool = True
) -> KeyedFrames:
    """Key a hand with the source's motion.

    A source of the other side is mirrored in the world's plane x = 0.

    Args:
        context: of the scene that contains both.
        hand: to be keyed.
        source: to be followed.
        frames: consecutive.
        fits_shape: give the hand the source's proportions and size.

    Raises:
        LiveHandError: there is no frame, a bone is missing, or a pose is not finite. Nothing is changed then.
    """
    if not len(frames):
        raise LiveHandError("the last frame must not lie before the first")
    alignment = align_hand(hand, source, fits_shape)
    motion = retarget(sample_source(context, source, frames), alignment)
    doubt = motion_doubts(alignment, motion)
    if fits_shape:
        set_shape(context, hand, alignment.shape)
    placement = Placement("z_up", frames[0], matches_fps=False, mirrors=True, sets_shape=fits_shape)
    return KeyedFrames(key_motion(context.scene, hand, motion, placement), source.armature.name, doubt)


def bake_file(context: bpy.types.Context, hand: RiggedHand, file: RigFile, placement: Placement) -> KeyedFrames:
    """Key a hand with the motion of a rig in a file.

    Raises:
        LiveHandError: the file cannot be read, contains no hand, or contains the other hand, which may not be
            mirrored. Nothing is changed then.
    """
    shape = None if placement.sets_shape else current_shape(hand)
    found = read_rig_file(context, file, hand.model, shape)
    motion = replace(found.motion, fps=file.fps) if file.fps else found.motion
    motion_for_hand(motion, hand, placement.mirrors)  # before the shape is changed
    if placement.sets_shape:
        set_shape(context, hand, found.shape)
    return KeyedFrames(key_motion(context.scene, hand, motion, placement), found.armature, found.doubt)
