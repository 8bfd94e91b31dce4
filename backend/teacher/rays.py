"""Rays: each digit with its metacarpal is a centreline with a frame and a super-elliptic cross-section.

`along` is measured on the centreline, mm, 0 at the head of the metacarpal (the MCP joint), positive towards the tip.
`lateral` and `dorsal` are the offsets from the centreline in its own frame. Anatomical frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .anatomy import (
    BONES,
    DIGITS,
    FINGER_LAYOUTS,
    THUMB_LAYOUT,
    BoneLengths,
    FingerLayout,
    Profile,
    ThumbLayout,
    profile,
)
from .dependencies import needs
from .primitives import superellipsoid
from .smooth import unit

with needs("scipy"):
    from scipy.interpolate import PchipInterpolator
    from scipy.ndimage import gaussian_filter1d
    from scipy.spatial import KDTree

_STEP = 0.8  # mm between samples of the centreline
_EXTENSION = 14.0  # mm of straight centreline past the last bone, so that the tip's cap has a frame
_BASE_CAP = 8.0  # mm over which a ray closes behind its metacarpal's base
_EXPONENT = 2.3  # of the super-ellipse: slightly boxier than an ellipse


class RayCoordinates(NamedTuple):
    """Signed distance [N] of points to the ray's surface, and their coordinates [N] in the ray's frame, mm."""

    distance: np.ndarray
    along: np.ndarray
    lateral: np.ndarray
    dorsal: np.ndarray


class Section(NamedTuple):
    """Half-sizes [N] of the cross-section at N positions along a ray, mm."""

    half_breadth: np.ndarray
    dorsal_depth: np.ndarray
    palmar_depth: np.ndarray

    def depth(self, dorsal: np.ndarray) -> np.ndarray:
        """Choose the half-depth on the side of the ray that the points are on."""
        return np.where(dorsal > 0, self.dorsal_depth, self.palmar_depth)


@dataclass(frozen=True)
class Ray:
    """A digit of the surface.

    Attributes:
        digit: its name.
        bones: its bone lengths.
        joints: [3, 3] MANO's three joints, from the palm outwards.
        joints_along: their positions along the ray.
        metacarpal: length of the metacarpal in the layout.
        length: from the metacarpal's head to the tip.
        cap_start: position at which the round tip begins.
        samples: [P] positions along the ray of the centreline's samples.
        centre: [P, 3] the centreline.
        tangent: [P, 3] unit.
        dorsal: [P, 3] unit, orthogonal to the tangent.
        lateral: [P, 3] tangent x dorsal.
        tree: finds the nearest sample.
        stations: [K] positions of the profile.
        section_curves: interpolators of half breadth, dorsal and palmar depth.
    """

    digit: str
    bones: BoneLengths
    joints: np.ndarray
    joints_along: tuple[float, ...]
    metacarpal: float
    length: float
    cap_start: float
    samples: np.ndarray
    centre: np.ndarray
    tangent: np.ndarray
    dorsal: np.ndarray
    lateral: np.ndarray
    tree: KDTree
    stations: np.ndarray
    section_curves: tuple[PchipInterpolator, PchipInterpolator, PchipInterpolator]

    @property
    def is_thumb(self) -> bool:
        """Whether it is the thumb, whose first joint is at the base of its metacarpal and which has two phalanges."""
        return self.digit == "thumb"

    def nearest_sample(self, along: float) -> int:
        """Find the index of the centreline's sample nearest to a position along the ray."""
        return int(np.argmin(np.abs(self.samples - along)))

    def section(self, along: np.ndarray) -> Section:
        """Interpolate the cross-section at [N] positions; constant beyond the first and last station."""
        inside = np.clip(along, self.stations[0], self.stations[-1])
        return Section(*(curve(inside) for curve in self.section_curves))

    def coordinates(self, points: np.ndarray) -> RayCoordinates:
        """Compute the ray coordinates of points [N, 3]."""
        along, lateral, dorsal = self._frame_coordinates(points)
        section = self.section(along)
        radii = (
            section.half_breadth,
            section.depth(dorsal),
            np.where(along < 0, _BASE_CAP, self.length - self.cap_start),
        )
        scaled = (lateral / radii[0], dorsal / radii[1], self._past_ends(along))
        return RayCoordinates(superellipsoid(scaled, radii, _EXPONENT), along, lateral, dorsal)

    def _frame_coordinates(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        _, nearest = self.tree.query(points, workers=2)
        nearest = np.clip(nearest, 1, len(self.samples) - 2)
        ahead = ((points - self.centre[nearest]) * self.tangent[nearest]).sum(1)
        # Interpolate the frame towards the neighbouring sample on the side of the point.
        neighbour = np.where(ahead >= 0, nearest + 1, nearest - 1)
        share = np.abs(np.clip(ahead / _STEP, -1, 1))[:, None]
        centre, lateral, dorsal = (
            array[nearest] * (1 - share) + array[neighbour] * share
            for array in (self.centre, self.lateral, self.dorsal)
        )
        offsets = points - centre
        return self.samples[nearest] + ahead, (offsets * lateral).sum(1), (offsets * dorsal).sum(1)

    def _past_ends(self, along: np.ndarray) -> np.ndarray:
        """Measure distance into the cap of the tip or the base, as a share of the cap's length; 0 between the caps."""
        tip = np.where(along > self.cap_start, (along - self.cap_start) / (self.length - self.cap_start), 0)
        base = np.where(along < -self.metacarpal, (-self.metacarpal - along) / _BASE_CAP, 0)
        return np.maximum(tip, base)


class _Skeleton(NamedTuple):
    """The polyline of a ray: B + 1 points, and the dorsal direction of each of its B bones."""

    points: np.ndarray
    dorsals: np.ndarray


def build_rays() -> dict[str, Ray]:
    """Build the five rays, by name, in MANO's order of the digits."""
    return {digit: _build_ray(digit) for digit in DIGITS}


def _build_ray(digit: str) -> Ray:
    bones = BONES[digit]
    is_thumb = digit == "thumb"
    skeleton = _thumb_skeleton(THUMB_LAYOUT, bones) if is_thumb else _finger_skeleton(FINGER_LAYOUTS[digit], bones)
    metacarpal = bones.metacarpal if is_thumb else float(np.linalg.norm(skeleton.points[1] - skeleton.points[0]))
    ends = np.cumsum(bones.phalanges)
    length = float(ends[-1]) + bones.tip
    samples, centre, tangent, dorsal = _centreline(skeleton, np.r_[-metacarpal, 0, ends])
    stations = _stations(bones, metacarpal, length)
    first = 0 if is_thumb else 1
    return Ray(
        digit=digit,
        bones=bones,
        joints=skeleton.points[first : first + 3],
        joints_along=tuple(float(place) for place in np.r_[-metacarpal, 0, ends][first : first + 3]),
        metacarpal=metacarpal,
        length=length,
        cap_start=length - (8.5 if is_thumb else 6.8),
        samples=samples,
        centre=centre,
        tangent=tangent,
        dorsal=dorsal,
        lateral=np.cross(tangent, dorsal),
        tree=KDTree(centre),
        stations=stations,
        section_curves=_section_curves(stations, profile(digit)),
    )


def _finger_skeleton(layout: FingerLayout, bones: BoneLengths) -> _Skeleton:
    tilt, abduction = np.deg2rad(layout.tilt), np.deg2rad(layout.abduction)
    straight = np.array([np.cos(abduction), 0, np.sin(abduction)])
    dorsal = np.array([0, np.cos(tilt), np.sin(tilt)])
    dorsal = unit(dorsal - straight * (dorsal @ straight))
    points, dorsals = [np.array(layout.metacarpal_base), np.array(layout.mcp)], [dorsal]
    for length, flexion in zip(bones.phalanges, np.deg2rad(np.cumsum(layout.rest_flexion)), strict=True):
        points.append(points[-1] + (straight * np.cos(flexion) - dorsal * np.sin(flexion)) * length)
        dorsals.append(straight * np.sin(flexion) + dorsal * np.cos(flexion))
    return _Skeleton(np.array(points), np.array(dorsals))


def _thumb_skeleton(layout: ThumbLayout, bones: BoneLengths) -> _Skeleton:
    directions = unit(np.array(layout.directions))
    lengths = np.array((bones.metacarpal, *bones.phalanges))
    points = np.array(layout.cmc) + np.vstack([np.zeros(3), np.cumsum(directions * lengths[:, None], axis=0)])
    dorsal = np.array(layout.dorsal)
    return _Skeleton(points, unit(dorsal - directions * (directions @ dorsal)[:, None]))


def _centreline(skeleton: _Skeleton, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Place the samples along the ray; the rounded polyline, its tangent and its dorsal direction there."""
    points = skeleton.points
    last = unit(points[-1] - points[-2])
    positions = np.r_[ends, ends[-1] + _EXTENSION]
    samples = np.arange(positions[0], positions[-1], _STEP)
    centre = _interpolate(samples, positions, np.vstack([points, points[-1] + last * _EXTENSION]))
    centre = _rounded(_rounded(centre, 4.0, 8), 2.0, 4)
    tangent = unit(np.gradient(centre, axis=0))
    dorsal = _interpolate(samples, (ends[1:] + ends[:-1]) / 2, skeleton.dorsals)
    return samples, centre, tangent, unit(dorsal - tangent * (dorsal * tangent).sum(1, keepdims=True))


def _rounded(line: np.ndarray, sigma: float, keep: int) -> np.ndarray:
    """Smooth a polyline by `sigma` samples, except for its first and last `keep` samples."""
    smooth = gaussian_filter1d(line, sigma, axis=0, mode="nearest")
    return np.vstack([line[:keep], smooth[keep:-keep], line[-keep:]])


def _interpolate(x: np.ndarray, positions: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(x, positions, column) for column in values.T], 1)


def _stations(bones: BoneLengths, metacarpal: float, length: float) -> np.ndarray:
    proximal, distal = bones.proximal, bones.distal
    first = [-metacarpal, -metacarpal * 0.5, 0, 0.5 * proximal, 0.75 * proximal, proximal]
    if bones.middle == 0:
        return np.array([*first, proximal + 0.35 * distal, proximal + 0.6 * distal, length - 6.2])
    dip = proximal + bones.middle
    return np.array([*first, proximal + 0.5 * bones.middle, dip, dip + 0.45 * distal, length - 5.2])


def _section_curves(
    stations: np.ndarray, shape: Profile
) -> tuple[PchipInterpolator, PchipInterpolator, PchipInterpolator]:
    return (
        PchipInterpolator(stations, shape.half_breadth, extrapolate=False),
        PchipInterpolator(stations, shape.dorsal_depth, extrapolate=False),
        PchipInterpolator(stations, shape.palmar_depth, extrapolate=False),
    )
