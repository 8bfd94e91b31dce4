"""Skeletons for tests: our hand's joints under others' names, alone or on a body, rolled and moved at will."""

from __future__ import annotations

import numpy as np
from livehand.backend.hand.model import PARENTS
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.rigs.source_skeleton import SourceSkeleton

FINGERS = ("index", "middle", "pinky", "ring", "thumb")


def points(side="right"):
    """Joints [16, 3] and fingertips [5, 3] of our hand at rest."""
    model = load_default_hand().for_side(side)
    tips = []
    for last in range(3, 16, 3):
        along = model.joints[last] - model.joints[last - 1]
        own = model.lbs_weights[:, last] > 0.5
        tips.append(model.v_template[np.where(own, model.v_template @ along, -np.inf).argmax()])
    return model.joints, np.array(tips)


def hand_bones(names, tips=(None,) * 5, side="right", above=None, metacarpals=(None,) * 4):
    """[(name, parent's name, head)] of one hand; names that are None are left out."""
    joints, ends = points(side)
    bones = [(names[0], above, joints[0])]
    for finger in range(5):
        first = 3 * finger + 1
        if finger < 4 and metacarpals[finger]:
            bones.append((metacarpals[finger], names[0], 0.8 * joints[0] + 0.2 * joints[first]))
    for joint in range(1, 16):
        parent = names[PARENTS[joint]]
        if joint % 3 == 1 and joint < 13 and metacarpals[joint // 3]:
            parent = metacarpals[joint // 3]
        bones.append((names[joint], parent, joints[joint]))
    bones += [(tip, names[3 * k + 3], ends[k]) for k, tip in enumerate(tips)]
    return [bone for bone in bones if bone[0]]


def skeleton(bones, turn=None, scale=1.0, shift=(0, 0, 0), rng=None):
    """A rest skeleton of (name, parent's name, head), parents first; frames are random with a generator."""
    names = [name for name, _, _ in bones]
    parents = [names.index(parent) if parent in names else -1 for _, parent, _ in bones]
    heads = np.array([head for _, _, head in bones], float)
    turn = np.eye(3) if turn is None else turn
    heads = scale * heads @ turn.T + shift
    frames = np.tile(np.eye(3), (len(names), 1, 1))
    if rng is not None:
        frames = np.linalg.qr(rng.normal(size=(len(names), 3, 3)))[0]
        frames *= np.sign(np.linalg.det(frames))[:, None, None]
    return SourceSkeleton(tuple(names), tuple(parents), heads, heads + 0.01 * frames[:, :, 1], frames)
