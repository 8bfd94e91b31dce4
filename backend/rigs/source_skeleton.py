"""The records of another rig's armature at rest, and of the map from its bones to a hand's joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..hand.model import JOINT_NAMES, PARENTS
from ..records.errors import LiveHandError
from ..records.side import Side

_KNUCKLES = (1, 4, 7, 10)


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
        """Find the index of the bone with this name.

        Raises:
            LiveHandError: there is none.
        """
        if name not in self.names:
            raise LiveHandError(f"the armature must have a bone '{name}', it has none; choose one of its bones")
        return self.names.index(name)

    def children(self, bone: int) -> list[int]:
        """List the children of a bone."""
        return [child for child, parent in enumerate(self.parents) if parent == bone]

    def ancestors(self, bone: int) -> list[int]:
        """List the bones above one, from its parent to the root."""
        above = []
        while (bone := self.parents[bone]) >= 0:
            above.append(bone)
        return above


@dataclass(frozen=True)
class JointMap:
    """The bones of a hand's joints.

    Attributes:
        side: of the hand.
        bones: 16 names in MANO's order of joints; each bone has its head at the joint. None for a joint that the rig
            lacks, but for the wrist and the knuckles of at least two fingers: it stays at rest.
        tips: five names of bones that begin at the fingertips, in MANO's order of fingers (index, middle, pinky, ring,
            thumb); None if the rig has none.
        forearm: the bone that a forearm turns with; None if the rig has none.
    """

    side: Side
    bones: tuple[str | None, ...]
    tips: tuple[str | None, ...] = field(default=(None,) * 5)
    forearm: str | None = None

    def __post_init__(self):
        if len(self.bones) != len(JOINT_NAMES) or len(self.tips) != 5:
            raise LiveHandError(
                f"a joint map must name 16 bones and 5 tips, got {len(self.bones)} and {len(self.tips)}"
            )
        if not shows_palm(self.bones):
            raise LiveHandError(
                "the wrist and the first joints of two fingers beside the thumb must have a bone; none is chosen for "
                f"{', '.join(self.missing)}"
            )
        used = self.named
        twice = sorted({bone for bone in used if used.count(bone) > 1})
        if twice:
            raise LiveHandError(f"a bone must be one joint only; chosen more than once: {', '.join(twice)}")

    @property
    def named(self) -> tuple[str, ...]:
        """All bones that the map names."""
        return tuple(bone for bone in (*self.bones, *self.tips, self.forearm) if bone)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the joints without a bone."""
        return joints_without_bones(self.bones)

    @property
    def drivers(self) -> tuple[str, ...]:
        """The 16 bones that the joints move with: their own, or those of the joints above."""
        names = [self.bones[0] or ""]
        for joint in range(1, 16):
            names.append(self.bones[joint] or names[PARENTS[joint]])
        return tuple(names)


def joints_without_bones(bones: Sequence[str | None]) -> tuple[str, ...]:
    """List the names of the joints whose bone [16] is None or empty."""
    return tuple(joint for joint, bone in zip(JOINT_NAMES, bones, strict=True) if not bone)


def shows_palm(bones: Sequence[str | None]) -> bool:
    """Tell whether enough of the bones [16] are known to place the palm: the wrist and two knuckles."""
    return bool(bones[0]) and sum(bool(bones[knuckle]) for knuckle in _KNUCKLES) >= 2


def unit(vectors: np.ndarray) -> np.ndarray:
    """Scale vectors [..., 3] to length 1; vectors shorter than 1e-12 stay near zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
