"""Turned square regions of a picture: where a hand is looked for, and the crop that a network sees.

Pictures are uint8 [H, W, 3]; positions are px, the first pixel's centre at (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, pi, sin

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, UInt8
from torch import Tensor

_WRIST, _KNUCKLES = 0, (5, 9, 13)
_MIDDLE_SHARE = 0.5  # of the middle knuckle in the point that a hand points to; its neighbours share the rest
_STEADY = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)  # wrist, palm and lower finger joints: tips move too much
_POINTS_PER_PX = 32
_HAND_SCALE, _HAND_SHIFT = 2.0, -0.1  # of the next frame's region against these points' extent


@dataclass(frozen=True)
class HandRegion:
    """A square in a picture.

    Attributes:
        centre_px: [2].
        side_px: its side.
        angle_rad: by which it is turned clockwise; its upper side is where the fingers point.
    """

    centre_px: np.ndarray
    side_px: float
    angle_rad: float

    @property
    def rotation(self) -> np.ndarray:
        """[2, 2] from the square's axes to the picture's."""
        c, s = cos(self.angle_rad), sin(self.angle_rad)
        return np.array([[c, -s], [s, c]])

    def to_px(self, shares: np.ndarray) -> np.ndarray:
        """Convert shares [..., 2] of the square's sides, from its upper left corner, to px in the picture."""
        return self.centre_px + (shares - 0.5) * self.side_px @ self.rotation.T

    def overlap(self, other: HandRegion) -> float:
        """Compute the intersection over union of both squares, as if neither was turned."""
        low = np.maximum(self.centre_px - self.side_px / 2, other.centre_px - other.side_px / 2)
        high = np.minimum(self.centre_px + self.side_px / 2, other.centre_px + other.side_px / 2)
        shared = float(np.prod(np.maximum(high - low, 0)))
        return shared / (self.side_px**2 + other.side_px**2 - shared)


def region_of_extent(
    centre_px: np.ndarray, extent_px: np.ndarray, angle_rad: float, scale: float, shift: float
) -> HandRegion:
    """Make the square about a box [2] that is turned by an angle, scaled, and moved by a share of its height."""
    along = np.array([-sin(angle_rad), cos(angle_rad)])
    return HandRegion(centre_px + shift * extent_px[1] * along, scale * float(extent_px.max()), angle_rad)


def region_of_landmarks(px: np.ndarray) -> HandRegion:
    """Predict the region in which to look for the hand of landmarks [21, 2] in the next frame."""
    index, middle, ring = px[list(_KNUCKLES)]
    ahead = _MIDDLE_SHARE * middle + (1 - _MIDDLE_SHARE) * (index + ring) / 2
    angle = upward_angle(px[_WRIST], ahead)
    points = px[list(_STEADY)]
    turn = HandRegion(np.zeros(2), 1.0, angle).rotation
    low, high = (points @ turn).min(0), (points @ turn).max(0)
    return region_of_extent(turn @ ((low + high) / 2), high - low, angle, _HAND_SCALE, _HAND_SHIFT)


def upward_angle(start_px: np.ndarray, end_px: np.ndarray) -> float:
    """Compute the angle of a square whose upper side lies in the direction from start to end; -pi..pi."""
    x, y = end_px - start_px
    angle = pi / 2 - atan2(-y, x)
    return (angle + pi) % (2 * pi) - pi


def cropped(
    picture: UInt8[np.ndarray, "H W 3"], region: HandRegion, side_px: int, repeats_edge: bool
) -> Float[Tensor, "1 3 S S"]:
    """Crop a region to a network's input in [0, 1]; beyond the picture it is black, or repeats the picture's edge.

    The networks were trained on crops whose pixel (i, j) is taken at its upper left corner, from pictures whose centres
    of pixels are whole numbers, interpolated linearly at positions rounded to 1/32 px. Here too: what they answer moves
    by whole pixels with the second digit of what they see.
    """
    patch, corner = _patch(picture, region)
    points = torch.from_numpy(_points(region, side_px) - corner)
    half = torch.tensor(patch.shape[:0:-1]).sub(1).clamp(min=1) / 2  # of width and height
    grid = (points / half - 1).float()[None]
    edge = "border" if repeats_edge else "zeros"
    crop = F.grid_sample(patch[None].float(), grid, padding_mode=edge, align_corners=True)
    return crop.round_() / 255


def _points(region: HandRegion, side_px: int) -> np.ndarray:
    """Compute the position [S, S, 2] in the picture of each pixel of the crop."""
    steps = np.arange(side_px) * (region.side_px / side_px)
    right, down = (steps[:, None] * axis for axis in region.rotation.T)
    points = region.to_px(np.zeros(2)) + right + down[:, None]
    return np.rint(points * _POINTS_PER_PX) / _POINTS_PER_PX


def _patch(picture: np.ndarray, region: HandRegion) -> tuple[Tensor, np.ndarray]:
    """Cut out the part [3, h, w] of the picture that holds the region, which alone is converted, and its corner."""
    corners = region.to_px(np.array([[0.0, 0], [0, 1], [1, 0], [1, 1]]))
    most = np.array(picture.shape[1::-1]) - 1
    low = np.clip(np.floor(corners.min(0)).astype(int) - 1, 0, most)
    high = np.clip(np.ceil(corners.max(0)).astype(int) + 1, 0, most)
    part = picture[low[1] : high[1] + 1, low[0] : high[0] + 1]
    return torch.from_numpy(np.array(part)).permute(2, 0, 1), low
