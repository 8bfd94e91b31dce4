"""Another rig's motion as our hand's, also where its coordinates are a mirror image: left-handed axes, written raw.

A mirrored right hand is a left one in all but its bones' names, so that a right hand aligned with it bends its fingers
backwards, and the palm at rest fits worse. Read as the other side's and mirrored back, it does what was meant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..hand.model import HandModel
from ..motion.gate import JointBend
from ..motion.motion import HandMotion, mirrored
from ..records.side import Side
from .doubts import motion_doubts
from .rest_alignment import RestAlignment, align
from .retarget import SourceMotion, retarget
from .shape_fit import HandShape
from .source_skeleton import JointMap, SourceSkeleton

_LESS = 0.5  # of the excess beyond a hand's limits, at which the mirrored reading is better
MIRRORED_NOTE = "its hand is a mirror image, as in left-handed axes, and was mirrored back"


class RigReading(NamedTuple):
    """What was read of a rig.

    Attributes:
        motion: of the side that the rig's bones are named after.
        shape: of the hand.
        doubt: what speaks against it; None: nothing.
    """

    motion: HandMotion
    shape: HandShape
    doubt: str | None


def read_motion(
    skeleton: SourceSkeleton,
    joint_map: JointMap,
    source: SourceMotion,
    model: HandModel,
    shape: HandShape | None = None,
) -> RigReading:
    """Retarget a rig's motion, mirrored back where the rig is a mirror image.

    Args:
        skeleton: of the rig at rest.
        joint_map: its bones of the hand.
        source: its motion.
        model: our hand, of either side.
        shape: ours; None: fitted to the rig's bones.

    Raises:
        LiveHandError: a bone is missing, or joints coincide.
    """
    alignment = align(skeleton, joint_map, model, shape)
    motion = retarget(source, alignment)
    bend = JointBend.of(alignment.model, motion.theta)
    if bend.backwards_rad:
        other: Side = "left" if joint_map.side == "right" else "right"
        turned = align(skeleton, replace(joint_map, side=other), model, shape)
        found = retarget(replace(source, side=other), turned)
        of_other = JointBend.of(turned.model, found.theta)
        is_natural = not of_other.backwards_rad and of_other.excess.mean() < _LESS * bend.excess.mean()
        if is_natural and _rest_error(turned) < _rest_error(alignment):
            doubt = motion_doubts(turned, found)
            return RigReading(mirrored(found), turned.shape, f"{MIRRORED_NOTE}; {doubt}" if doubt else MIRRORED_NOTE)
    return RigReading(motion, alignment.shape, motion_doubts(alignment, motion))


def _rest_error(alignment: RestAlignment) -> float:
    """Measure how far the rig's joints at rest are from the hand's on average, against the hand's size."""
    return float(np.nanmean(np.linalg.norm(alignment.joints - alignment.heads, axis=1)) / alignment.shape.scale)
