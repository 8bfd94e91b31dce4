"""Chooses which loose pieces of a mesh are a hand's: characters are often made of shells, one for a finger segment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.mesh_tables import connected_components

_FULL_SHARE = 0.99  # of the hand's bones in the weights of a vertex
_COVER_M = 0.003  # a piece nearer to the hand's surface lies upon it, as nails do
_COVERED_SHARE = 0.9  # of a piece's vertices that lie upon the hand or inside it
_MOST_POINTS = 64  # of a piece, that are tested


class MovedMesh(NamedTuple):
    """A mesh, and how much of it the hand moves.

    Attributes:
        vertices_m: [N, 3].
        faces: [F, 3].
        fingers: [N] the share of the fingers' bones in each vertex's weights.
        share: [N] the share of all bones of the hand.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    fingers: np.ndarray
    share: np.ndarray


def hand_pieces(mesh: MovedMesh, kept: np.ndarray, is_in_reach: np.ndarray) -> tuple[np.ndarray, int]:
    """Select of the kept faces [F] those of the hand's pieces, and count the moved pieces left out.

    The piece with most of the fingers comes first. Others are added unless they lie upon those before or inside them
    (nails, rings, bones), or beyond the hand's reach (props).

    Args:
        mesh: with its pieces.
        kept: [F] bool.
        is_in_reach: [N] bool.
    """
    kept = main_parts(mesh, kept)
    piece = connected_components(mesh.faces[kept], len(mesh.share))
    labels = piece[mesh.faces[:, 0]]
    first, *others = sorted(set(labels[kept].tolist()), key=lambda label: -float(mesh.fingers[piece == label].sum()))
    chosen = kept & (labels == first)
    left_out = 0
    for label in others:
        own = np.unique(mesh.faces[kept & (labels == label)])
        if is_in_reach[own].all() and not _is_covered(mesh, own, mesh.faces[chosen]):
            chosen |= kept & (labels == label)
        else:
            left_out += 1
    return chosen, left_out


def main_parts(mesh: MovedMesh, kept: np.ndarray) -> np.ndarray:
    """Drop crumbs from the kept faces [F]: of each loose piece, the connected part that the hand moves most stays."""
    whole = connected_components(mesh.faces, len(mesh.share))
    part = connected_components(mesh.faces[kept], len(mesh.share))
    used = np.unique(mesh.faces[kept])
    is_full = mesh.share[used] > _FULL_SHARE
    moved = np.bincount(part[used], is_full + len(used) * mesh.fingers[used], len(mesh.share))
    best: dict[int, int] = {}
    for label in np.unique(part[used[is_full]]).tolist():
        home = int(whole[label])
        if home not in best or moved[label] > moved[best[home]]:
            best[home] = label
    return kept & np.isin(part[mesh.faces[:, 0]], list(best.values()))


def _is_covered(mesh: MovedMesh, own: np.ndarray, faces: np.ndarray) -> bool:
    """Tell whether vertices lie on the surface of the faces, or inside it."""
    points = mesh.vertices_m[own[:: -(-len(own) // _MOST_POINTS)]]
    triangles = mesh.vertices_m[faces]
    return bool((_is_near(points, triangles) | (np.abs(_winding(points, triangles)) > 0.5)).mean() >= _COVERED_SHARE)


def _is_near(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    low, high = points.min(0) - _COVER_M, points.max(0) + _COVER_M
    around = triangles[((triangles.max(1) >= low) & (triangles.min(1) <= high)).all(1)]
    if not len(around):
        return np.zeros(len(points), bool)
    import torch  # only here: Blender's Python may lack it

    from ...geometry.closest_point import closest_on_triangles

    _, squared = closest_on_triangles(torch.as_tensor(points)[:, None], torch.as_tensor(around))
    return (squared.min(1).values < _COVER_M**2).numpy()


def _winding(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Compute [P] how often a surface winds around each point: 1 inside, -1 if it faces inward; 0 outside."""
    corners = triangles[None] - points[:, None, None]  # [P, F, 3, 3]
    a, b, c = np.moveaxis(corners, 2, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=-1) for corner in (a, b, c))
    volume = (a * np.cross(b, c)).sum(-1)
    angle = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.arctan2(volume, angle).sum(1) / (2 * np.pi)
