"""A take as the motion of one skeleton, its bones named as HumanIK names them; BVH and Blender's exporters write it.

At rest the hands are in a T-pose of a Y-up world: fingers sideways, backs of the hands up, thumbs to the front (+Z),
which is MANO's template. There every bone's axes are the world's, so a finger's rotation is theta's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...hand.bones import rest_bones, rest_forearm
from ...hand.model import JOINT_NAMES, PARENTS
from ...records.side import Side
from .posed_joints import JOINT_NODES, RestSkeleton
from .take import Take, TakenHand


@dataclass(frozen=True)
class SkeletonMotion:
    """B bones in T frames, Y up, m.

    Attributes:
        names: of the bones.
        parents: index of each bone's parent, -1 for a root; parents come first.
        heads: [B, 3] at rest.
        tails: [B, 3] at rest.
        frames: [B, 3, 3] at rest; columns X the flexion axis, Y along the bone, Z towards the palm.
        rotations: [T, B, 3, 3] against the parent's, in axes that are the world's at rest.
        positions: [T, B, 3] of roots' heads; of the other bones, zeros.
        fps: frames per second.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: np.ndarray
    tails: np.ndarray
    frames: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    fps: float


def bone_names(side: Side) -> tuple[str, ...]:
    """Name the bones of a side: 16 in MANO's order of joints, and the forearm."""
    word = side.capitalize()
    fingers = (f"{word}Hand{joint[:-1].capitalize()}{joint[-1]}" for joint in JOINT_NAMES[1:])
    return (f"{word}Hand", *fingers, f"{word}ForeArm")


def skeleton_motion(take: Take) -> SkeletonMotion:
    """Compute the skeleton of a take and its motion; shapes that change are set to their mean."""
    parts = [_of_hand(hand.held(take.count), take.fps) for hand in take.hands]
    starts = np.cumsum([0, *(len(part.names) for part in parts)])
    parents = [
        parent if parent < 0 else parent + int(start)
        for part, start in zip(parts, starts, strict=False)
        for parent in part.parents
    ]
    return SkeletonMotion(
        names=tuple(name for part in parts for name in part.names),
        parents=tuple(parents),
        heads=np.concatenate([part.heads for part in parts]),
        tails=np.concatenate([part.tails for part in parts]),
        frames=np.concatenate([part.frames for part in parts]),
        rotations=np.concatenate([part.rotations for part in parts], 1),
        positions=np.concatenate([part.positions for part in parts], 1),
        fps=take.fps,
    )


def _of_hand(hand: TakenHand, fps: float) -> SkeletonMotion:
    model, motion = hand.own_model, hand.motion_in("y_up")
    beta = motion.betas.mean(0)
    rest = RestSkeleton.of(model, beta)
    nodes = hand.scale * rest.nodes
    heads, own = nodes[list(JOINT_NODES)], rest_bones(model)
    ends = [nodes[5], *(nodes[JOINT_NODES[joint] + 1] for joint in range(1, 16))]  # of the palm: the middle knuckle
    wrist = RestSkeleton.of(model, motion.betas).nodes[:, 0] + motion.transl
    local = axis_angle_to_matrix(motion.theta)
    *hand_names, arm_name = bone_names(hand.side)
    positions = np.zeros((len(motion), 16, 3))
    if rest.elbow is None:
        positions[:, 0] = wrist
        return SkeletonMotion(tuple(hand_names), PARENTS, heads, np.array(ends), own.frames, local, positions, fps)
    bend = axis_angle_to_matrix(motion.forearms)
    arm = local[:, :1] @ bend[:, None]
    elbow = hand.scale * rest.elbow
    begin = wrist - (arm[:, 0] @ (heads[0] - elbow))
    return SkeletonMotion(
        names=(arm_name, *hand_names),
        parents=(-1, *(parent + 1 for parent in PARENTS)),
        heads=np.concatenate([elbow[None], heads]),
        tails=np.concatenate([heads[:1], ends]),
        frames=np.concatenate([rest_forearm(model).frame[None], own.frames]),
        rotations=np.concatenate([arm, bend.swapaxes(1, 2)[:, None], local[:, 1:]], 1),
        positions=np.concatenate([begin[:, None], positions], 1),
        fps=fps,
    )
