"""Skin masks of the rest surface, from the ray coordinates of `rays.py`.

All are [N], in [0, 1] unless stated otherwise:

- `palm`: palmar side; `arm`: the forearm, growing from the wrist; `tip`: fingertips; `red`: redness; `vein`, `crease`,
  `knuck`: veins, creases, knuckles.
- `nail`: the plate; `nailrim`: 1 on its outline, less inside, at most 3; `naily`: coordinate along it, 0 at its root
  and 1 at its free end, which exceeds this range outside the nail; `lunula`: its half-moon.
- `jid`: the joint of the nearest fold, 0 for none; `tfold`: signed mm along the digit from that joint, more at the
  sides of its back, so that folds lie in an oval; `foldd`, `foldp`: strength of its dorsal or palmar fold.
- `ridge`: mm across the ridges of the palmar skin, which are its level lines: arches around each fingertip's pad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .anatomy import DIGITS, FINGERS
from .details import nail_coordinates
from .frames import swap_distal
from .palm_lines import CREASES, INNER_VEINS, VEINS, line_mask
from .rays import Ray, RayCoordinates, Section
from .smooth import bump, smoothstep

MASK_NAMES = (
    "palm", "nail", "nailrim", "naily", "lunula", "tfold", "foldd", "foldp", "ridge", "red", "tip", "vein", "crease",
    "knuck", "arm", "jid",
)  # fmt: skip

Masks = dict[str, np.ndarray]

# Red areas of the palm: centre, radii (mm) and width of the falloff.
_THENAR = (np.array([34, -24, 26]), np.array([26, 14, 16]), 0.7)
_HYPOTHENAR = (np.array([40, -16, -28]), np.array([30, 14, 14]), 0.7)
# Of the half-moon, by digit.
_LUNULA = {"thumb": 1.0, "index": 0.6, "middle": 0.55, "ring": 0.35, "pinky": 0.15}
_RIM_FAR = 3.0
_RIM_BESIDE, _SKIN_BESIDE_TO = 0.5, -0.3  # how much farther skin is that turns away beside the nail, at which height
_FOREARM_PALM = 0.35  # share of the palm in the skin beyond the wrist
_INNER_VEIN = 0.55  # strength, of those on the back
_ARM_MM = (24.0, 90.0)  # beyond the wrist
_PAD_FROM_TIP = 10.0  # mm: centre of a fingertip's pad
_PADS = (np.array([82, -14, 0]), np.array([12, 12, 38]), 0.6)


class _Digit(NamedTuple):
    """All vertices in the coordinates of one digit."""

    order: int
    ray: Ray
    at: RayCoordinates
    section: Section
    height: np.ndarray
    """Dorsal offset relative to the section's half-depth."""
    is_nearest: np.ndarray
    is_own: np.ndarray
    """Nearest to this digit, on its surface and beyond its root."""


def skin_masks(rays: dict[str, Ray], vertices: np.ndarray, normals: np.ndarray) -> Masks:
    """Compute masks of vertices [N, 3] (build frame, mm) with unit normals [N, 3]."""
    points = swap_distal(vertices)
    at = {digit: rays[digit].coordinates(points) for digit in DIGITS}
    nearest = np.stack([at[digit].distance for digit in DIGITS], 1).argmin(1)
    masks = {name: np.zeros(len(points)) for name in MASK_NAMES}
    hand = _FOREARM_PALM + (1 - _FOREARM_PALM) * smoothstep(points[:, 0], -26, 4)
    masks["palm"] = hand * (1 - smoothstep(normals[:, 1], -0.35, 0.35))
    masks["arm"] = smoothstep(-points[:, 0], *_ARM_MM)
    masks["nailrim"][:] = _RIM_FAR
    masks["ridge"] = np.hypot(points[:, 0] - 40, points[:, 2] - 45)
    for order, digit in enumerate(DIGITS):
        view = _digit_view(order, rays[digit], at[digit], nearest)
        _add_palm_side(masks, view)
        _add_nail(masks, view)
        _add_folds(masks, view)
        _add_ridges(masks, view)
        _add_tip(masks, view)
        _add_digit_creases(masks, view)
    _add_lines(masks, points, normals, at)
    _add_redness(masks, points)
    return masks


def _digit_view(order: int, ray: Ray, at: RayCoordinates, nearest: np.ndarray) -> _Digit:
    section = ray.section(at.along)
    is_nearest = nearest == order
    is_own = is_nearest & (at.distance < 2.5) & (at.along > (-12 if ray.is_thumb else 8))
    return _Digit(order, ray, at, section, at.dorsal / section.depth(at.dorsal), is_nearest, is_own)


def _add_palm_side(masks: Masks, view: _Digit) -> None:
    """Let a digit's own frame determine the palmar side instead of the normal."""
    palmar = 1 - smoothstep(view.height, -0.40, 0.35)
    share = smoothstep(view.at.along, -14, 2) if view.ray.is_thumb else smoothstep(view.at.along, 8, 20)
    masks["palm"] = np.where(view.is_own, masks["palm"] * (1 - share) + palmar * share, masks["palm"])


def _add_nail(masks: Masks, view: _Digit) -> None:
    nail = nail_coordinates(view.ray, view.at, view.section)
    on_back = view.is_own & (view.at.dorsal > 0)
    _raise_to(masks, "nail", on_back, 1 - smoothstep(nail.rim, 0.96, 1.06))
    # The plate ends within an edge of the surface; the skin's step beside it would be a ledge there.
    is_skin = smoothstep(nail.rim, 1.06, 1.2)
    plate_end, skin_end = smoothstep(view.height, 0.45, 0.1), smoothstep(view.height, 0.7, _SKIN_BESIDE_TO)
    rim = nail.rim + (1 - is_skin) * _RIM_FAR * plate_end + is_skin * _RIM_BESIDE * skin_end
    masks["nailrim"] = np.where(view.is_own, np.minimum(rim, masks["nailrim"]), masks["nailrim"])
    masks["naily"] = np.where(view.is_own, (nail.along + 1) / 2, masks["naily"])
    half_moon = smoothstep(nail.along + 0.3 * nail.across**2, -0.45, -0.6) * smoothstep(nail.rim, 1.1, 1.0)
    _raise_to(masks, "lunula", on_back, half_moon * _LUNULA[view.ray.digit])


def _add_folds(masks: Masks, view: _Digit) -> None:
    for order, joint in enumerate(view.ray.joints_along):
        if view.ray.is_thumb and order == 0:
            continue  # the thumb's first joint is in the palm and has no fold
        along = view.at.along - joint
        near = view.is_nearest & (view.at.distance < 4) & (np.abs(along) < 13)
        dorsal, palmar = _fold_strengths(view, along, order)
        is_stronger = np.maximum(dorsal, palmar) > np.maximum(masks["foldd"], masks["foldp"])
        taken = near & (is_stronger | (masks["jid"] == 0))
        bow = 1 + np.where(view.height > 0, 0.45, 0) * (view.at.lateral / view.section.half_breadth) ** 2
        masks["tfold"][taken] = (along * bow)[taken]
        masks["jid"][taken] = 1 + 3 * view.order + order
        _raise_to(masks, "foldd", near, dorsal)
        _raise_to(masks, "foldp", near, palmar)
        is_first = order == (1 if view.ray.is_thumb else 0)
        _raise_to(masks, "knuck", near, smoothstep(view.height, 0.0, 0.8) * bump(along, 5.5) * (0.7 if is_first else 1))


def _fold_strengths(view: _Digit, along: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute dorsal and palmar fold [N] of a joint."""
    if view.ray.is_thumb:
        width = 6.0 if order == 1 else 4.0
    elif order == 0:  # an MCP joint has a dorsal fold only
        return 0.28 * smoothstep(view.height, 0.2, 0.7) * bump(along, 6.5), np.zeros_like(along)
    else:
        width = 6.0 if order == 1 else 4.0
    dorsal = smoothstep(view.height, 0.05, 0.6) * bump(along, width * 0.72)
    return dorsal, smoothstep(-view.height, -0.1, 0.5) * bump(along, 1.8)


def _add_ridges(masks: Masks, view: _Digit) -> None:
    arches = np.hypot(view.at.along - (view.ray.length - _PAD_FROM_TIP), view.at.lateral)
    masks["ridge"] = np.where(view.is_own, arches, masks["ridge"])


def _add_tip(masks: Masks, view: _Digit) -> None:
    start, end = view.ray.joints_along[2] - 2, view.ray.length - 3
    _raise_to(masks, "tip", view.is_own, smoothstep(view.at.along, start, end))


def _add_digit_creases(masks: Masks, view: _Digit) -> None:
    """Draw two palmar creases at every joint past the first, and two on a finger's proximal phalanx."""
    palmar = smoothstep(-view.height, -0.1, 0.4)
    along, lateral = view.at.along, view.at.lateral
    if not view.ray.is_thumb:
        middle = along - 0.5 * view.ray.bones.proximal
        pair = np.maximum(bump(middle - 2, 0.6), 0.5 * bump(middle - 4.2, 0.5))
        _raise_to(masks, "crease", view.is_own, palmar * pair * 0.75)
    for order, joint in enumerate(view.ray.joints_along[1:]):
        if view.ray.is_thumb and order == 0:
            continue
        first = bump(along - joint + 1.2 + 0.25 * np.sin(lateral * 0.9), 0.5)
        second = bump(along - joint - 1.5 - 0.35 * np.sin(lateral * 0.7 + 1), 0.5) * 0.6
        strength = 0.9 if order == 0 else 0.75
        _raise_to(masks, "crease", view.is_own, palmar * np.maximum(first, second) * strength)


def _add_lines(masks: Masks, points: np.ndarray, normals: np.ndarray, at: dict[str, RayCoordinates]) -> None:
    """Draw the creases of the palm and the veins of the back, which end before the digits."""
    reach = [np.where(at[finger].distance < 3, at[finger].along, -99) for finger in FINGERS]
    is_off_fingers = np.max(reach, 0) <= 12
    is_off_thumb = ~((at["thumb"].distance < 2.5) & (at["thumb"].along > -4))
    faces_down = smoothstep(-normals[:, 1], 0.1, 0.5) * (points[:, 0] < 98)
    for line in CREASES:
        _raise_to(masks, "crease", is_off_fingers & is_off_thumb, faces_down * line_mask(line, points))
    faces_up = smoothstep(normals[:, 1], 0.15, 0.5)
    for line in VEINS:
        _raise_to(masks, "vein", is_off_fingers, faces_up * line_mask(line, points))
    for line in INNER_VEINS:
        _raise_to(masks, "vein", is_off_fingers, _INNER_VEIN * faces_down * line_mask(line, points))


def _add_redness(masks: Masks, points: np.ndarray) -> None:
    thenar, hypothenar, pads = (
        bump(np.linalg.norm((points - centre) / radii, axis=1), width)
        for centre, radii, width in (_THENAR, _HYPOTHENAR, _PADS)
    )
    palm = 0.55 * thenar + 0.6 * hypothenar + 0.5 * pads
    digits = 0.75 * masks["tip"] * (0.4 + 0.6 * masks["palm"]) + 0.7 * masks["knuck"]
    masks["red"] = np.clip(digits + masks["palm"] * palm, 0, 1)


def _raise_to(masks: Masks, name: str, where: np.ndarray, value: np.ndarray) -> None:
    masks[name] = np.maximum(masks[name], np.where(where, value, 0))
