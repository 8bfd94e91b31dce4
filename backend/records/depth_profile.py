"""Where along its rays a rendered hand is opaque: occlusion between hands and scene is resolved from this.

A frame is rendered as if the hand were alone. From its profile follows how much of each ray's light comes from in front
of any depth: the scene's, which may differ between the four pixels of a ray, or another hand's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DepthProfile:
    """R rays of N samples on an image's low-resolution grid.

    Attributes:
        row: [h, w] int32, index of the ray through each 2 x 2 pixels; -1: the ray misses the hand.
        t: [R, N] depth of each sample, m.
        dt: [R] depth step between a ray's samples, m.
        weights: [R, N] each sample's contribution to the ray's alpha.
    """

    row: np.ndarray
    t: np.ndarray
    dt: np.ndarray
    weights: np.ndarray

    @classmethod
    def of_depth(cls, depth: np.ndarray, background: float) -> DepthProfile:
        """The profile of an opaque surface of this depth [H, W], m; no surface at `background` or beyond."""
        nearest = four_depths(depth).min(-1)
        is_hit = nearest < background
        row = np.where(is_hit, np.cumsum(is_hit).reshape(is_hit.shape) - 1, -1).astype(np.int32)
        t = nearest[is_hit][:, None].astype(np.float32)
        return cls(row, t, np.full(len(t), _THIN_M, np.float32), np.ones_like(t))

    @property
    def alpha(self) -> np.ndarray:
        """[R] of each ray."""
        return self.weights.sum(1)

    def transmittance(self, rays: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The share of light that reaches the camera past this hand.

        Args:
            rays: [K] ray indices; -1: no ray.
            depth: [K, M] depths of the light's origin, m.
        """
        through = np.ones_like(depth)
        meets = rays >= 0
        met = rays[meets]
        through[meets] -= opacity_before(depth[meets], self.t[met], self.dt[met], self.weights[met])
        return through


_THIN_M = 1e-4


def opacity_before(depth: np.ndarray, t: np.ndarray, dt: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """[K, M] alpha of K rays in front of depths [K, M], m; the opacity of each step is spread evenly over it."""
    total = np.zeros_like(depth)
    for sample in range(t.shape[1]):  # N is small: this loop is faster than a third axis
        share = np.clip((depth - t[:, sample, None]) / dt[:, None] + 0.5, 0, 1)
        total += weights[:, sample, None] * share
    return total


def four_depths(depth: np.ndarray) -> np.ndarray:
    """[h, w, 4] the depths of each low-resolution pixel's 2 x 2 pixels."""
    height, width = depth.shape
    even = np.pad(depth, ((0, height % 2), (0, width % 2)), mode="edge")
    blocks = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2)
    return np.ascontiguousarray(blocks.transpose(0, 2, 1, 3)).reshape(*blocks.shape[::2], 4)
