"""The skin of a rig that a hand follows or was baked from: it lies where the hand lies, which stands for it.

Skin is told by its place alone, not by weights: it encloses the joints of the fingers, and what a hand holds does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ...backend.hand.model import JOINT_NAMES, PARENTS
from ..rig.hand import RiggedHand, find_hands

SOURCE_ROLE = "SRC"
"""Before the names of a hand's bones that copy another rig's."""
_ELBOW = "forearm"
_SAME_PLACE_M, _THICK_M, _THICK_ARM_M = 0.05, 0.04, 0.08  # of both wrists; around a finger's and a forearm's bones
_ENCLOSED = 0.5  # share of the fingers' joints


@dataclass(frozen=True, eq=False)
class FollowedHand:
    """The bones, in the world, of another rig's hand that a hand lies on.

    Attributes:
        joints: [N, 3] m the fingers' joints.
        starts: [S, 3] m where bones begin, the palm's and the forearm's among them.
        ends: [S, 3] m where they end.
        thick_m: [S] how far from a bone its skin may lie.
    """

    joints: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    thick_m: np.ndarray

    def skin_of(self, triangles: np.ndarray) -> np.ndarray:
        """Tell which triangles [T, 3, 3], in the world, are this hand's skin: [T]; none if they enclose no fingers."""
        centres = triangles.mean(1)
        is_near = np.zeros(len(triangles), bool)
        for start, end, thick in zip(self.starts, self.ends, self.thick_m, strict=True):
            along = (end - start) / max(float((end - start) @ (end - start)), 1e-12)
            share = np.clip((centres - start) @ along, 0, 1)[:, None]
            is_near |= np.linalg.norm(centres - start - share * (end - start), axis=1) < thick
        if not is_near.any() or self._enclosed(triangles[is_near]) < _ENCLOSED:
            return np.zeros(len(triangles), bool)
        return is_near

    def _enclosed(self, triangles: np.ndarray) -> float:
        """Measure the share of the joints that lie behind the nearest of the triangles."""
        corners = triangles.reshape(-1, 3).tolist()
        tree = BVHTree.FromPolygons(corners, np.arange(len(corners)).reshape(-1, 3).tolist(), all_triangles=True)
        behind = 0
        for joint in self.joints:
            place, normal, *_ = tree.find_nearest(Vector(joint))
            behind += place is not None and (Vector(joint) - place).dot(normal) < 0
        return behind / len(self.joints)


def followed_hands(depsgraph: bpy.types.Depsgraph) -> list[FollowedHand]:
    """Find the hands of other rigs that the scene's hands follow, or were baked from, and lie on."""
    found = []
    for armature in find_hands(depsgraph.scene):
        for other, bones in _mapped(armature).items():
            heads = _heads(other.evaluated_get(depsgraph), bones)
            own = armature.evaluated_get(depsgraph)
            scale = float(np.mean(own.matrix_world.to_scale()))
            wrist = np.array(own.matrix_world @ own.pose.bones[RiggedHand.of(armature).bone(0).name].head)
            if np.linalg.norm(heads["wrist"] - wrist) < _SAME_PLACE_M * scale and len(heads) > len(JOINT_NAMES) / 2:
                found.append(_hand(heads, scale))
    return found


def _hand(heads: dict[str, np.ndarray], scale: float) -> FollowedHand:
    pairs = [(heads[JOINT_NAMES[above]], heads[name]) for name, above in _with_parents(heads)]
    lasts = [(heads[name], _tip(heads, name)) for name in heads if name.endswith("3") and name[:-1] + "2" in heads]
    arm = [(heads[_ELBOW], heads["wrist"])] if _ELBOW in heads else []
    bones = np.array([*pairs, *lasts, *arm])
    thick = np.full(len(bones), _THICK_M * scale)
    thick[len(pairs) + len(lasts) :] = _THICK_ARM_M * scale
    joints = np.array([heads[name] for name in JOINT_NAMES[1:] if name in heads])
    return FollowedHand(joints, bones[:, 0], bones[:, 1], thick)


def _with_parents(heads: dict[str, np.ndarray]) -> list[tuple[str, int]]:
    named = list(zip(JOINT_NAMES, PARENTS, strict=True))[1:]
    return [(name, above) for name, above in named if name in heads and JOINT_NAMES[above] in heads]


def _tip(heads: dict[str, np.ndarray], last: str) -> np.ndarray:
    """Estimate where a finger ends, which goes on as the bone before its last."""
    return 2 * heads[last] - heads[last[:-1] + "2"]


def _heads(other: bpy.types.Object, bones: dict[str, str]) -> dict[str, np.ndarray]:
    """Read where an evaluated armature's bones, by joint, begin in the world [3]."""
    return {joint: np.array(other.matrix_world @ other.pose.bones[bone].head) for joint, bone in bones.items()}


def _mapped(armature: bpy.types.Object) -> dict[bpy.types.Object, dict[str, str]]:
    """Find the bones, by joint, that a hand copies by constraints, and those that it was baked from."""
    found: dict[bpy.types.Object, dict[str, str]] = {}
    for bone in armature.pose.bones:
        role, _, name = bone.name.partition("-")
        for constraint in bone.constraints if role == SOURCE_ROLE else ():
            target = getattr(constraint, "target", None)
            if target is not None and target != armature and constraint.subtarget in target.pose.bones:
                found.setdefault(target, {}).setdefault(name.rpartition(".")[0], constraint.subtarget)
    chosen = armature.livehand.other_rig
    if chosen.armature is not None and chosen.armature.type == "ARMATURE" and chosen.armature not in found:
        joints = {joint: getattr(chosen, joint) for joint in (*JOINT_NAMES, _ELBOW)}
        found[chosen.armature] = {joint: bone for joint, bone in joints.items() if bone in chosen.armature.pose.bones}
    return {other: joints for other, joints in found.items() if "wrist" in joints}
