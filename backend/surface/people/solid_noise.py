"""Noise and cells in space, so that skin that is drawn with them has no seams where charts of the atlas meet.

Each is a random lattice that repeats after 64 cells, turned and moved at random, so that no two are alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch.nn.functional import grid_sample

_SIZE = 64
_CORNERS = tuple((i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1))
_JITTER = 0.7  # of a cell, over which its point is spread
_HALVED = 0.55  # share of an octave in the one before
_DEVIATION = 0.17  # of one octave about its mean


class Cells(NamedTuple):
    """The nearest of scattered points.

    Attributes:
        distance: [T] to it, in cells.
        border: [T] how much farther the second nearest is, in cells: 0 on the border of two.
        chance: [T, 3] numbers in [0, 1) of its own.
    """

    distance: np.ndarray
    border: np.ndarray
    chance: np.ndarray


@dataclass(frozen=True)
class SolidNoise:
    """One source of noise.

    Attributes:
        lattice: [64, 64, 64] in [0, 1).
        points: [64, 64, 64, 3] places in each cell, in [0, 1).
        turn: [3, 3] rotation of what is smooth.
        start: [3] shift, in cells.
    """

    lattice: np.ndarray
    points: np.ndarray
    turn: np.ndarray
    start: np.ndarray

    @classmethod
    def of(cls, random: np.random.Generator) -> SolidNoise:
        """Draw one."""
        turn, _ = np.linalg.qr(random.standard_normal((3, 3)))
        return cls(
            random.random((_SIZE,) * 3, np.float32),
            random.random((*(_SIZE,) * 3, 3), np.float32),
            turn.astype(np.float32),
            random.uniform(0, _SIZE, 3).astype(np.float32),
        )

    def smooth(self, points_mm: np.ndarray, wavelength_mm: float, octaves: int = 2) -> np.ndarray:
        """Sample smooth noise [T] of mean 0 and deviation 1 whose longest waves are of this length."""
        turned, squares, share = torch.from_numpy(points_mm @ self.turn), 0.0, 1.0
        lattice = torch.from_numpy(np.pad(self.lattice, (0, 1), mode="wrap"))
        total = turned.new_zeros(len(turned))
        for octave in range(octaves):
            start = torch.from_numpy(self.start + np.float32(17.3 * octave))
            total += share * (_interpolated(lattice, turned * (2 * 2**octave / wavelength_mm) + start) - 0.5)
            squares, share = squares + share**2, share * _HALVED
        return (total / (_DEVIATION * squares**0.5)).numpy()

    def cells(self, points_mm: np.ndarray, size_mm: tuple[float, float, float]) -> Cells:
        """Find the nearest of points that are scattered so far apart along the axes."""
        at = points_mm / np.array(size_mm, np.float32) + self.start
        first = np.floor(at - np.float32(0.5)).astype(np.int32)
        nearest, second = (np.full(len(at), 9, np.float32) for _ in range(2))
        chance = np.zeros((len(at), 3), np.float32)
        for corner in _CORNERS:
            cell = first + np.array(corner, np.int32)
            own = self.points[tuple((cell & (_SIZE - 1)).T)]
            place = cell + np.float32(0.5 - _JITTER / 2) + np.float32(_JITTER) * own
            distance = np.sqrt(((at - place) ** 2).sum(1))
            is_nearest = distance < nearest
            second = np.where(is_nearest, nearest, np.minimum(second, distance))
            nearest = np.where(is_nearest, distance, nearest)
            chance[is_nearest] = own[is_nearest][:, [1, 2, 0]]
        return Cells(nearest, second - nearest, chance)


def _interpolated(lattice: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    """Interpolate a lattice [65, 65, 65], whose ends are equal, at places [T, 3]; slopes and bends are continuous."""
    first = at.floor()
    share = at - first
    share = share * share * share * (share * (share * 6 - 15) + 10)
    place = first.remainder_(_SIZE).add_(share).mul_(2 / _SIZE).sub_(1).flip(1)
    return grid_sample(lattice[None, None], place[None, None, None], mode="bilinear", align_corners=True)[0, 0, 0, 0]
