"""Somebody's armature at rest, and which of its bones are a hand's joints: records, numpy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..hand.model import JOINT_NAMES
from ..records.errors import LiveHandError
from ..records.shot import Side


@dataclass(frozen=True)
class RestSkeleton:
    """B bones in their rest pose, where the armature stands in the world; Blender's axes, m.

    Attributes:
        names: of the bones; unique.
        parents: index of each bone's parent, -1 for a root. Parents come before their children.
        heads: [B, 3] m.
        tails: [B, 3] m; importers invent them where a format has none, so they hint and never prove.
        frames: [B, 3, 3] rotations, columns a bone's X, Y (along it) and Z.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: np.ndarray
    tails: np.ndarray
    frames: np.ndarray

    def index(self, name: str) -> int:
        """Which bone has this name.

        Raises:
            LiveHandError: none has.
        """
        if name not in self.names:
            raise LiveHandError(f"the armature must have a bone '{name}', it has none; choose one of its bones")
        return self.names.index(name)

    def children(self, bone: int) -> list[int]:
        """The bones right below one."""
        return [child for child, parent in enumerate(self.parents) if parent == bone]

    def ancestors(self, bone: int) -> list[int]:
        """The bones above one, the nearest first."""
        above = []
        while (bone := self.parents[bone]) >= 0:
            above.append(bone)
        return above


@dataclass(frozen=True)
class JointMap:
    """Which bone is which of a hand's joints.

    Attributes:
        side: of the hand.
        bones: 16 names in MANO's order of joints; a joint's bone begins (has its head) at the joint.
        tips: five names of bones that begin at the fingertips, in MANO's order of fingers (index, middle, pinky, ring,
            thumb); None where the rig has none.
    """

    side: Side
    bones: tuple[str, ...]
    tips: tuple[str | None, ...] = field(default=(None,) * 5)

    def __post_init__(self):
        if len(self.bones) != len(JOINT_NAMES) or len(self.tips) != 5:
            raise LiveHandError(
                f"a joint map must name 16 bones and 5 tips, got {len(self.bones)} and {len(self.tips)}"
            )
        missing = [joint for joint, bone in zip(JOINT_NAMES, self.bones, strict=True) if not bone]
        if missing:
            raise LiveHandError(f"every joint must have a bone; none is chosen for {', '.join(missing)}")
        used = [bone for bone in (*self.bones, *self.tips) if bone]
        twice = sorted({bone for bone in used if used.count(bone) > 1})
        if twice:
            raise LiveHandError(f"a bone must be one joint only; chosen more than once: {', '.join(twice)}")
