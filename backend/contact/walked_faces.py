"""A walk over a mesh's faces from neighbour to neighbour: which parts they form, and how each face is wound.

All parts are walked at once, a ring of faces at a time, so that numpy's work is that of the rings.
"""

from __future__ import annotations

import numpy as np


def walked_faces(first: np.ndarray, second: np.ndarray, alike: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Walk over neighbours.

    Args:
        first: [E] faces that share an edge with another.
        second: [E] the other ones.
        alike: [E] whether both are wound alike.
        count: of faces, F.

    Returns:
        The connected part of each face [F], by its first face in rising order, and whether it is wound otherwise than
        that first one [F] bool.
    """
    part = _parts(first, second, count)
    roots, label = np.unique(part, return_inverse=True)
    flips, is_walked = np.zeros(count, bool), np.zeros(count, bool)
    start, other, change = _neighbours(first, second, alike, count)
    ring = roots
    is_walked[ring] = True
    while len(ring):
        begin, many = start[ring], start[ring + 1] - start[ring]
        before = np.repeat(np.arange(len(ring)), many)
        edge = np.repeat(begin - np.cumsum(many) + many, many) + np.arange(int(many.sum()))
        found, flipped = other[edge], flips[ring][before] ^ change[edge]
        new = ~is_walked[found]
        found, at = np.unique(found[new], return_index=True)
        flips[found] = flipped[new][at]
        is_walked[found] = True
        ring = found
    return label.reshape(-1), flips


def _parts(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Find the smallest face [F] of each face's part: neighbours take the smaller one's, and what that one has."""
    part = np.arange(count)
    while True:
        least = np.minimum(part[first], part[second])
        after = part.copy()
        np.minimum.at(after, part[first], least)
        np.minimum.at(after, part[second], least)
        after = after[after]
        if np.array_equal(after, part):
            return part
        part = after


def _neighbours(
    first: np.ndarray, second: np.ndarray, alike: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """List the neighbours of face f at start[f] to start[f + 1], and whether each is wound otherwise."""
    face, other = np.concatenate([first, second]), np.concatenate([second, first])
    order = np.argsort(face, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(face, minlength=count))])
    return start, other[order], ~np.tile(alike, 2)[order]
