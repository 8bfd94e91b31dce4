"""How deep the parts of a posed hand pass through each other, and the nearest pose in which they only touch.

Parts are the five digits and the palm. A vertex is inside another part if the winding number of that part's surface
about it exceeds one half (Jacobson et al. 2013, "Robust Inside-Outside Segmentation"), also where the part is open.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
import trimesh
from scipy.spatial import KDTree

from .gestures import FingerAxes, theta_of
from .joint_limits import FREE, LIMITS
from .lbs import SkinTensors, pose_hand
from .model import HandModel

_NEIGHBOURS_M = 0.012  # vertices nearer to a part at rest belong to the fold between the two
_TOUCH_M = 0.0005  # flesh yields a little where parts touch
_STEPS, _DIFFERENCE_DEG = 24, 0.1
_LARGEST_STEP_DEG = 4.0
# Degrees by which the free angles move as readily as each other.
_FINGER_EASE_DEG = (8.0, 6.0, 4.0, 8.0)
_THUMB_EASE_DEG = (10.0, 10.0, 8.0, 8.0, 8.0)
_STIFFNESS_M = 0.0004  # of all angles together, against the depth of one vertex


@dataclass(frozen=True)
class Contacts:
    """P vertices inside another part of the hand.

    Attributes:
        vertices: [P] which.
        faces: [P, 3] vertices of the nearest triangle of the part that each is in.
        weights: [P, 3] barycentric coordinates of the nearest point on it.
        out: [P, 3] unit vectors to the nearest point.
        depth_m: [P] distance to it.
    """

    vertices: np.ndarray
    faces: np.ndarray
    weights: np.ndarray
    out: np.ndarray
    depth_m: np.ndarray

    @property
    def deepest_m(self) -> float:
        """The largest depth; 0 if nothing touches."""
        return float(self.depth_m.max(initial=0.0))

    def gaps_m(self, positions: np.ndarray) -> np.ndarray:
        """Compute [..., P] signed distances along `out` of other positions [..., V, 3]: negative inside."""
        across = positions[..., self.vertices, :] - np.einsum(
            "pk,...pkc->...pc", self.weights, positions[..., self.faces, :]
        )
        return np.einsum("...pc,pc->...p", across, self.out)


class HandParts:
    """The digits and the palm of a hand model, for the same questions about many poses."""

    def __init__(self, model: HandModel):
        """Split the model by its largest skinning weights."""
        self._model = model
        joint = model.lbs_weights.argmax(1)
        self._part = np.where(joint == 0, 5, (joint - 1) // 3)  # [V]

    def contacts(self, positions: np.ndarray) -> Contacts:
        """Find vertices of posed positions [V, 3] m inside another part."""
        found = [self._inside(positions, part) for part in range(6)]
        vertices, triangles = (np.concatenate(rows) for rows in zip(*found, strict=True))
        corners = positions[triangles]
        nearest = trimesh.triangles.closest_point(corners, positions[vertices]) if len(vertices) else corners[:, 0]
        weights = trimesh.triangles.points_to_barycentric(corners, nearest) if len(vertices) else corners[:, 0]
        away = nearest - positions[vertices]
        depth = np.linalg.norm(away, axis=1)
        return Contacts(vertices, triangles, weights, away / np.maximum(depth, 1e-9)[:, None], depth)

    def _inside(self, positions: np.ndarray, part: int) -> tuple[np.ndarray, np.ndarray]:
        """Find vertices [P] of other parts in this one, and the part's triangles [P, 3] nearest to them."""
        triangles, far = self._surfaces[part]
        corners = positions[triangles]
        low, high = corners.min((0, 1)), corners.max((0, 1))
        near = far[((positions[far] > low) & (positions[far] < high)).all(1)]
        near = near[_lies_behind(positions[near], corners)]
        inside = near[_winding(positions[near], corners) > 0.5]
        nearest = np.empty(len(inside), np.int64)
        for row, point in enumerate(positions[inside]):
            on_each = trimesh.triangles.closest_point(corners, np.broadcast_to(point, (len(corners), 3)))
            nearest[row] = np.linalg.norm(on_each - point, axis=1).argmin()
        return inside, triangles[nearest]

    @cached_property
    def _surfaces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each part: its triangles, and the vertices of others that are not its neighbours."""
        rest, faces = self._model.v_template, self._model.f
        surfaces = []
        for part in range(6):
            own = rest[self._part == part]
            others = np.flatnonzero(self._part != part)
            gap = np.linalg.norm(rest[others, None] - own, axis=-1).min(1)
            surfaces.append((faces[(self._part[faces] == part).all(1)], others[gap > _NEIGHBOURS_M]))
        return surfaces


def relieved_angles(parts: HandParts, model: HandModel, angles_deg: np.ndarray, axes: FingerAxes) -> np.ndarray:
    """Relieve joint angles [15, 3] deg: find near ones in which parts of the mean hand touch without passing through.

    Gauss-Newton steps on the depths, held back by the change of angles; the fold at a digit's root does not count. The
    best step is returned, which is never deeper than the angles given. Free angles stay within their limits, or as
    far beyond them as they are given.
    """
    given = angles_deg.ravel()[FREE]
    limits = np.rad2deg(LIMITS)
    lowest, highest = np.minimum(limits[:, 0], given) - given, np.maximum(limits[:, 1], given) - given
    stiffness = np.diag(_STIFFNESS_M / np.array([*_FINGER_EASE_DEG * 4, *_THUMB_EASE_DEG]))
    skin = SkinTensors.of(model, dtype=torch.float64)

    def positions(changes: np.ndarray) -> np.ndarray:
        flat = np.tile(angles_deg.ravel(), (len(changes), 1))
        flat[:, FREE] += changes
        theta = theta_of(flat.reshape(-1, 15, 3), axes)
        none = torch.zeros(len(flat), 10, dtype=torch.float64)
        return pose_hand(skin, torch.as_tensor(theta), none, none[:, :3]).vertices.numpy()

    change, best, least_m = np.zeros(len(FREE)), np.zeros(len(FREE)), np.inf
    for _ in range(_STEPS):
        contacts = parts.contacts(positions(change[None])[0])
        if contacts.deepest_m < least_m:
            best, least_m = change, contacts.deepest_m
        if least_m <= _TOUCH_M:
            break
        moved = contacts.gaps_m(positions(change + _DIFFERENCE_DEG * np.eye(len(FREE))))
        slope = (moved.T + contacts.depth_m[:, None]) / _DIFFERENCE_DEG  # [P, free] m per degree
        rows = np.vstack([slope, stiffness])
        wanted = np.concatenate([contacts.depth_m - _TOUCH_M / 2, -stiffness @ change])
        step = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        change = np.clip(change + step * min(1.0, _LARGEST_STEP_DEG / np.abs(step).max()), lowest, highest)
    relieved = angles_deg.ravel().copy()
    relieved[FREE] += best
    return relieved.reshape(15, 3)


def _lies_behind(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return [N] whether points lie behind the nearest of some triangles, by their centres: quick, and too often."""
    if not len(points):
        return np.zeros(0, bool)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centres = corners.mean(1)
    _, nearest = KDTree(centres).query(points, k=3)
    across = np.einsum("nkc,nkc->nk", points[:, None] - centres[nearest], normals[nearest])
    return (across < 0).any(1)


def _winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Compute [N] winding numbers of triangles [F, 3, 3] about points [N, 3] (Van Oosterom and Strackee 1983)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    above = np.einsum("nfc,nfc->nf", a, np.cross(b, c))
    below = la * lb * lc + sum(
        np.einsum("nfc,nfc->nf", one, other) * length for one, other, length in ((a, b, lc), (b, c, la), (c, a, lb))
    )
    return np.arctan2(above, below).sum(1) / (2 * np.pi)
