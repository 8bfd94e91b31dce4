"""Converts the weights of a rig's bones to weights of a hand's 16 joints.

A bone that is not a joint (a metacarpal, a tip, a twist bone) moves with the nearest joint above it. Bones above the
wrist or beside it belong to no joint.
"""

from __future__ import annotations

import numpy as np

from ..source_skeleton import JointMap, SourceSkeleton

NO_JOINT = -1
# Control rigs have several bones at the wrist: heads closer than this share of the hand's length count as one.
_SAME_PLACE = 0.01


def joints_of_bones(skeleton: SourceSkeleton, joint_map: JointMap) -> np.ndarray:
    """Find the joint [B] that each bone moves with; `NO_JOINT` for bones that are not part of the hand.

    Raises:
        LiveHandError: the map names a bone that the skeleton lacks.
    """
    joint_of = np.full(len(skeleton.names), NO_JOINT)
    joints = [joint for joint, name in enumerate(joint_map.bones) if name]
    bones = [skeleton.index(joint_map.drivers[joint]) for joint in joints]
    joint_of[_wrists(skeleton, bones)] = 0
    joint_of[bones] = joints
    for bone, parent in enumerate(skeleton.parents):  # parents come first
        if joint_of[bone] == NO_JOINT and parent >= 0:
            joint_of[bone] = joint_of[parent]
    return joint_of


def joint_weights(weights: np.ndarray, joint_of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Collect weights of the joints [N, 16], rows of sum 1, from the bones' [N, B], and the hand's share [N].

    Weights of other bones, such as the forearm, are given to the wrist, so that the stump moves with it.
    """
    total = weights.sum(1, keepdims=True)
    own = weights / np.where(total > 0, total, 1)
    of_joints = np.zeros((len(weights), 16))
    for joint in range(16):
        of_joints[:, joint] = own[:, joint_of == joint].sum(1)
    share = of_joints.sum(1)
    of_joints[:, 0] += 1 - share
    return of_joints, share


def _wrists(skeleton: SourceSkeleton, bones: list[int]) -> list[int]:
    """List the ancestors of the fingers that begin where the wrist does."""
    size_m = np.linalg.norm(skeleton.heads[bones] - skeleton.heads[bones[0]], axis=1).max()
    above = {ancestor for bone in bones[1:] for ancestor in skeleton.ancestors(bone)}
    near = np.linalg.norm(skeleton.heads - skeleton.heads[bones[0]], axis=1) < _SAME_PLACE * size_m
    return [bone for bone in sorted(above) if near[bone]]
