"""Forms that the pose raises under the skin of the detailed surface: knuckles, tendons, bent joints, pressed flesh.

Each is a height along the skin's normal that grows with the bend of one joint. The coarse template has none of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..surface.detail_surface import PoseForm
from .anatomy import DIGITS, FINGER_THICKNESS
from .rays import Ray, RayCoordinates, Section
from .smooth import bump, smoothstep

_REACH_MM = 5.0  # from a digit's own surface, over which its forms end


@dataclass(frozen=True)
class _DigitView:
    """All vertices in the coordinates of one digit.

    Attributes:
        first: joint of MANO at the digit's root.
        near: 1 on the digit's own surface, 0 at `_REACH_MM` from it.
        on_back, on_palm: 1 on that side of the digit.
    """

    ray: Ray
    first: int
    at: RayCoordinates
    section: Section
    near: np.ndarray
    on_back: np.ndarray
    on_palm: np.ndarray

    @classmethod
    def of(cls, order: int, ray: Ray, points: np.ndarray) -> _DigitView:
        at = ray.coordinates(points)
        section = ray.section(at.along)
        height = at.dorsal / section.depth(at.dorsal)
        return cls(
            ray=ray,
            first=1 + 3 * order,
            at=at,
            section=section,
            near=smoothstep(at.distance, _REACH_MM, 0.4 * _REACH_MM),
            on_back=smoothstep(height, 0.0, 0.55),
            on_palm=smoothstep(-height, 0.0, 0.5),
        )

    @property
    def thickness(self) -> float:
        return FINGER_THICKNESS.get(self.ray.digit, 1.0)


def pose_forms(rays: dict[str, Ray], points: np.ndarray) -> tuple[PoseForm, ...]:
    """Make the forms of the surface's vertices [N, 3] (anatomical frame, mm)."""
    forms: list[PoseForm] = []
    for order, digit in enumerate(DIGITS):
        view = _DigitView.of(order, rays[digit], points)
        forms += _thumb_forms(view) if view.ray.is_thumb else _finger_forms(view)
    return (*forms, PoseForm(0, 5, 50, _flexor_tendons(points)))


def _finger_forms(view: _DigitView) -> list[PoseForm]:
    mcp, pip, dip = view.first, view.first + 1, view.first + 2
    return [
        PoseForm(mcp, 20, 80, _knuckle(view)),
        PoseForm(mcp, 0, -18, _extensor_tendon(view)),
        PoseForm(mcp, 15, 85, _pressed_flesh(view, 0.5 * view.ray.bones.proximal + 2, 0.8)),
        PoseForm(pip, 15, 85, _bent_joint(view, view.ray.joints_along[1], 1.0)),
        PoseForm(dip, 15, 70, _bent_joint(view, view.ray.joints_along[2], 0.5)),
        PoseForm(mcp, 20, 100, _kept_volume(view, 3.0, 1.0, 3.0)),
        PoseForm(mcp, 20, 100, _flesh_below_knuckle(view)),
        PoseForm(pip, 15, 100, _kept_volume(view, view.ray.joints_along[1], 0.7, 0.1)),
        PoseForm(dip, 15, 90, _kept_volume(view, view.ray.joints_along[2], 0.35, 0.0)),
    ]


def _thumb_forms(view: _DigitView) -> list[PoseForm]:
    cmc, mcp, ip = view.first, view.first + 1, view.first + 2
    return [
        PoseForm(cmc, 0, -16, _snuffbox(view)),
        PoseForm(mcp, 10, 55, _bent_joint(view, view.ray.joints_along[1], 0.8)),
        PoseForm(ip, 10, 75, _bent_joint(view, view.ray.joints_along[2], 0.8)),
        PoseForm(mcp, 10, 90, _kept_volume(view, view.ray.joints_along[1], 1.8, 3.0)),
        PoseForm(ip, 10, 90, _kept_volume(view, view.ray.joints_along[2], 0.7, 0.1)),
    ]


def _flexor_tendons(points: np.ndarray) -> np.ndarray:
    """Raise the two tendons at the palmar side of a bent wrist, and the hollow between them."""
    d, h, r = points.T
    length = smoothstep(d, 8, -8) * smoothstep(d, -105, -45) * smoothstep(-h, 7, 14)
    apart, middle = np.interp(d, [-90, 0], [3.0, 4.6]), np.interp(d, [-90, 0], [1.0, 3.5])
    lateral = np.abs(r - middle)
    return length * (1.7 * bump(lateral - apart, 1.5) - 0.5 * bump(lateral, 1.6) - 0.5 * bump(lateral - 11, 3.0))


def _knuckle(view: _DigitView) -> np.ndarray:
    """Raise the metacarpal's head as a knob under the tendon that crosses it, and a hollow on both of its sides."""
    along, lateral, thickness = view.at.along, view.at.lateral, view.thickness
    knob = 2.8 * bump(along - 1.5, 3.8 * thickness) * bump(lateral, 3.4 * thickness)
    tendon = 0.45 * bump(along + 3, 6.5) * bump(lateral, 1.2)
    beside = bump(np.abs(lateral) - 9.2 * thickness, 2.6)
    hollow = 1.9 * beside * smoothstep(along, -18, -3) * smoothstep(along, 15, 6)
    return view.near * view.on_back * (knob + tendon - hollow)


def _extensor_tendon(view: _DigitView) -> np.ndarray:
    """Raise the tendon from the wrist to the knuckle of a lifted finger, and the hollows beside it."""
    along, lateral = view.at.along, view.at.lateral
    length = smoothstep(along, -view.ray.metacarpal - 8, -view.ray.metacarpal + 16) * smoothstep(along, 6, -5)
    ridge = 1.25 * bump(lateral, 1.5)
    hollow = 0.55 * bump(np.abs(lateral) - 7.5, 2.8)
    return view.near * view.on_back * length * (ridge - hollow)


def _bent_joint(view: _DigitView, joint_mm: float, size: float) -> np.ndarray:
    """Raise two condyles, the next bone's corner and flat sides; on the palm, flesh pressed out beside the crease."""
    along, across = view.at.along - joint_mm, np.abs(view.at.lateral) / view.section.half_breadth
    condyles, middle = 0.35 + 0.65 * bump(across - 0.42, 0.24), bump(across, 0.5)
    corners = 0.85 * bump(along + 2.4, 2.0) * condyles + 0.6 * bump(along - 5.2, 2.0) * middle
    flat = 0.35 * bump(along - 1.4, 1.6) * middle
    sides = 0.55 * smoothstep(across, 0.72, 0.95) * bump(along, 5.0) * (1 - view.on_palm)
    return size * view.near * (view.on_back * (corners - flat) - sides) + size * _pressed_flesh(view, joint_mm, 1.0)


def _pressed_flesh(view: _DigitView, crease_mm: float, size: float) -> np.ndarray:
    """Raise bulges on both sides of a palmar crease, which is drawn in."""
    along = view.at.along - crease_mm
    bulges = 0.8 * (bump(along - 4.6, 2.1) + bump(along + 4.6, 2.1))
    return size * view.near * view.on_palm * (bulges - 0.8 * bump(along, 0.9))


def _kept_volume(view: _DigitView, joint_mm: float, back_mm: float, palm_mm: float) -> np.ndarray:
    """Give back what skinning draws in at a bent joint: heads of bones and flesh beside its crease do not shrink."""
    along = view.at.along - joint_mm
    over_bones = back_mm * bump(along - 0.8, 3.8) * view.on_back
    flesh = palm_mm * bump(along, 6.0) * (1 - view.on_back)
    return view.near * (over_bones + flesh)


def _flesh_below_knuckle(view: _DigitView) -> np.ndarray:
    """Raise what a bent knuckle presses out of its crease: into the palm, and to the first phalanx's palm side."""
    along = view.at.along
    bulges = bump(along + 7.5, 5.0) + bump(along - 12.0, 4.5)
    return 2.9 * bump(view.at.lateral, 7.0 * view.thickness) * (1 - view.on_back) * bulges


def _snuffbox(view: _DigitView) -> np.ndarray:
    """Raise the thumb's two extensor tendons and the hollow between them, at its base."""
    along, lateral = view.at.along, view.at.lateral
    length = smoothstep(along, -view.ray.metacarpal - 10, -view.ray.metacarpal + 8) * smoothstep(along, 8, -10)
    base = smoothstep(along, -8, -view.ray.metacarpal + 4)
    apart = 1.6 + 4.2 * base
    ridges = 1.3 * bump(np.abs(lateral) - apart, 1.5)
    return view.near * view.on_back * length * (ridges - 1.0 * base * bump(lateral, 2.4))
