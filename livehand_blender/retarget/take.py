"""An animated rig in a file as keyframes of our hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from ...backend.hand.model import HandModel
from ...backend.records.shot import Side
from ..motion.keying import Placement, key_motion, of_side
from .importing import read_rig_take
from .size import present_shape, take_shape


@dataclass(frozen=True)
class TakeRequest:
    """Which motion.

    Attributes:
        path: of the file.
        side: of the hand in it; None: that of our hand, or the only one.
        unit: of its numbers; None: the one that makes its hand as large as a hand.
        fps: of its frames; None: as the file says.
    """

    path: Path
    side: Side | None = None
    unit: str | None = None
    fps: float | None = None


def key_take(
    context: bpy.types.Context, hand: bpy.types.Object, model: HandModel, request: TakeRequest, placement: Placement
) -> tuple[int, str]:
    """Key a hand with a file's motion; returns how many frames were keyed, and the file's armature's name.

    Raises:
        LiveHandError: the file cannot be read or holds no hand, or holds the other one and may not be mirrored. Nothing
            is changed then.
    """
    shape = None if placement.sets_shape else present_shape(hand)
    own = model.for_side(hand.livehand.side)
    take = read_rig_take(context, request.path, own, request.side, shape, request.unit)
    motion = replace(take.motion, fps=request.fps) if request.fps else take.motion
    of_side(motion, hand, placement.mirrors)
    if placement.sets_shape:
        take_shape(context, hand, take.shape)
    return key_motion(context.scene, hand, model, motion, placement), take.armature
