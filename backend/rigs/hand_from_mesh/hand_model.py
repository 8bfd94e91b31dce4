"""Makes a hand model in MANO's format from a user's skinned mesh, for captures and avatars of that mesh.

A bone that is not a joint (a metacarpal, a tip, a twist bone) moves with the nearest joint above it. Bones above the
wrist or beside it belong to no joint.

The model has the mesh's own vertices and weights, the template's frame, and a new atlas. Its shape directions and pose
correctives are zero.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...geometry.mesh_tables import connected_components
from ...geometry.rotation import rotation_between
from ...hand.atlas import unwrap
from ...hand.cap import capped
from ...hand.model import JOINT_NAMES, MIRROR_POINT, PARENTS
from ...hand.model_file import load_default_hand
from ...motion.gate import motion_doubts
from ...records.errors import LiveHandError
from ...records.side import Side
from ...system.files import replacing
from ...system.readers import npz_bytes
from ..natural_range import is_natural, rest_pose
from ..rest_alignment import RestAlignment, align, completed_joints
from ..source_skeleton import JointMap, SourceSkeleton
from .cut import HandCut, Wrist, cut_hand
from .skinned_surface import SkinnedSurface

_LEAST_VERTICES = 24  # with a weight
_EXACT_M = 1e-9


def joint_regressor(vertices: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Solve for [16, V], rows of sum 1 that give the joints exactly, of least norm on the vertices nearest to each.

    Args:
        vertices: [V, 3] m.
        joints: [16, 3] m.

    Raises:
        LiveHandError: all vertices lie in one plane and a joint outside it.
    """
    return np.array([_row(vertices, joint) for joint in joints])


def _row(vertices: np.ndarray, joint: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(vertices - joint, axis=1)
    order, count = np.argsort(distance, kind="stable"), _LEAST_VERTICES
    while True:
        near = order[:count]
        weights = _weights(vertices[near] - joint)
        if np.linalg.norm(weights @ vertices[near] - joint) < _EXACT_M:
            row = np.zeros(len(vertices))
            row[near] = weights
            return row
        if count >= len(vertices):
            raise LiveHandError(
                "a hand must have a volume, got vertices that all lie in one plane; choose its own mesh"
            )
        count *= 2


def _weights(offsets: np.ndarray) -> np.ndarray:
    """Solve for weights [n] of least norm, with sum 1 and a weighted mean offset of 0."""
    size = np.linalg.norm(offsets, axis=1).max()
    rows = np.vstack([np.ones(len(offsets)), offsets.T / size])
    weights, *_ = np.linalg.lstsq(rows, np.array([1.0, 0, 0, 0]), rcond=None)
    return weights


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


_KNUCKLES = [1, 4, 7, 10]
_LAST_JOINTS = [3, 6, 9, 12]
_THUMB_TIP = 15
_USUAL_M = 0.18
SMALLEST_M, LARGEST_M = 0.1, 0.3  # from the wrist to the middle fingertip
# Fingers that bend backwards by more than this share of the hand's length show that the side is wrong.
_MOST_BACKWARDS = 0.06


def world2template(joints: np.ndarray, side: Side) -> np.ndarray:
    """Fit the rigid transform [4, 4] from the world of the joints [16, 3] m to the template's frame.

    The wrist is moved to the built-in hand's, then the knuckles are aligned with its knuckles by rotation (Kabsch).

    Raises:
        LiveHandError: the joints have the wrong size, or seem to be those of the other side.
    """
    builtin = load_default_hand().joints * (1 if side == "right" else MIRROR_POINT)
    check_size(joints)
    knuckles, wanted = joints[_KNUCKLES] - joints[0], builtin[_KNUCKLES] - builtin[0]
    rotation = rotation_between(knuckles, wanted)
    _check_side((joints - joints[0]) @ rotation.T, side)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, builtin[0] - rotation @ joints[0]
    return matrix


def hand_length_m(joints: np.ndarray) -> float:
    """Measure from the wrist along the middle finger to its tip, taken to be a last bone beyond the last joint."""
    steps = np.linalg.norm(np.diff(joints[[0, 4, 5, 6]], axis=0), axis=1)
    return float(steps.sum() + steps[-1])


def check_size(joints: np.ndarray) -> None:
    """Raise `LiveHandError` unless the joints have the size of a hand in metres; the message suggests a unit."""
    length = hand_length_m(joints)
    if SMALLEST_M <= length <= LARGEST_M:
        return
    units = {"centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254, "decimetres": 0.1}
    fitting = [(unit, scale) for unit, scale in units.items() if SMALLEST_M <= length * scale <= LARGEST_M]
    guess = f"it seems to be in {fitting[0][0]}: scale it by {fitting[0][1]:g}" if fitting else "scale it"
    if length < SMALLEST_M and length > 0:
        guess = f"scale it by {10.0 ** round(np.log10(_USUAL_M / length)):g}, or by about {_USUAL_M / length:.2g}"
    raise LiveHandError(
        f"a hand must be {SMALLEST_M} to {LARGEST_M} m long from wrist to middle fingertip, got {length:.3g} m; {guess}"
    )


def _check_side(joints: np.ndarray, side: Side) -> None:
    """Raise `LiveHandError` if the resting fingers bend backwards."""
    length = hand_length_m(joints)
    backwards = joints[_LAST_JOINTS, 1].mean() + joints[_THUMB_TIP, 1]  # +Y is the back of either hand
    if backwards > _MOST_BACKWARDS * length:
        other = "left" if side == "right" else "right"
        raise LiveHandError(
            f"a resting hand's fingers must bend towards its palm; these are bent {1e3 * backwards:.0f} mm backwards "
            f"as a {side} hand's: choose the {other} side, or correct the order of its fingers"
        )


FEWEST_VERTICES, MOST_VERTICES = 100, 20_000
_LEAST_WEIGHT = 0.1  # of a joint, in the vertex that it moves most
_LEAST_REACH = 0.75  # of the hand's length, from the wrist to the farthest vertex
_MOST_REACH = 1.5  # of the hand's length, for loose pieces
_STUMP = 0.18  # of the hand's length, as in the built-in hand
_ELBOW = 0.4  # of the hand's length: a bone above the wrist that begins farther away shows the direction of the forearm


@dataclass(frozen=True)
class MeshHand:
    """A hand model made from a mesh, before it is written.

    Attributes:
        side: which hand.
        arrays: MANO's keys, and vt and ft.
        cut: the vertices and polygons of the source that it has.
        cap: [C, 3] its last faces, which close its open edges.
        world2template: [4, 4] from the world in which the source stands.
        alignment: of the built-in hand with the source's bones.
    """

    side: Side
    arrays: Mapping[str, np.ndarray]
    cut: HandCut
    cap: np.ndarray
    world2template: np.ndarray
    alignment: RestAlignment


def make_hand_model(
    surface: SkinnedSurface, skeleton: SourceSkeleton, joint_map: JointMap, scale: float = 1.0
) -> MeshHand:
    """Make a hand model from a skinned mesh.

    Args:
        surface: the mesh at rest; the mesh of a whole character is cut behind the wrist.
        skeleton: its bones, in the order of its weights.
        joint_map: which bones are the hand's joints.
        scale: factor from the world's unit to metres.

    Raises:
        LiveHandError: size, side, number of vertices or topology is not that of a hand.
    """
    surface = replace(surface, vertices_m=surface.vertices_m * scale)
    joint_of = joints_of_bones(skeleton, joint_map)
    heads = skeleton.heads * scale
    alignment = align(skeleton, joint_map, load_default_hand())
    joints = completed_joints(alignment) * scale
    frame = world2template(joints, joint_map.side)
    _check_pose(alignment)
    weights, share = joint_weights(surface.weights, joint_of)
    wrist = _wrist(heads, joints, skeleton, skeleton.index(joint_map.drivers[0]))
    cut = cut_hand(surface, weights, share, wrist)
    _check_parts(weights[cut.source], surface.vertices_m[cut.source], joints, joint_map.missing)
    _check_count(len(cut.source))
    vertices = _moved(surface.vertices_m[cut.source], frame)
    arrays, cap = _arrays(vertices, cut.faces, weights[cut.source], _moved(joints, frame))
    return MeshHand(joint_map.side, arrays, cut, cap, frame @ np.diag([scale, scale, scale, 1.0]), alignment)


def save_hand_model(hand: MeshHand, path: Path, provenance: Mapping[str, Any]) -> None:
    """Write the `.npz` for `load_hand_model`, atomically.

    Raises:
        LiveHandError: the file's name contradicts the side, or the file cannot be written.
    """
    check_name(path, hand.side)
    arrays = {"provenance": np.array(json.dumps(dict(provenance))), **hand.arrays}
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(arrays))


def check_name(path: Path, side: Side) -> None:
    """Raise `LiveHandError` unless the file's name tells `load_hand_model` the right side."""
    if path.suffix.lower() != ".npz":
        raise LiveHandError(f"a hand model's file must end with .npz, got {path.name}")
    says_left = "left" in path.stem.lower()
    if says_left != (side == "left"):
        remedy = f"{path.stem.lower().replace('left', 'right')}.npz" if says_left else f"{path.stem}_left.npz"
        raise LiveHandError(
            f"a hand model's file must have 'left' in its name if and only if it is a left hand, got {path.name} for "
            f"the {side} hand: call it {remedy}"
        )


def _wrist(heads: np.ndarray, joints: np.ndarray, skeleton: SourceSkeleton, bone: int) -> Wrist:
    """Find the wrist joint, and the direction of the forearm from the bones above it."""
    length = hand_length_m(joints)
    position, above = heads[bone], skeleton.parents[bone]
    while above >= 0 and np.linalg.norm(heads[above] - position) < _ELBOW * length:
        above = skeleton.parents[above]
    towards = heads[above] - position if above >= 0 else position - joints[4]
    if towards @ (position - joints[4]) <= 0:  # the bone is a root beside the hand, not an elbow
        towards = position - joints[4]
    return Wrist(position, towards / np.linalg.norm(towards), _STUMP * length, _MOST_REACH * length)


def _arrays(
    vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray, joints: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    closed = capped(vertices, faces)
    _check_outward(vertices, closed)
    vt, ft = unwrap(vertices, closed)
    parents = np.array(PARENTS)
    arrays = {
        "v_template": vertices,
        "f": closed,
        "weights": weights,
        "J_regressor": joint_regressor(vertices, joints),
        "kintree_table": np.stack([np.where(parents < 0, 2**32 - 1, parents), np.arange(16)]),
        "shapedirs": np.zeros((len(vertices), 3, 10)),
        "posedirs": np.zeros((len(vertices), 3, 135)),
        "vt": vt,
        "ft": ft,
    }
    return arrays, closed[len(faces) :]


def _check_pose(alignment: RestAlignment) -> None:
    """Raise `LiveHandError` if the bones at rest are in a pose that no hand can have."""
    rest = rest_pose(alignment)
    if not is_natural(alignment.model, rest):
        said = "; ".join(motion_doubts(alignment.model, rest))
        raise LiveHandError(
            f"a hand must rest in a pose that a hand can have, got one in which {said}; correct which bone is which "
            "joint, or the rest pose"
        )


def _check_parts(weights: np.ndarray, vertices: np.ndarray, joints: np.ndarray, missing: tuple[str, ...]) -> None:
    """Raise `LiveHandError` if a joint that has a bone moves no vertex of the hand, or the hand is a fragment."""
    moved = dict(zip(JOINT_NAMES, weights.max(0) >= _LEAST_WEIGHT, strict=True))
    still = [name for name, is_moved in moved.items() if not is_moved and name not in missing]
    if still:
        raise LiveHandError(
            f"every joint must move a part of the mesh, got none for {', '.join(still)}; if the hand is in several "
            "meshes, join them (Object > Join), else correct the bones or the weights"
        )
    reach, length = float(np.linalg.norm(vertices - joints[0], axis=1).max()), hand_length_m(joints)
    if reach < _LEAST_REACH * length:
        raise LiveHandError(
            f"a hand {1e3 * length:.0f} mm long by its bones must have a mesh of that length, got one that ends "
            f"{1e3 * reach:.0f} mm from the wrist; choose the hand's whole mesh, or its own bones"
        )


def _check_count(count: int) -> None:
    if not FEWEST_VERTICES <= count <= MOST_VERTICES:
        remedy = "subdivide the mesh once" if count < FEWEST_VERTICES else "decimate it (Blender's Decimate modifier)"
        raise LiveHandError(
            f"a hand must have {FEWEST_VERTICES} to {MOST_VERTICES} vertices, got {count}; {remedy} and try again"
        )


def _check_outward(vertices: np.ndarray, closed: np.ndarray) -> None:
    """Raise `LiveHandError` unless each piece encloses a positive volume."""
    a, b, c = (vertices[closed[:, corner]] - vertices.mean(0) for corner in range(3))
    piece = connected_components(closed, len(vertices))[closed[:, 0]]
    volumes = np.bincount(piece, (np.cross(a, b) * c).sum(1))[np.unique(piece)]
    if (volumes <= 0).any():
        raise LiveHandError(
            f"the hand's faces must point outward, they point inward in {int((volumes <= 0).sum())} of "
            f"{len(volumes)} pieces; recalculate its normals (Mesh > Normals)"
        )


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]
