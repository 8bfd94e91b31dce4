"""Makes a hand model in MANO's format from a user's skinned mesh, for captures and avatars of that mesh.

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
from ...hand.atlas import unwrap
from ...hand.cap import capped
from ...hand.model import JOINT_NAMES, PARENTS
from ...hand.model_file import load_default_hand
from ...records.errors import LiveHandError
from ...records.side import Side
from ...system.atomic_file import replacing
from ...system.npz_file import npz_bytes
from ..natural_range import rest_pose, unnatural_joints
from ..rest_alignment import RestAlignment, align, completed_joints
from ..source_skeleton import JointMap, SourceSkeleton
from .cut import HandCut, Wrist, cut_hand
from .joint_weights import joint_weights, joints_of_bones
from .regressor import joint_regressor
from .skinned_surface import SkinnedSurface
from .template_frame import hand_length_m, world2template

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
    said = unnatural_joints(alignment.model, rest_pose(alignment))
    if said:
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
