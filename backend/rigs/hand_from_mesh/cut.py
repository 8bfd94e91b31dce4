"""Cuts the hand out of a character's mesh: the faces to keep, and their vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...geometry.mesh_tables import merged_vertices, pinched_vertices, repeated_half_edges
from ...hand.model import JOINT_NAMES
from ...records.errors import LiveHandError
from .pieces import MovedMesh, hand_pieces, main_parts
from .skinned_surface import SkinnedSurface

_MERGE_DISTANCE_M = 1e-5
_FULL_SHARE = 0.99  # a vertex that the hand's bones move by more is kept wherever it lies
_SMOOTHING_ROUNDS = 20  # each removes at most one row of faces at the cut


@dataclass(frozen=True)
class HandCut:
    """The hand's V vertices and F faces within a source mesh of N vertices.

    Attributes:
        vertex_of: [N] the hand's vertex for each source vertex, -1 if it is left out.
        source: [V] a source vertex of each hand vertex.
        faces: [F, 3] indices of the hand's vertices.
        polygons: indices of the source polygons that are kept, ascending.
        other_pieces: number of separate pieces that the hand's bones move and that are left out.
    """

    vertex_of: np.ndarray
    source: np.ndarray
    faces: np.ndarray
    polygons: np.ndarray
    other_pieces: int


@dataclass(frozen=True)
class Wrist:
    """Where the hand is cut off the arm.

    Attributes:
        position_m: [3] of the wrist joint.
        towards_elbow: [3] unit.
        stump_m: length of the forearm that is kept.
        reach_m: loose pieces that extend farther from the wrist are no part of the hand.
    """

    position_m: np.ndarray
    towards_elbow: np.ndarray
    stump_m: float
    reach_m: float = np.inf


def cut_hand(surface: SkinnedSurface, joint_weights: np.ndarray, share: np.ndarray, wrist: Wrist) -> HandCut:
    """Keep the polygons that the hand's bones move and a stump of the forearm, in the pieces that make up the hand.

    Args:
        surface: the whole mesh.
        joint_weights: [N, 16].
        share: [N] the share of the hand's bones in each vertex's weights.
        wrist: where to cut.

    Raises:
        LiveHandError: nothing is left, or the rest is not a manifold surface.
    """
    first = merged_vertices(surface.vertices_m, surface.faces, _MERGE_DISTANCE_M)
    faces = first[surface.faces]
    distance = (surface.vertices_m - wrist.position_m) @ wrist.towards_elbow
    is_kept = ((share > _FULL_SHARE) | (distance < wrist.stump_m))[first]
    is_valid = _valid_faces(faces)
    kept = _whole_polygons(is_valid & is_kept[faces].all(1), surface.polygons, is_valid)
    mesh = MovedMesh(surface.vertices_m, faces, joint_weights[:, 1:].sum(1) * share, share)
    _check_fingers(mesh, kept)
    is_in_reach = np.linalg.norm(surface.vertices_m - wrist.position_m, axis=1) < wrist.reach_m
    kept, others = hand_pieces(mesh, kept, is_in_reach)
    if not is_kept.all():
        kept = _without_pinches(mesh, kept, surface.polygons)
    _check_surface(faces[kept], joint_weights)
    return _compacted(first, faces, kept, surface.polygons, others)


def _valid_faces(faces: np.ndarray) -> np.ndarray:
    """Return [F] bool: faces with three different corners, without repetitions of a face."""
    ordered = np.sort(faces, 1)
    _, index = np.unique(ordered, axis=0, return_index=True)
    is_first = np.zeros(len(faces), bool)
    is_first[index] = True
    return is_first & (np.diff(ordered, axis=1) > 0).all(1)


def _whole_polygons(kept: np.ndarray, polygons: np.ndarray, is_valid: np.ndarray) -> np.ndarray:
    """Select the kept faces whose polygon has no valid face that is not kept."""
    return kept & ~np.isin(polygons, polygons[is_valid & ~kept])


def _check_fingers(mesh: MovedMesh, kept: np.ndarray) -> None:
    used = np.unique(mesh.faces[kept])
    if not len(used) or mesh.share[used].max() <= _FULL_SHARE:
        raise LiveHandError("the mesh must have faces that the hand's bones move, got none; choose the hand's own mesh")
    if mesh.fingers[used].max() <= 0:
        raise LiveHandError("the mesh must have vertices that the fingers' bones move, got none; choose another mesh")


def _without_pinches(mesh: MovedMesh, kept: np.ndarray, polygons: np.ndarray) -> np.ndarray:
    """Drop the kept faces at which the boundary touches itself."""
    for _ in range(_SMOOTHING_ROUNDS):
        pinched = pinched_vertices(mesh.faces[kept])
        if not len(pinched):
            return kept
        is_pinched = kept & np.isin(mesh.faces, pinched).any(1)
        kept = main_parts(mesh, kept & ~np.isin(polygons, polygons[is_pinched]))
    return kept


def _check_surface(faces: np.ndarray, joint_weights: np.ndarray) -> None:
    repeated = repeated_half_edges(faces)
    if len(repeated):
        raise LiveHandError(
            "the hand must be one surface whose faces meet in pairs and are wound alike; got "
            f"{len(repeated)} edges that are not so, near {_joints_at(np.unique(repeated), joint_weights)}; in Edit "
            "Mode, Select > All by Trait > Non Manifold shows them: delete inner faces, merge by distance, and "
            "recalculate normals"
        )
    pinched = pinched_vertices(faces)
    if len(pinched):
        raise LiveHandError(
            f"an open edge of the hand must not touch itself, got {len(pinched)} vertices where one does, near "
            f"{_joints_at(pinched, joint_weights)}; close or widen the holes there"
        )


def _joints_at(vertices: np.ndarray, joint_weights: np.ndarray) -> str:
    joints = sorted(set(joint_weights[vertices].argmax(1).tolist()))
    return ", ".join(JOINT_NAMES[joint] for joint in joints)


def _compacted(first: np.ndarray, faces: np.ndarray, kept: np.ndarray, polygons: np.ndarray, others: int) -> HandCut:
    source, compact = np.unique(faces[kept], return_inverse=True)
    of_first = np.full(len(first), -1)
    of_first[source] = np.arange(len(source))
    return HandCut(of_first[first], source, compact.reshape(-1, 3), np.unique(polygons[kept]), others)
