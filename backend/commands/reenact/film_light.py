"""The light of a film: how strongly each part of the sky shines, so that an avatar is shaded as the real hand is.

Frames are linear in their light. Each part of the sky is rendered alone; the weights, none negative, with which these
renders add up to what the film shows are its light. Weights are grey: the colour of light cannot be told from that of
skin, and both are the overlay's gains.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...records.frame import Frame
from ...records.light import Light, Sky, sky_directions

_SKY_SIZE = (16, 32)
_SHARPNESS = 6.0  # of a part: it shines exp(sharpness (cos angle - 1))
_GOLDEN = (1 + 5**0.5) / 2
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_SOLID = 0.98  # alpha
_MEAN_PX = 5  # side of the square whose mean is compared: the skin's own pattern is finer
_LEAST_PIXELS = 100
_RIDGE = 3e-3  # of the mean diagonal: what the film does not tell is dim
_ROUNDS, _SWEEPS, _FAR = 6, 200, 0.15  # relative residual from which a pixel counts less


class ShadedHand(NamedTuple):
    """A hand in one frame, at N pixels.

    Attributes:
        real: [N] linear luminance of the film, relative to the render's in even light.
        parts: [N, K] that of the renders in each part of the sky, likewise.
    """

    real: np.ndarray
    parts: np.ndarray


def sky_parts() -> list[Light]:
    """List the parts: light from everywhere, then from twelve directions evenly spread."""
    directions = sky_directions(*_SKY_SIZE)
    maps = [np.ones(_SKY_SIZE), *(np.exp(_SHARPNESS * (directions @ towards - 1)) for towards in _icosahedron())]
    return [Light((), Sky(np.repeat(one[..., None], 3, -1))) for one in maps]


def shaded_hand(frames: Sequence[Frame], picture: np.ndarray, shown: np.ndarray) -> ShadedHand | None:
    """Compare renders in each part of the sky with the film; None: too little of the hand shows.

    Args:
        frames: in the order of `sky_parts`.
        picture: [H, W, 3] linear.
        shown: [H, W] bool, where it shows the real hand.
    """
    is_inside = _eroded((frames[0].alpha > _SOLID) & shown)
    if is_inside.sum() < _LEAST_PIXELS:
        return None
    real, *parts = (_mean(values @ _LUMINANCE)[is_inside] for values in (picture, *(frame.rgb for frame in frames)))
    even = np.maximum(parts[0], 1e-6)
    return ShadedHand(real / even, np.stack(parts, 1) / even[:, None])


def light_of(hands: Sequence[ShadedHand]) -> Light | None:
    """Find the light that shades all hands as the film shows them, but for its brightness; None: there are none."""
    if not hands:
        return None
    real, parts = np.concatenate([one.real for one in hands]), np.concatenate([one.parts for one in hands])
    trust = np.ones(len(real))
    weights = np.r_[np.median(real), np.zeros(parts.shape[1] - 1)]
    for _ in range(_ROUNDS):
        off = np.abs(parts @ weights - real) / max(float(np.median(real)), 1e-9)
        trust = np.minimum(1, _FAR / np.maximum(off, 1e-9))
        weights = _nonnegative(parts.T @ (parts * trust[:, None]), parts.T @ (real * trust), weights)
    radiance = sum(
        weight * part.sky.radiance for weight, part in zip(weights, sky_parts(), strict=True) if part.sky is not None
    )
    return Light((), Sky(np.asarray(radiance)))


def _nonnegative(matrix: np.ndarray, right: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Minimise x.matrix.x / 2 - right.x over x >= 0, one after the other; directions are held small."""
    ridge = _RIDGE * np.trace(matrix) / len(matrix) * np.r_[0, np.ones(len(matrix) - 1)]
    matrix, x = matrix + np.diag(ridge), start.copy()
    for _ in range(_SWEEPS):
        for k in range(len(x)):
            x[k] = max(x[k] + (right[k] - matrix[k] @ x) / matrix[k, k], 0.0)
    return x


def _icosahedron() -> np.ndarray:
    """List the corners [12, 3], unit."""
    corners = [(0, a, b * _GOLDEN) for a in (-1, 1) for b in (-1, 1)]
    points = np.array([np.roll(corner, turn) for corner in corners for turn in range(3)], float)
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _mean(values: np.ndarray) -> np.ndarray:
    """Average [H, W] over squares."""
    padded = np.pad(values, _MEAN_PX // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (_MEAN_PX, _MEAN_PX))
    return windows.mean((2, 3))


def _eroded(mask: np.ndarray) -> np.ndarray:
    """Leave out pixels [H, W] whose square reaches beyond the mask."""
    padded = np.pad(mask, _MEAN_PX // 2, constant_values=False)
    return np.lib.stride_tricks.sliding_window_view(padded, (_MEAN_PX, _MEAN_PX)).all((2, 3))
