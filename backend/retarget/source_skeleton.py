"""The records of another rig's armature at rest, and of the map from its bones to a hand's joints."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..hand.model import JOINT_NAMES
from ..records.errors import LiveHandError
from ..records.side import Side


@dataclass(frozen=True)
class SourceSkeleton:
    """B bones of an armature in their rest pose, in the world, with Blender's axes, m.

    Attributes:
        names: of the bones, unique.
        parents: index of each bone's parent, -1 for a root; parents come before their children.
        heads: [B, 3] m.
        tails: [B, 3] m. They are unreliable: importers invent them if a format has none.
        frames: [B, 3, 3] rotations, columns a bone's X, Y (along it) and Z.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: np.ndarray
    tails: np.ndarray
    frames: np.ndarray

    def index(self, name: str) -> int:
        """The index of the bone with this name.

        Raises:
            LiveHandError: there is none.
        """
        if name not in self.names:
            raise LiveHandError(f"the armature must have a bone '{name}', it has none; choose one of its bones")
        return self.names.index(name)

    def children(self, bone: int) -> list[int]:
        """The children of a bone."""
        return [child for child, parent in enumerate(self.parents) if parent == bone]

    def ancestors(self, bone: int) -> list[int]:
        """The bones above one, from its parent to the root."""
        above = []
        while (bone := self.parents[bone]) >= 0:
            above.append(bone)
        return above


@dataclass(frozen=True)
class JointMap:
    """The bones of a hand's joints.

    Attributes:
        side: of the hand.
        bones: 16 names in MANO's order of joints; each bone has its head at the joint.
        tips: five names of bones that begin at the fingertips, in MANO's order of fingers (index, middle, pinky, ring,
            thumb); None if the rig has none.
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


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] at length 1; vectors shorter than 1e-12 stay near zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
