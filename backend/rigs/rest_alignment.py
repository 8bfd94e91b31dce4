"""Aligns the rest pose of a hand model with that of another rig: one rotation per joint, so that bones are parallel.

The palms give the wrist's rotation. Along each finger, the frame is carried by the shortest rotations onto the rig's
bones, then rotated about the first bone so that the planes of the fingers' bend agree. The roll of bones, their tails
and the rig's unit do not matter. If all joints coincide, as for a hand model made from the rig, both rest poses are the
same and every joint has the palm's rotation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, rotation_between
from ..hand.bones import rest_forearm
from ..hand.model import MIRROR_POINT, PARENTS, HandModel
from ..motion.landmarks.skeleton import HandSkeleton
from ..records.errors import LiveHandError
from .shape_fit import HandShape, fit_shape, rest_nodes
from .source_skeleton import JointMap, SourceSkeleton, unit

_PALM = np.array([0, 1, 5, 9, 13])  # the wrist and four knuckles among the 21 nodes
_JOINTS = np.array([0, *(4 * finger + k for finger in range(5) for k in (1, 2, 3))])  # all but the tips
_SAME_POSITION = 0.002  # share of the distance from the wrist to the middle knuckle: 0.2 mm in an adult hand
# The bend of a finger gives its flexion axis if larger than the second angle, and does not if below the first.
_STRAIGHT, _BENT = np.deg2rad([6.0, 20.0])
_MIN_AGREEMENT = 0.6
# Without a tip, the tail of the last bone is used if it continues the finger this straight (cosine).
_MIN_STRAIGHTNESS = 0.6
_SMALLEST_M = 1e-6


class AlignedForearm(NamedTuple):
    """A hand model's forearm at rest, aligned with that of another rig at rest.

    Attributes:
        rotation: [3, 3] from the template's frame to the world: the hand's, turned the shortest way.
        frame: [3, 3] in the world, of the rig's bone.
        elbow: [3] unit vector in the world from the rig's wrist to the forearm's head.
    """

    rotation: np.ndarray
    frame: np.ndarray
    elbow: np.ndarray


@dataclass(frozen=True)
class RestAlignment:
    """A hand model at rest, aligned with another rig at rest.

    Attributes:
        model: the hand model, of the rig's side.
        shape: of the hand model.
        rotations: [16, 3, 3] per joint, from the template's frame to the world, when the rig is at rest.
        wrist: [3] m, position of the hand model's wrist in the world then.
        frames: [16, 3, 3] at rest, in the world, of the bones that the joints move with.
        heads: [16, 3] m, of the rig's bones; NaN for joints without one.
        forearm: of both; None if the model or the rig has none.
    """

    model: HandModel
    shape: HandShape
    rotations: np.ndarray
    wrist: np.ndarray
    frames: np.ndarray
    heads: np.ndarray
    forearm: AlignedForearm | None = None

    @property
    def joints(self) -> np.ndarray:
        """[16, 3] m: the hand model's joints in the world when the rig is at rest."""
        nodes = self.shape.scale * rest_nodes(self.model, self.shape.beta)[_JOINTS]
        joints = [self.wrist]
        for joint in range(1, 16):
            above = PARENTS[joint]
            joints.append(joints[above] + self.rotations[above] @ (nodes[joint] - nodes[above]))
        return np.array(joints)


class HandAtRest(NamedTuple):
    """A shape of a hand model at rest: nodes [21, 3] m, and the knuckles' flexion axes [3], None for the thumb."""

    nodes: np.ndarray
    axes: list[np.ndarray | None]

    @classmethod
    def of(cls, model: HandModel, shape: HandShape) -> HandAtRest:
        """Measure in the template's frame, at the shape's scale."""
        return cls(shape.scale * rest_nodes(model, shape.beta), _flexion_axes(model))


def align(
    skeleton: SourceSkeleton, joint_map: JointMap, model: HandModel, shape: HandShape | None = None
) -> RestAlignment:
    """Align a hand model with another rig.

    Args:
        skeleton: of the rig.
        joint_map: the rig's bones of the hand.
        model: of either side; the map's side is used.
        shape: of the model; None fits it to the rig's bones.

    Raises:
        LiveHandError: a bone is missing, or two joints coincide.
    """
    model = model.for_side(joint_map.side)
    rig_nodes = source_nodes(skeleton, joint_map)
    shape = shape or _same_shape(model, rig_nodes) or fit_shape(model, rig_nodes)
    rotations, wrist = place_hand(HandAtRest.of(model, shape), rig_nodes, source_ends(skeleton, joint_map))
    drivers = [skeleton.index(bone) for bone in joint_map.drivers]
    forearm = _forearm(skeleton, joint_map, model, rotations[0])
    return RestAlignment(model, shape, rotations, wrist, skeleton.frames[drivers], rig_nodes[_JOINTS], forearm)


def _forearm(
    skeleton: SourceSkeleton, joint_map: JointMap, model: HandModel, palm: np.ndarray
) -> AlignedForearm | None:
    """Align the forearms, the hand being turned by palm [3, 3]."""
    if joint_map.forearm is None or not model.has_arm:
        return None
    elbow = _head(skeleton, joint_map.forearm) - _head(skeleton, joint_map.bones[0])
    if np.linalg.norm(elbow) < _SMALLEST_M:
        raise LiveHandError(f"the forearm '{joint_map.forearm}' must begin apart from the wrist; choose another bone")
    turned = palm @ -rest_forearm(model).frame[:, 1]
    rotation = shortest_rotation(turned, unit(elbow)) @ palm
    return AlignedForearm(rotation, skeleton.frames[skeleton.index(joint_map.forearm)], unit(elbow))


def completed_joints(alignment: RestAlignment) -> np.ndarray:
    """Return [16, 3] m: the rig's joints; those that it lacks continue its fingers as the aligned hand's do."""
    joints, own = alignment.heads.copy(), alignment.joints
    for joint in range(1, 16):
        if np.isnan(joints[joint, 0]):
            joints[joint] = joints[PARENTS[joint]] + own[joint] - own[PARENTS[joint]]
    return joints


def place_hand(hand: HandAtRest, rig_nodes: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the joints' rotations [16, 3, 3] and the wrist's place [3] m with which a hand has the pose of another.

    Args:
        hand: at rest.
        rig_nodes: [21, 3] m the other's nodes, NaN for those that it lacks.
        ends: [5, 3] m where the fingers' last bones end; used for fingers without a tip.
    """
    rig_nodes = _with_gaps_filled(rig_nodes, hand.nodes)
    known = np.isfinite(rig_nodes).all(1)
    palm_nodes, joint_nodes = _PALM[known[_PALM]], _JOINTS[known[_JOINTS]]
    palm = _rotation_between(hand.nodes[palm_nodes], rig_nodes[palm_nodes])
    wrist = rig_nodes[palm_nodes].mean(0) + palm @ (hand.nodes[0] - hand.nodes[palm_nodes].mean(0))
    joints = _rotation_between(hand.nodes[joint_nodes], rig_nodes[joint_nodes])
    if _coincide(hand.nodes[joint_nodes], rig_nodes[joint_nodes], joints):
        return np.array([joints] * 16), rig_nodes[0]
    directions = _directions(rig_nodes, ends)
    rotations = [palm]
    for finger in range(5):
        rotations += _finger_rotations(palm, _bones(hand.nodes, finger), directions[finger], hand.axes[finger])
    return np.array(rotations), wrist


def source_ends(skeleton: SourceSkeleton, joint_map: JointMap) -> np.ndarray:
    """Compute [5, 3] m: the tails of the last bones that each finger has; NaN for a finger without bones."""
    ends = np.full((5, 3), np.nan)
    for finger in range(5):
        bones = [bone for bone in joint_map.bones[3 * finger + 1 : 3 * finger + 4] if bone]
        if bones:
            ends[finger] = skeleton.tails[skeleton.index(bones[-1])]
    return ends


def source_nodes(skeleton: SourceSkeleton, joint_map: JointMap) -> np.ndarray:
    """Return [21, 3] m the wrist, and each finger's three joints and tip; NaN for those without a bone.

    Raises:
        LiveHandError: a bone is missing, or joints of one finger coincide.
    """
    heads = [_head(skeleton, bone) for bone in joint_map.bones]
    nodes = [heads[0]]
    for finger in range(5):
        nodes += [*heads[3 * finger + 1 : 3 * finger + 4], _head(skeleton, joint_map.tips[finger])]
        known = [node for node in (heads[0], *nodes[-4:]) if np.isfinite(node).all()]
        if len(known) > 1 and (np.linalg.norm(np.diff(known, axis=0), axis=1) < _SMALLEST_M).any():
            raise LiveHandError(
                f"joints must lie apart, got '{joint_map.drivers[3 * finger + 1]}' or the next bone in the place of "
                "another; choose other bones"
            )
    return np.array(nodes)


def _head(skeleton: SourceSkeleton, bone: str | None) -> np.ndarray:
    return skeleton.heads[skeleton.index(bone)] if bone else np.full(3, np.nan)


def _with_gaps_filled(nodes: np.ndarray, template: np.ndarray) -> np.ndarray:
    """Set missing nodes of [21, 3] that lie between two known ones of a finger on the line between them."""
    nodes = nodes.copy()
    for finger in range(5):
        rows = slice(4 * finger + 1, 4 * finger + 5)
        along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(template[rows], axis=0), axis=1))]
        known = np.flatnonzero(np.isfinite(nodes[rows]).all(1))
        for start, end in pairwise(known):
            for row in range(start + 1, end):
                share = (along[row] - along[start]) / (along[end] - along[start])
                nodes[rows][row] = (1 - share) * nodes[rows][start] + share * nodes[rows][end]
    return nodes


def _rotation_between(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Compute the rotation [3, 3] that best aligns points [N, 3] with others, about their centres."""
    return rotation_between(points - points.mean(0), others - others.mean(0))


def _same_shape(model: HandModel, rig_nodes: np.ndarray) -> HandShape | None:
    """Return the mean shape, if its joints coincide with the rig's at some scale; tips differ between rigs."""
    rows = _JOINTS[np.isfinite(rig_nodes[_JOINTS]).all(1)]
    own, other = rest_nodes(model, np.zeros(10))[rows], rig_nodes[rows]
    scale = float(np.linalg.norm(other - other.mean(0)) / np.linalg.norm(own - own.mean(0)))
    is_same = _coincide(scale * own, other, _rotation_between(own, other))
    return HandShape(np.zeros(10), scale) if is_same else None


def _coincide(model_nodes: np.ndarray, rig_nodes: np.ndarray, rotation: np.ndarray) -> bool:
    """Tell whether the joints [N, 3], of which the first is the wrist, rigidly moved lie on the rig's."""
    own, other = model_nodes - model_nodes.mean(0), rig_nodes - rig_nodes.mean(0)
    error = np.linalg.norm(own @ rotation.T - other, axis=1).max()
    return bool(error < _SAME_POSITION * np.median(np.linalg.norm(rig_nodes[1:] - rig_nodes[0], axis=1)))


def _directions(nodes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Compute [5, 3, 3] unit directions of every finger's three bones, NaN where there is none.

    Without a tip, the last bone's is that of its tail (ends [5, 3]) if it continues the finger, else that of the bone
    before.
    """
    directions = np.array([_bones(nodes, finger) for finger in range(5)])
    for finger in range(5):
        open_bones = np.flatnonzero(np.isnan(directions[finger, :, 0]))
        last = open_bones[0] if len(open_bones) else 0
        if last and np.isfinite(nodes[4 * finger + 1 + last]).all():
            tail = unit(ends[finger] - nodes[4 * finger + 1 + last])
            straight = directions[finger, last - 1]
            directions[finger, last] = tail if tail @ straight > _MIN_STRAIGHTNESS else straight
    return directions


def _bones(nodes: np.ndarray, finger: int) -> np.ndarray:
    return unit(np.diff(nodes[4 * finger + 1 : 4 * finger + 5], axis=0))


def _flexion_axes(model: HandModel) -> list[np.ndarray | None]:
    """Compute [3] unit flexion axis of every finger's knuckle in the template's frame, None for the thumb."""
    axes = HandSkeleton.of(model).axes[:4, 0, 0]
    # A mirrored axis of rotation changes its sign as well.
    return [*(axes if model.side == "right" else -axes * MIRROR_POINT), None]


def _finger_rotations(
    palm: np.ndarray, model_bones: np.ndarray, rig_bones: np.ndarray, axis: np.ndarray | None
) -> list[np.ndarray]:
    """Rotate the model's bones [3, 3] of a finger at rest onto the rig's directions [3, 3]: three [3, 3].

    A bone whose direction is NaN stays at rest. Without a flexion axis [3], as for the thumb, which rotates at its root
    as well, the roll is not corrected.
    """
    rotations, parent = [], palm
    for model_bone, rig_bone in zip(model_bones, rig_bones, strict=True):
        if np.isfinite(rig_bone).all():
            parent = shortest_rotation(parent @ model_bone, rig_bone) @ parent
        rotations.append(parent)
    if axis is None or not np.isfinite(rig_bones[:2]).all():
        return rotations
    rig_bones = np.where(np.isfinite(rig_bones), rig_bones, rig_bones[1])
    knuckle = rotations[0]
    roll = _angle_about(rig_bones[0], knuckle @ _bend_axis(model_bones, axis), _bend_axis(rig_bones, knuckle @ axis))
    return [axis_angle_to_matrix(roll * bone) @ rotation for bone, rotation in zip(rig_bones, rotations, strict=True)]


def _bend_axis(directions: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """Blend a finger's flexion axis [3] from its bend at rest with the guess, the straighter the finger is."""
    normal = np.cross(directions[0], directions[1])
    bend = float(np.linalg.norm(normal))
    if bend < np.sin(_STRAIGHT) or abs(normal @ guess) < _MIN_AGREEMENT * bend:
        return guess
    share = np.clip((np.arcsin(min(bend, 1.0)) - _STRAIGHT) / (_BENT - _STRAIGHT), 0, 1)
    # The sign: a finger bent backwards has the same plane.
    return unit((1 - share) * guess + share * np.sign(normal @ guess) * normal / bend)


def shortest_rotation(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Compute the rotation [3, 3] by the smallest angle from one unit vector [3] to another."""
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if start @ end > 0 else axis_angle_to_matrix(np.pi * _perpendicular(start))
    return axis_angle_to_matrix(axis / sine * np.arctan2(sine, start @ end))


def _perpendicular(direction: np.ndarray) -> np.ndarray:
    return unit(np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))]))


def _angle_about(axis: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Measure the angle about an axis from one vector to another, both projected across it."""
    start, end = start - (start @ axis) * axis, end - (end @ axis) * axis
    return float(np.arctan2(np.cross(start, end) @ axis, start @ end))
