"""Two hands at rest laid on each other, joint by joint: a rotation each, so that bones point the same way.

Rest poses are aligned, angles never copied. The palms give the wrist's rotation; from there each finger's frame is
carried along its bones by the shortest turns onto the other's, and turned about the bone by how the finger is bent at
rest, if it is. A bone's own roll, its tail and the unit of the rig have no say. Where all joints of both hands lie in
the same places, as of a hand model and the rig it was made of, both rest in the same pose: all turn as the palm does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, turn_between
from ..hand.model import MIRROR_POINT, HandModel
from ..motion.landmarks.skeleton import HandSkeleton
from ..records.errors import LiveHandError
from .shape_fit import HandShape, fit_shape, rest_nodes
from .source_skeleton import JointMap, RestSkeleton

_PALM = [0, 1, 5, 9, 13]  # the wrist and four knuckles among the 21 nodes
_JOINTS = [0, *(4 * finger + k for finger in range(5) for k in (1, 2, 3))]  # all but the tips
_SAME_PLACE = 0.002  # as a share of the distance from the wrist to the middle knuckle: 0.2 mm of a man's hand
# A finger that bends by less than the first tells nothing about the plane it bends in; by more than the second, all.
_STRAIGHT, _BENT = np.deg2rad([6.0, 20.0])
_MIN_AGREEMENT = 0.6
# A bone's tail is believed where no tip is known, if the finger goes on as straight as this, cosine.
_MIN_STRAIGHTNESS = 0.6
_SMALLEST_M = 1e-6


@dataclass(frozen=True)
class Alignment:
    """Our hand, laid on another at rest.

    Attributes:
        model: ours, of the other's side.
        shape: ours.
        turns: [16, 3, 3] from the template's frame into the world, per joint: what our joints have turned by when the
            other hand is at rest.
        wrist: [3] m, where our wrist's joint is in the world then.
        frames: [16, 3, 3] the other's bones at rest, in the world.
        heads: [16, 3] m, their joints.
    """

    model: HandModel
    shape: HandShape
    turns: np.ndarray
    wrist: np.ndarray
    frames: np.ndarray
    heads: np.ndarray


def align(skeleton: RestSkeleton, joint_map: JointMap, model: HandModel, shape: HandShape | None = None) -> Alignment:
    """Lay our hand on another.

    Args:
        skeleton: the other, at rest.
        joint_map: its joints.
        model: ours; the side of the map is taken of it.
        shape: ours; None: fitted to the other's bones.

    Raises:
        LiveHandError: a bone is missing, or joints lie in one place.
    """
    model = model.for_side(joint_map.side)
    bones = [skeleton.index(bone) for bone in joint_map.bones]
    theirs = source_nodes(skeleton, joint_map)
    shape = shape or _same_shape(model, theirs) or fit_shape(model, theirs)
    ours = shape.scale * rest_nodes(model, shape.beta)
    palm = _turn_between(ours[_PALM], theirs[_PALM])
    wrist = theirs[_PALM].mean(0) + palm @ (ours[0] - ours[_PALM].mean(0))
    whole = _turn_between(ours[_JOINTS], theirs[_JOINTS])
    if _rests_alike(ours[_JOINTS], theirs[_JOINTS], whole):
        turns, wrist = [whole] * 16, theirs[0]
    else:
        turns = [palm, *_turns_of_fingers(palm, ours, _directions(skeleton, bones, theirs), _flexion_axes(model))]
    return Alignment(model, shape, np.array(turns), wrist, skeleton.frames[bones], skeleton.heads[bones])


def source_nodes(skeleton: RestSkeleton, joint_map: JointMap) -> np.ndarray:
    """[21, 3] m the wrist, and three joints and the tip of each finger; NaN for a tip without a bone.

    Raises:
        LiveHandError: a bone is missing, or joints of one finger lie in one place.
    """
    heads = [skeleton.heads[skeleton.index(bone)] for bone in joint_map.bones]
    nodes = [heads[0]]
    for finger in range(5):
        tip = joint_map.tips[finger]
        end = np.full(3, np.nan) if tip is None else skeleton.heads[skeleton.index(tip)]
        nodes += [*heads[3 * finger + 1 : 3 * finger + 4], end]
        steps = np.linalg.norm(np.diff([heads[0], *nodes[-4:]], axis=0), axis=1)
        if (steps < _SMALLEST_M).any():
            raise LiveHandError(
                f"joints must lie apart, got '{joint_map.bones[3 * finger + 1]}' or the next in one place with "
                "another; choose other bones"
            )
    return np.array(nodes)


def _turn_between(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """[3, 3] that brings our points [N, 3], in any place, nearest to theirs."""
    return turn_between(ours - ours.mean(0), theirs - theirs.mean(0))


def _same_shape(model: HandModel, theirs: np.ndarray) -> HandShape | None:
    """Our mean shape, if their joints lie as its do; tips, which rigs put here and there, have no say in its size."""
    own, other = rest_nodes(model, np.zeros(10))[_JOINTS], theirs[_JOINTS]
    scale = float(np.linalg.norm(other - other.mean(0)) / np.linalg.norm(own - own.mean(0)))
    is_same = _rests_alike(scale * own, other, _turn_between(own, other))
    return HandShape(np.zeros(10), scale) if is_same else None


def _rests_alike(ours: np.ndarray, theirs: np.ndarray, turn: np.ndarray) -> bool:
    """Whether all 16 joints, turned and moved as one, lie on theirs."""
    own, other = ours - ours.mean(0), theirs - theirs.mean(0)
    apart = np.linalg.norm(own @ turn.T - other, axis=1).max()
    return bool(apart < _SAME_PLACE * np.linalg.norm(theirs[4] - theirs[0]))


def _turns_of_fingers(
    palm: np.ndarray, ours: np.ndarray, theirs: np.ndarray, axes: list[np.ndarray | None]
) -> list[np.ndarray]:
    """[3, 3] of joints 1 to 15: our nodes [21, 3], their bones' directions [5, 3, 3]."""
    by_finger = (_finger_turns(palm, _finger_directions(ours, k), theirs[k], axes[k]) for k in range(5))
    return [turn for turns in by_finger for turn in turns]


def _directions(skeleton: RestSkeleton, bones: list[int], nodes: np.ndarray) -> np.ndarray:
    """[5, 3, 3] unit, of every finger's three bones."""
    directions = np.array([_finger_directions(nodes, finger) for finger in range(5)])
    for finger in np.flatnonzero(np.isnan(directions[:, 2, 0])):
        last = bones[3 * finger + 3]
        onward = _unit(skeleton.tails[last] - skeleton.heads[last])
        straight = directions[finger, 1]
        directions[finger, 2] = onward if onward @ straight > _MIN_STRAIGHTNESS else straight
    return directions


def _finger_directions(nodes: np.ndarray, finger: int) -> np.ndarray:
    return _unit(np.diff(nodes[4 * finger + 1 : 4 * finger + 5], axis=0))


def _flexion_axes(model: HandModel) -> list[np.ndarray | None]:
    """[3] unit axis of flexion of every finger's knuckle in the template's frame, None for the thumb."""
    axes = HandSkeleton.of(model).axes[:4, 0, 0]
    # An axis of rotation is mirrored and turned round.
    return [*(axes if model.side == "right" else -axes * MIRROR_POINT), None]


def _finger_turns(palm: np.ndarray, ours: np.ndarray, theirs: np.ndarray, axis: np.ndarray | None) -> list[np.ndarray]:
    """Three [3, 3] that bring our bones [3, 3] at rest into the directions of theirs, the palm already turned.

    Without an axis of flexion [3] the finger's bending tells nothing: a thumb turns at its root as well.
    """
    turns, above = [], palm
    for joint in range(3):
        above = _shortest_turn(above @ ours[joint], theirs[joint]) @ above
        turns.append(above)
    if axis is None:
        return turns
    own, other = turns[0] @ _bending_axis(ours, axis), _bending_axis(theirs, turns[0] @ axis)
    roll = _angle_about(theirs[0], own, other)
    return [axis_angle_to_matrix(roll * theirs[joint]) @ turns[joint] for joint in range(3)]


def _bending_axis(directions: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """[3] the axis of a finger's middle joint, by its bend at rest; the guess the more, the straighter it is."""
    normal = np.cross(directions[0], directions[1])
    bend = float(np.linalg.norm(normal))
    if bend < np.sin(_STRAIGHT) or abs(normal @ guess) < _MIN_AGREEMENT * bend:
        return guess
    share = np.clip((np.arcsin(min(bend, 1.0)) - _STRAIGHT) / (_BENT - _STRAIGHT), 0, 1)
    # Bent backwards, the plane is the same.
    return _unit((1 - share) * guess + share * np.sign(normal @ guess) * normal / bend)


def _shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if start @ end > 0 else axis_angle_to_matrix(np.pi * _across(start))
    return axis_angle_to_matrix(axis / sine * np.arctan2(sine, start @ end))


def _across(direction: np.ndarray) -> np.ndarray:
    return _unit(np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))]))


def _angle_about(axis: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """The turn about an axis that brings one vector over another, both seen along it."""
    start, end = start - (start @ axis) * axis, end - (end @ axis) * axis
    return float(np.arctan2(np.cross(start, end) @ axis, start @ end))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
