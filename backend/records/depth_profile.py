"""Where a rendered hand is opaque along the rays of an image: occlusion between hands and scene is resolved from this.

A frame is rendered as if the hand were alone. From its profile follows how much of each pixel's light comes from in
front of any depth: the scene's, or another hand's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DepthProfile:
    """R rays of N samples through the pixels of an image.

    Attributes:
        row: [H, W] int32, index of the ray through each pixel; -1: none meets the hand.
        t: [R, N] depth of each sample, m.
        dt: [R] depth step between a ray's samples, m.
        weights: [R, N] each sample's contribution to the ray's alpha.
        ray_px: side of the square of pixels that have one ray together.
    """

    row: np.ndarray
    t: np.ndarray
    dt: np.ndarray
    weights: np.ndarray
    ray_px: int = 1

    @classmethod
    def of_surface(cls, depth: np.ndarray, alpha: np.ndarray, background: float) -> DepthProfile:
        """Build the profile of a surface.

        Args:
            depth: [H, W] m, `background` beside the surface; a pixel that shows some of it is as deep as those beside.
            alpha: [H, W] share of each pixel that the surface covers.
            background: no surface is as deep.
        """
        nearest = depth
        for _ in range(_RIM_PX):
            nearest = np.where(nearest < background, nearest, _lowest_around(nearest))
        is_hit = (alpha > 0) & (nearest < background)
        row = np.full(depth.shape, -1, np.int32)
        row[is_hit] = np.arange(is_hit.sum(), dtype=np.int32)
        t, weights = (values[is_hit][:, None].astype(np.float32) for values in (nearest, alpha))
        return cls(row, t, _slant_m(nearest)[is_hit].astype(np.float32), weights)

    @property
    def alpha(self) -> np.ndarray:
        """[R] of each ray."""
        return self.weights.sum(1)

    def transmittance(self, rays: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Compute the share of light that reaches the camera past this hand.

        Args:
            rays: [K] ray indices; -1: no ray.
            depth: [K, M] depths of the light's origin, m.
        """
        through = np.ones_like(depth)
        meets = rays >= 0
        met = rays[meets]
        through[meets] -= opacity_before(depth[meets], self.t[met], self.dt[met], self.weights[met])
        return through


_RIM_PX = 3
_THIN_M, _THICK_M = 1e-4, 2e-3


def _lowest_around(depth: np.ndarray) -> np.ndarray:
    """Take the lowest [H, W] of each pixel and the eight beside it."""
    padded = np.pad(depth, 1, mode="edge")
    rows = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    return np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])


def _slant_m(depth: np.ndarray) -> np.ndarray:
    """Measure by how much [H, W] a surface's depth changes within each pixel."""
    return np.clip(sum(_step_along(depth, axis) for axis in (0, 1)), _THIN_M, _THICK_M)


def _step_along(depth: np.ndarray, axis: int) -> np.ndarray:
    """Return the smaller [H, W] of the steps to the two pixels beside each."""
    if depth.shape[axis] == 1:
        return np.zeros_like(depth)
    steps = np.abs(np.diff(depth, axis=axis))
    before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
    before[axis], after[axis] = (1, 0), (0, 1)
    return np.minimum(*(np.pad(steps, sides, constant_values=np.inf) for sides in (before, after)))


def opacity_before(depth: np.ndarray, t: np.ndarray, dt: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return [K, M] alpha of K rays in front of depths [K, M], m; the opacity of each step is spread evenly over it."""
    total = np.zeros_like(depth)
    for sample in range(t.shape[1]):  # N is small: this loop is faster than a third axis
        share = np.clip((depth - t[:, sample, None]) / dt[:, None] + 0.5, 0, 1)
        total += weights[:, sample, None] * share
    return total
