"""Texture for skin that was not seen: patches of the skin that was, which overlap.

Each patch is copied from a place of the same kind, near it and turned to the same side. Patches are blended so that the
variance stays (Heitz and Neyret 2018, "High-Performance By-Example Noise using a Histogram-Preserving Blending
Operator"): the mean of two textures would be flatter than each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

_RADIUS_MM, _SPACING_MM = 16.0, 13.0  # of a patch; between the centres of patches
_OVERLAPPING = 4
_CHOICES = 60  # sources that are most alike, of which one is taken
_WHOLE = 0.8  # share of a place that must be seen
_ALIKE_MM = 60.0  # that make sources as unlike as normals at a right angle do
_SAMPLES = 4000  # sources that are looked at
_LONG_AXIS, _LEAST_ALONG = np.array([1.0, 0.05, 0.0]), 1e-6  # of the hand at rest; hardly any normal lies along it


@dataclass(frozen=True)
class RestPoints:
    """T points on the surface at rest.

    Attributes:
        position_mm: [T, 3].
        normal: [T, 3] unit.
    """

    position_mm: Float[np.ndarray, "T 3"]
    normal: Float[np.ndarray, "T 3"]

    def at(self, where: np.ndarray) -> RestPoints:
        """Select points by index or mask."""
        return RestPoints(self.position_mm[where], self.normal[where])


def patched(
    points: RestPoints, values: Float[np.ndarray, "T C"], is_seen: Bool[np.ndarray, " T"], seed: int = 0
) -> Float[np.ndarray, "T C"]:
    """Continue a texture over the surface.

    Args:
        points: on the surface.
        values: of the texture, whose mean is 0, where it is seen.
        is_seen: where it is.
        seed: of the sources that are chosen.

    Returns:
        The texture of all points: as it was where it is seen; 0 where no source is whole enough.
    """
    whole = np.where(is_seen[:, None], values, 0).astype(np.float32)
    seen, wanted = points.at(is_seen), np.flatnonzero(~is_seen)
    random = np.random.default_rng(seed)
    sources = _whole_sources(points, is_seen, random)
    if len(wanted) and len(sources):
        whole[wanted] = _blended(points.at(wanted), seen, values[is_seen], points.at(sources), random)
    return whole


def _blended(
    wanted: RestPoints, seen: RestPoints, values: np.ndarray, candidates: RestPoints, random: np.random.Generator
) -> np.ndarray:
    centres = wanted.at(_spaced(wanted.position_mm, random))
    sources = candidates.at(_like(centres, candidates, random))
    count = min(_OVERLAPPING, len(centres.normal))
    distance, patch = _nearest(KDTree(centres.position_mm), wanted.position_mm, count)
    share = (1 - distance / _RADIUS_MM).clip(0.02) ** 2
    tree, total = KDTree(seen.position_mm), np.zeros((len(wanted.normal), values.shape[1]), np.float32)
    for layer in range(count):
        at_mm = _carried(wanted.position_mm, centres.at(patch[:, layer]), sources.at(patch[:, layer]))
        total += share[:, layer, None] * values[_nearest(tree, at_mm, 1)[1][:, 0]]
    return total / np.sqrt((share**2).sum(1, keepdims=True))


def _spaced(position_mm: np.ndarray, random: np.random.Generator) -> Int[np.ndarray, " P"]:
    """Choose points of which each other one is near, and no two are nearer than a spacing."""
    tree, left, chosen = KDTree(position_mm), np.ones(len(position_mm), bool), []
    for index in random.permutation(len(position_mm)):
        if left[index]:
            chosen.append(index)
            left[tree.query_ball_point(position_mm[index], _SPACING_MM)] = False
    return np.array(chosen)


def _whole_sources(points: RestPoints, is_seen: np.ndarray, random: np.random.Generator) -> Int[np.ndarray, " P"]:
    """Choose seen points around which nearly all are seen."""
    seen = np.flatnonzero(is_seen)
    tried = random.permutation(seen)[:_SAMPLES]
    some = random.permutation(len(is_seen))[: 8 * _SAMPLES]  # a sample tells shares well enough
    tree = KDTree(points.position_mm[some])
    around = [np.asarray(tree.query_ball_point(points.position_mm[one], _RADIUS_MM), int) for one in tried]
    shares = [is_seen[some[near]].mean() if len(near) else 0.0 for near in around]
    return tried[np.array(shares) >= _WHOLE] if len(tried) else tried


def _like(centres: RestPoints, sources: RestPoints, random: np.random.Generator) -> Int[np.ndarray, " P"]:
    """Choose for each centre one of the sources that are most like it."""
    count = min(_CHOICES, len(sources.normal))
    near = _nearest(KDTree(_kind(sources)), _kind(centres), count)[1]
    return near[np.arange(len(near)), random.integers(0, count, len(near))]


def _nearest(tree: KDTree, to: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Find the nearest points to others [T, D]: distances and indices [T, count], the nearest first."""
    distance, index = tree.query(to, k=count)
    return np.reshape(distance, (len(to), count)), np.reshape(index, (len(to), count))


def _kind(points: RestPoints) -> np.ndarray:
    return np.concatenate([points.position_mm / _ALIKE_MM, points.normal], 1)


def _carried(position_mm: np.ndarray, centres: RestPoints, sources: RestPoints) -> np.ndarray:
    """Move points from around a centre each to the same place around a source."""
    from_axes, to_axes = _axes(centres.normal), _axes(sources.normal)
    inside = np.einsum("tkc,tc->tk", from_axes, position_mm - centres.position_mm)
    return sources.position_mm + np.einsum("tk,tkc->tc", inside, to_axes)


def _axes(normal: np.ndarray) -> Float[np.ndarray, "T 2 3"]:
    """Return unit tangents: as near to the hand's long axis as may be, and across."""
    along = _LONG_AXIS - (normal @ _LONG_AXIS)[:, None] * normal
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), _LEAST_ALONG)
    return np.stack([along, np.cross(normal, along)], 1)
