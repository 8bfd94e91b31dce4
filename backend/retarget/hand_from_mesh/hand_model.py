"""Somebody's skinned mesh -> a hand model in MANO's format, for captures and avatars of that very mesh.

It has the mesh's own vertices and weights, our template's frame, and an atlas of its own. It has no shapes and no pose
correctives: both are zero.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...hand.atlas import unwrap
from ...hand.cap import capped
from ...hand.model import PARENTS
from ...records.errors import LiveHandError
from ...records.shot import Side
from ..source_skeleton import JointMap, RestSkeleton
from .cut import HandCut, Wrist, cut_hand
from .joint_weights import joint_weights, joints_of_bones
from .regressor import joint_regressor
from .skinned_surface import SkinnedSurface
from .template_frame import hand_length_m, world2template

FEWEST_VERTICES, MOST_VERTICES = 100, 20_000
_STUMP = 0.18  # of the hand's length: the built-in hand's
_ELBOW = 0.4  # of the hand's length: how far above the wrist its parent must begin to show where the forearm lies


@dataclass(frozen=True)
class OwnHand:
    """A hand model before it is a file.

    Attributes:
        side: which hand.
        arrays: MANO's keys, vt and ft.
        cut: which of the source's vertices and polygons it has.
        cap: [C, 3] the faces among its own that close its open edges, in its vertices; they are its last.
        world2template: [4, 4] rigid, from where the source stood.
    """

    side: Side
    arrays: Mapping[str, np.ndarray]
    cut: HandCut
    cap: np.ndarray
    world2template: np.ndarray


def make_hand_model(
    surface: SkinnedSurface, skeleton: RestSkeleton, joint_map: JointMap, scale: float = 1.0
) -> OwnHand:
    """The hand of a skinned mesh.

    Args:
        surface: the mesh at rest; a whole character's is cut behind the wrist.
        skeleton: its bones, in the order of its weights.
        joint_map: which of them are joints.
        scale: what the world's lengths are multiplied by to be metres.

    Raises:
        LiveHandError: size, side, number of vertices or topology are not a hand's.
    """
    surface = replace(surface, vertices_m=surface.vertices_m * scale)
    joint_of = joints_of_bones(skeleton, joint_map)
    heads = skeleton.heads * scale
    joints = heads[[skeleton.index(name) for name in joint_map.bones]]
    frame = world2template(joints, joint_map.side)
    weights, share = joint_weights(surface.weights, joint_of)
    cut = cut_hand(surface, weights, share, _wrist(heads, skeleton, joint_map))
    _check_count(len(cut.source))
    vertices = _moved(surface.vertices_m[cut.source], frame)
    arrays, cap = _arrays(vertices, cut.faces, weights[cut.source], _moved(joints, frame))
    return OwnHand(joint_map.side, arrays, cut, cap, frame @ np.diag([scale, scale, scale, 1.0]))


def save_hand_model(hand: OwnHand, path: Path, provenance: Mapping[str, Any]) -> None:
    """Write the `.npz`, whole or not at all; `load_hand_model` reads it.

    Raises:
        LiveHandError: the file's name does not tell its side, or it cannot be written.
    """
    check_name(path, hand.side)
    partial = path.with_name(f"{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as file:
            np.savez_compressed(file, provenance=np.array(json.dumps(dict(provenance))), **hand.arrays)
        partial.replace(path)
    except OSError as error:
        raise LiveHandError(f"{path} must be writable ({error})") from error


def check_name(path: Path, side: Side) -> None:
    """Raise `LiveHandError` unless a hand's file says by its name which side it is, as `load_hand_model` reads it."""
    if path.suffix.lower() != ".npz":
        raise LiveHandError(f"a hand model's file must end with .npz, got {path.name}")
    says_left = "left" in path.stem.lower()
    if says_left != (side == "left"):
        remedy = f"{path.stem.lower().replace('left', 'right')}.npz" if says_left else f"{path.stem}_left.npz"
        raise LiveHandError(
            f"a hand's file has 'left' in its name where the hand is a left one, and only there; got {path.name} for "
            f"the {side} hand: call it {remedy}"
        )


def _wrist(heads: np.ndarray, skeleton: RestSkeleton, joint_map: JointMap) -> Wrist:
    """The wrist, and where the forearm lies by the bones above it."""
    bone = skeleton.index(joint_map.bones[0])
    length = hand_length_m(heads[[skeleton.index(name) for name in joint_map.bones]])
    place, above = heads[bone], skeleton.parents[bone]
    while above >= 0 and np.linalg.norm(heads[above] - place) < _ELBOW * length:
        above = skeleton.parents[above]
    knuckle = heads[skeleton.index(joint_map.bones[4])]
    towards = heads[above] - place if above >= 0 else place - knuckle
    if towards @ (place - knuckle) <= 0:  # a root beside the hand, no elbow
        towards = place - knuckle
    return Wrist(place, towards / np.linalg.norm(towards), _STUMP * length)


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


def _check_count(count: int) -> None:
    if not FEWEST_VERTICES <= count <= MOST_VERTICES:
        remedy = "subdivide the mesh once" if count < FEWEST_VERTICES else "decimate it (Blender's Decimate modifier)"
        raise LiveHandError(
            f"a hand must have {FEWEST_VERTICES} to {MOST_VERTICES} vertices, got {count}; {remedy} and try again"
        )


def _check_outward(vertices: np.ndarray, closed: np.ndarray) -> None:
    a, b, c = (vertices[closed[:, corner]] - vertices.mean(0) for corner in range(3))
    if (np.cross(a, b) * c).sum() <= 0:
        raise LiveHandError(
            "the hand's faces must point outward, they point inward; recalculate its normals (Mesh > Normals)"
        )


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]
