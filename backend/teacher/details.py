"""Palmar creases, swellings and nails of the digits, as offsets of the signed distance in mm; positive ones carve.

Folds that the pose flattens, and outlines finer than the mesh, are relief of the skin instead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .rays import Ray, RayCoordinates, Section
from .smooth import bump, smoothstep

# Palmar creases of a joint, as position and relative depth: a finger's PIP joint has two, the others one.
_FIRST_CREASES = ((-1.3, 0.55), (1.4, 0.45))
_LAST_CREASES = ((0.0, 0.7),)


class NailCoordinates(NamedTuple):
    """Coordinates [N] on a nail.

    Attributes:
        along: -1 at its root, 1 at its free end.
        across: -1 and 1 at its sides.
        rim: 1 on its outline, less inside.
    """

    along: np.ndarray
    across: np.ndarray
    rim: np.ndarray


def nail_coordinates(ray: Ray, at: RayCoordinates, section: Section) -> NailCoordinates:
    """Compute the nail coordinates of points, seen from the back of the digit."""
    length = ray.bones.distal * (0.66 if ray.is_thumb else 0.70)
    end = ray.length - 1.6
    start = end - length
    across = at.lateral / (section.half_breadth * 0.72)
    along = (at.along - (start + end) / 2) / ((end - start) / 2)
    rim = (np.abs(across) ** 3.6 + np.abs(along) ** 2.7) ** (1 / 3.1)  # straight sides, round ends
    return NailCoordinates(along, across, rim)


def detail_offset(rays: dict[str, Ray], at: dict[str, RayCoordinates]) -> np.ndarray:
    """Compute [N] offset of the hand's signed distance at points with ray coordinates `at`."""
    offset = np.zeros_like(at["index"].along)
    for digit, ray in rays.items():
        section = ray.section(at[digit].along)
        near = _nearness(at[digit], section)
        offset += near * _joint_relief(ray, at[digit], section)
        offset += near * _nail_relief(ray, at[digit], section)
    return offset


def _nearness(at: RayCoordinates, section: Section) -> np.ndarray:
    """Fade from 1 on the digit's own surface to 0 where it is 35 % of the section away from it."""
    size = np.hypot(at.lateral / section.half_breadth, at.dorsal / section.depth(at.dorsal))
    return np.clip(1 - np.abs(size - 1) / 0.35, 0, 1)


def _joint_relief(ray: Ray, at: RayCoordinates, section: Section) -> np.ndarray:
    """Sink palmar creases of the joints past the first, and swell their back."""
    palmar = smoothstep(-at.dorsal / section.palmar_depth, 0.0, 0.45)
    dorsal = smoothstep(at.dorsal / section.dorsal_depth, 0.15, 0.6)
    relief = np.zeros_like(at.along)
    for order, joint in enumerate(ray.joints_along[1:]):
        along = at.along - joint
        if ray.is_thumb and order == 0:
            relief += palmar * 0.35 * bump(along, 1.3)
            continue
        for place, depth in _FIRST_CREASES if order == 0 else _LAST_CREASES:
            relief += palmar * 0.7 * depth * bump(along - place, 0.8)
        relief -= dorsal * 0.35 * bump(along, 4.0)
    if not ray.is_thumb:
        relief += palmar * 0.5 * bump(at.along - 0.5 * ray.bones.proximal - 2, 0.9)
    return relief


def _nail_relief(ray: Ray, at: RayCoordinates, section: Section) -> np.ndarray:
    """Raise a plate, more curved across than the digit and rising towards its free end, and the flesh around it."""
    nail = nail_coordinates(ray, at, section)
    plate = smoothstep(nail.rim, 1.12, 0.92)
    rise = 0.5 * smoothstep(nail.along, -1.1, -0.3) + 0.2 * smoothstep(nail.along, 0.3, 1.0)
    curve = (1.15 if ray.is_thumb else 0.85) * np.minimum(np.abs(nail.across), 1.1) ** 2
    flesh = 0.4 * bump(nail.rim - 1.28, 0.15) * smoothstep(nail.along, 0.9, 0.5)
    return smoothstep(at.dorsal / section.dorsal_depth, 0.2, 0.45) * (plate * (curve - rise) - flesh)
