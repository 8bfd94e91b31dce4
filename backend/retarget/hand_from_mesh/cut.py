"""The hand cut out of a character's mesh: which faces are its own, and which vertices they share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...hand.model import JOINT_NAMES
from ...records.errors import LiveHandError
from ...geometry.mesh_tables import components, pinched_vertices, torn_half_edges, welded
from .skinned_surface import SkinnedSurface

_ONE_PLACE_M = 1e-5
_WHOLLY = 0.99  # of a vertex that the hand's bones move: it is the hand's wherever it lies
_ROUNDS = 20  # of smoothing the cut; each takes off a row of faces at most


@dataclass(frozen=True)
class HandCut:
    """V vertices and F faces of the hand out of N and more of the source's.

    Attributes:
        vertex_of: [N] the hand's vertex that a source's became, -1 where it is left out.
        source: [V] a source's vertex of each of the hand's.
        faces: [F, 3] of the hand's vertices.
        polygons: the source's polygons that are kept, ascending.
        other_pieces: how many pieces of the mesh that the hand's bones move hang together with nothing kept.
    """

    vertex_of: np.ndarray
    source: np.ndarray
    faces: np.ndarray
    polygons: np.ndarray
    other_pieces: int


@dataclass(frozen=True)
class Wrist:
    """Where a hand ends.

    Attributes:
        place_m: [3] of the wrist joint.
        towards_elbow: [3] unit.
        stump_m: how much of the forearm stays.
    """

    place_m: np.ndarray
    towards_elbow: np.ndarray
    stump_m: float


def cut_hand(surface: SkinnedSurface, joint_weights: np.ndarray, share: np.ndarray, wrist: Wrist) -> HandCut:
    """Keep the polygons that the hand's bones move, and a stump; of those the piece that the fingers are of.

    Args:
        surface: the whole mesh.
        joint_weights: [N, 16].
        share: [N] the part of each vertex that the hand's bones move.
        wrist: where to cut.

    Raises:
        LiveHandError: nothing is left, or what is left is no surface.
    """
    first = welded(surface.vertices_m, surface.faces, _ONE_PLACE_M)
    faces = first[surface.faces]
    behind = (surface.vertices_m - wrist.place_m) @ wrist.towards_elbow
    is_kept = ((share > _WHOLLY) | (behind < wrist.stump_m))[first]
    chosen = _whole_polygons(_sound(faces) & is_kept[faces].all(1), surface.polygons, _sound(faces))
    fingers = joint_weights[:, 1:].sum(1) * share
    chosen, others = _piece_of_the_fingers(faces, chosen, fingers, share)
    if not is_kept.all():
        chosen = _smoothly_cut(faces, chosen, surface.polygons, fingers, share)
    _check_surface(faces[chosen], joint_weights)
    return _compacted(first, faces, chosen, surface.polygons, others)


def _sound(faces: np.ndarray) -> np.ndarray:
    """[F] bool: faces with three corners, each once."""
    ordered = np.sort(faces, 1)
    _, index = np.unique(ordered, axis=0, return_index=True)
    is_first = np.zeros(len(faces), bool)
    is_first[index] = True
    return is_first & (np.diff(ordered, axis=1) > 0).all(1)


def _whole_polygons(chosen: np.ndarray, polygons: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """Those of the chosen faces whose polygon is chosen as far as it is needed."""
    return chosen & ~np.isin(polygons, polygons[needed & ~chosen])


def _piece_of_the_fingers(
    faces: np.ndarray, chosen: np.ndarray, fingers: np.ndarray, share: np.ndarray
) -> tuple[np.ndarray, int]:
    """The faces that hang together with most of the fingers, and how many pieces of the hand do not."""
    if not chosen.any():
        raise LiveHandError("the mesh must have faces that the hand's bones move, got none; choose the hand's own mesh")
    piece = components(faces[chosen], len(fingers))
    used = np.unique(faces[chosen])
    weight = np.bincount(piece[used], fingers[used], len(fingers))
    moved = np.bincount(piece[used], share[used] > _WHOLLY, len(fingers))
    best = int(weight.argmax())
    if weight[best] <= 0:
        raise LiveHandError("the mesh must have vertices that the fingers' bones move, got none; choose another mesh")
    return chosen & (piece[faces[:, 0]] == best), int((moved > 0).sum() - 1)


def _smoothly_cut(
    faces: np.ndarray, chosen: np.ndarray, polygons: np.ndarray, fingers: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Without the faces at which the open edge meets itself."""
    for _ in range(_ROUNDS):
        pinched = pinched_vertices(faces[chosen])
        if not len(pinched):
            return chosen
        kept = chosen & ~np.isin(polygons, polygons[chosen & np.isin(faces, pinched).any(1)])
        chosen, _ = _piece_of_the_fingers(faces, kept, fingers, share)
    return chosen


def _check_surface(faces: np.ndarray, joint_weights: np.ndarray) -> None:
    torn = torn_half_edges(faces)
    if len(torn):
        where = sorted(set(joint_weights[np.unique(torn)].argmax(1).tolist()))
        raise LiveHandError(
            "the hand must be one surface whose faces meet in pairs and are wound alike; got "
            f"{len(torn)} edges that are not so, near {', '.join(JOINT_NAMES[joint] for joint in where)}; in Edit "
            "Mode, Select > All by Trait > Non Manifold shows them: delete inner faces, merge by distance, and "
            "recalculate normals"
        )
    pinched = pinched_vertices(faces)
    if len(pinched):
        where = sorted(set(joint_weights[pinched].argmax(1).tolist()))
        raise LiveHandError(
            f"an open edge of the hand must not touch itself, got {len(pinched)} vertices where one does, near "
            f"{', '.join(JOINT_NAMES[joint] for joint in where)}; close or widen the holes there"
        )


def _compacted(first: np.ndarray, faces: np.ndarray, chosen: np.ndarray, polygons: np.ndarray, others: int) -> HandCut:
    source, compact = np.unique(faces[chosen], return_inverse=True)
    of_first = np.full(len(first), -1)
    of_first[source] = np.arange(len(source))
    # A vertex beside a seam counts only where its twin's faces are kept: all its own are, or none.
    return HandCut(of_first[first], source, compact.reshape(-1, 3), np.unique(polygons[chosen]), others)
