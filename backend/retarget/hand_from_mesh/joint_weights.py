"""Weights of a rig's bones -> weights of a hand's 16 joints.

A bone that is no joint (a metacarpal, a tip, a twist bone) moves with the nearest joint above it. What lies above the
wrist, or beside it, belongs to no joint.
"""

from __future__ import annotations

import numpy as np

from ..source_skeleton import JointMap, RestSkeleton

NO_JOINT = -1
# Control rigs keep several bones in one place: this share of the hand's length is one place.
_ONE_PLACE = 0.01


def joints_of_bones(skeleton: RestSkeleton, joint_map: JointMap) -> np.ndarray:
    """[B] the joint that each bone moves with, `NO_JOINT` for those that are not the hand's.

    Raises:
        LiveHandError: the map names a bone that the skeleton lacks.
    """
    joint_of = np.full(len(skeleton.names), NO_JOINT)
    bones = [skeleton.index(name) for name in joint_map.bones]
    joint_of[_wrists(skeleton, bones)] = 0
    joint_of[bones] = np.arange(len(bones))
    for bone, parent in enumerate(skeleton.parents):  # parents come first
        if joint_of[bone] == NO_JOINT and parent >= 0:
            joint_of[bone] = joint_of[parent]
    return joint_of


def joint_weights(weights: np.ndarray, joint_of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights [N, B] -> those of the joints [N, 16], rows sum to 1, and the hand's share [N] of each vertex.

    What is not the hand's (a forearm's part of the wrist) is given to the wrist: a stump moves with it.
    """
    total = weights.sum(1, keepdims=True)
    own = weights / np.where(total > 0, total, 1)
    folded = np.zeros((len(weights), 16))
    for joint in range(16):
        folded[:, joint] = own[:, joint_of == joint].sum(1)
    share = folded.sum(1)
    folded[:, 0] += 1 - share
    return folded, share


def _wrists(skeleton: RestSkeleton, bones: list[int]) -> list[int]:
    """The fingers' ancestors that begin where the wrist does: the wrist by other names."""
    size_m = np.linalg.norm(skeleton.heads[bones] - skeleton.heads[bones[0]], axis=1).max()
    above = {ancestor for bone in bones[1:] for ancestor in skeleton.ancestors(bone)}
    near = np.linalg.norm(skeleton.heads - skeleton.heads[bones[0]], axis=1) < _ONE_PLACE * size_m
    return [bone for bone in sorted(above) if near[bone]]
