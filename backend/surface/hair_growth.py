"""The hairs on a hand and arm, grown from densities: how long they are, and which way they lie.

Regions differ in length, thickness and direction (`REGIONS`). Hairs point away from the body and towards the little
finger, a little above the skin, and curve down to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

SEED = 18
_SPREAD_RAD, _BEND_RAD = 0.35, 0.6  # deviations of directions on the skin, and of how far a hair bends aside
_DISTAL, _ULNAR = (-1.0, 0, 0), (0, 0, -1.0)  # template frame, right hand


class HairRegion(NamedTuple):
    """How hairs grow in a region.

    Attributes:
        per_m2: hairs, where they are most.
        length_m, radius_m: means, at the root.
        rise: sine of the angle at which they leave the skin.
        ulnar: how much they point to the little finger, for 1 away from the body.
    """

    per_m2: float
    length_m: float
    radius_m: float
    rise: float
    ulnar: float


REGIONS = {
    "forearm": HairRegion(12e4, 0.0085, 33e-6, 0.35, 1.0),
    "back": HairRegion(5e4, 0.005, 27e-6, 0.3, 0.8),
    "proximal": HairRegion(20e4, 0.0045, 33e-6, 0.4, 0.6),
    "middle": HairRegion(4e4, 0.003, 27e-6, 0.4, 0.6),
}


class Hairs(NamedTuple):
    """N hairs on the detail surface, in an order in which the first of them are as good a sample as all.

    A hair is the curve root + t * rise + t^2 * bend, t from 0 to 1; both are in the axes of its face: two sides from
    its first corner, and its normal in metres. So they stand on the left hand's surface, whose vertices are the same.

    Attributes:
        corners: [N, 3] vertices of the face in which its root is.
        weights: [N, 3] barycentric.
        rise, bend: [N, 3].
        radius_m: [N] at the root; towards the tip it goes to 0.
    """

    corners: np.ndarray
    weights: np.ndarray
    rise: np.ndarray
    bend: np.ndarray
    radius_m: np.ndarray

    def first(self, share: float) -> Hairs:
        """Keep a share of the hairs, evenly spread."""
        count = round(share * len(self.corners))
        return Hairs(*(values[:count] for values in self))


class HairGround(NamedTuple):
    """The detail surface of the right hand at rest.

    Attributes:
        vertices, normals: [V, 3] template metres.
        faces: [M, 3].
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray


class HairGrowth(NamedTuple):
    """Where hairs grow, and how.

    Attributes:
        share: [M, H] of each region's densest growth, on each face.
        regions: H of them, by name.
    """

    share: np.ndarray
    regions: Mapping[str, HairRegion]


def grown_hairs(skin: HairGround, growth: HairGrowth) -> Hairs:
    """Grow the hairs of a hand; they are the same each time."""
    random, corners = np.random.default_rng(SEED), skin.vertices[skin.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area_m2 = np.linalg.norm(normal, axis=-1) / 2
    parts = []
    for region, share in zip(growth.regions.values(), growth.share.T, strict=True):
        per_m2 = region.per_m2 * share.astype(np.float64)
        face = np.repeat(np.arange(len(area_m2)), random.poisson(per_m2 * area_m2))
        parts.append(_hairs_on(skin, face, region, random))
    order = random.permutation(sum(len(part.corners) for part in parts))
    return Hairs(*(np.concatenate(columns)[order] for columns in zip(*parts, strict=True)))


def _hairs_on(skin: HairGround, face: np.ndarray, region: HairRegion, random: np.random.Generator) -> Hairs:
    """Grow the hairs of a region on these faces, one on each."""
    count = len(face)
    u, v = np.sort(random.random((2, count)), 0)
    weights = np.stack([u, v - u, 1 - v], 1)
    corners = skin.faces[face]
    corner_points, normal = skin.vertices[corners], (skin.normals[corners] * weights[..., None]).sum(1)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    lie = np.array(_DISTAL) + region.ulnar * np.array(_ULNAR)
    lie = lie - normal * (normal @ lie)[:, None]
    lie = lie / np.maximum(np.linalg.norm(lie, axis=-1, keepdims=True), 1e-3)
    aside = np.cross(normal, lie)
    turn, bend = _SPREAD_RAD * random.standard_normal(count), _BEND_RAD * random.standard_normal(count)
    forth = np.cos(turn)[:, None] * lie + np.sin(turn)[:, None] * aside
    across = np.cross(normal, forth)
    length_m = region.length_m * random.uniform(0.4, 1.3, count)[:, None]
    up = region.rise * random.uniform(0.6, 1.4, count)[:, None]
    rise = length_m * (np.sqrt(1 - up**2) * forth + up * normal)
    curve = length_m * (0.5 * bend[:, None] * across - 0.75 * up * normal)
    axes = np.stack([corner_points[:, 1] - corner_points[:, 0], corner_points[:, 2] - corner_points[:, 0], normal], -1)
    rise, bend = (np.linalg.solve(axes, way[..., None])[..., 0] for way in (rise, curve))
    return Hairs(corners, weights, rise, bend, region.radius_m * random.uniform(0.7, 1.2, count))
