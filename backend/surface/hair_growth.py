"""The hairs on the built-in hand and arm: where they grow, how long, which way; made from numbers, after anatomy.

Palm, tips and thumb have none; the backs of the proximal phalanges have tufts, those of the middle ones few, the back
of the hand a thin growth towards the little finger, and the forearm the most, on its back (`REGIONS`). They point away
from the body and towards the little finger, a little above the skin, and curve down to it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

WRIST, PROXIMAL, MIDDLE = 0, (1, 4, 7, 10), (2, 5, 8, 11)
"""Bones that bear hairs, MANO's numbers; the first moves the palm and the forearm."""
SEED = 18
# Along the template's x, m, which ends at the elbow: where the forearm's hairs begin, and where they are the most.
_ARM_FROM_M, _ARM_ALL_M = 0.085, 0.125
_SPREAD_RAD, _BEND_RAD = 0.35, 0.6  # deviations of directions on the skin, and of how far a hair bends aside
_DISTAL, _DORSAL, _ULNAR = (-1.0, 0, 0), (0, 1.0, 0), (0, 0, -1.0)  # template frame, right hand


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
    """N hairs on the fine surface, in an order in which the first of them are as good a sample as all.

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
        """A share of the hairs, evenly spread."""
        count = round(share * len(self.corners))
        return Hairs(*(values[:count] for values in self))


class HairySkin(NamedTuple):
    """The fine surface of the right hand at rest.

    Attributes:
        vertices, normals: [V, 3] template metres.
        faces: [M, 3].
        bone: [M] that moves a face most.
        joints: [16, 3] MANO's.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    bone: np.ndarray
    joints: np.ndarray


def grown_hairs(skin: HairySkin) -> Hairs:
    """The hairs of a hand; the same each time."""
    random, corners = np.random.default_rng(SEED), skin.vertices[skin.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area_m2 = np.linalg.norm(normal, axis=-1) / 2
    parts = []
    for name, per_m2 in _densities(skin, corners.mean(1)).items():
        face = np.repeat(np.arange(len(area_m2)), random.poisson(per_m2 * area_m2))
        parts.append(_hairs_on(skin, face, REGIONS[name], random))
    order = random.permutation(sum(len(part.corners) for part in parts))
    return Hairs(*(np.concatenate(columns)[order] for columns in zip(*parts, strict=True)))


def _densities(skin: HairySkin, middle: np.ndarray) -> dict[str, np.ndarray]:
    """Hairs per m^2 of each face, region by region."""
    normal = skin.normals[skin.faces].mean(1)
    dorsal = normal @ np.array(_DORSAL)
    on_palm = skin.bone == WRIST
    arm = _step(middle[:, 0], _ARM_FROM_M, _ARM_ALL_M)
    back = _step(dorsal, 0.5, 0.9) * _step(-middle[:, 2], -0.015, 0.03) * (1 - arm)
    found = {
        "forearm": on_palm * arm * (0.15 + 0.85 * _step(dorsal, -0.3, 0.5)),
        "back": on_palm * back * _step(middle[:, 0], 0.01, 0.03),
        "proximal": sum(_on_phalanx(skin, bone, middle, normal) for bone in PROXIMAL),
        "middle": sum(_on_phalanx(skin, bone, middle, normal) for bone in MIDDLE),
    }
    return {name: REGIONS[name].per_m2 * share for name, share in found.items()}


def _on_phalanx(skin: HairySkin, bone: int, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The share of the most hairs that grow on each face: on the back of a phalanx, between its joints."""
    along = skin.joints[bone + 1] - skin.joints[bone]
    length_m = np.linalg.norm(along)
    along = along / length_m
    dorsal = np.array(_DORSAL) - along * along[1]
    place = (middle - skin.joints[bone]) @ along / length_m
    between = _step(place, 0.2, 0.4) * _step(-place, -0.9, -0.7)
    return (skin.bone == bone) * between * _step(normal @ (dorsal / np.linalg.norm(dorsal)), 0.55, 0.9)


def _hairs_on(skin: HairySkin, face: np.ndarray, region: HairRegion, random: np.random.Generator) -> Hairs:
    """Hairs of a region on these faces, one on each."""
    count = len(face)
    u, v = np.sort(random.random((2, count)), 0)
    weights = np.stack([u, v - u, 1 - v], 1)
    corners = skin.faces[face]
    places, normal = skin.vertices[corners], (skin.normals[corners] * weights[..., None]).sum(1)
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
    axes = np.stack([places[:, 1] - places[:, 0], places[:, 2] - places[:, 0], normal], -1)
    rise, bend = (np.linalg.solve(axes, way[..., None])[..., 0] for way in (rise, curve))
    return Hairs(corners, weights, rise, bend, region.radius_m * random.uniform(0.7, 1.2, count))


def _step(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """From 0 at `low` to 1 at `high`, smoothly."""
    share = np.clip((values - low) / (high - low), 0, 1)
    return share * share * (3 - 2 * share)
