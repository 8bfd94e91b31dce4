"""How sharp a film is and how it grains: an avatar that is sharper, or smoother, than the footage gives itself away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...records.frame import Frame

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
_FINE_PX, _COARSE_PX = 1.0, 4.0  # of the two bands whose quotient is sharpness
_BLURS_PX = (0.0, 0.5, 0.7, 0.9, 1.2, 1.6, 2.2, 3.0)
_INSIDE_PX = 6  # from the outline of the hand
_LEAST_PIXELS = 400
_TILE_PX = 10
_MOST_CORRELATION = 0.95
_REACH = 3.0  # deviations


class FilmTexture(NamedTuple):
    """The texture of a film.

    Attributes:
        blur_px: deviation of the blur that makes a render as soft as the footage.
        grain: [3] deviation of the noise, of 255.
        grain_px: deviation of the blur that makes white noise as coarse.
    """

    blur_px: float = 0.0
    grain: np.ndarray = np.zeros(3)
    grain_px: float = 0.0

    def softened(self, frame: Frame) -> Frame:
        """Blur a frame as the film is; its depth stays."""
        if not self.blur_px:
            return frame
        rgba = blurred(np.dstack([frame.rgb, frame.alpha]).astype(np.float32), self.blur_px)
        return Frame(rgba[..., :3], rgba[..., 3], frame.depth, is_lit=frame.is_lit)

    def grained(self, picture: np.ndarray, share: np.ndarray, seed: int) -> np.ndarray:
        """Add grain to uint8 [H, W, 3] where an avatar covers it, by shares [H, W]."""
        if not self.grain.any():
            return picture
        noise = np.random.default_rng(seed).normal(size=picture.shape).astype(np.float32)
        if self.grain_px:
            noise = blurred(noise, self.grain_px)
            noise /= max(float(noise.std()), 1e-9)
        return np.clip(np.rint(picture + noise * self.grain * share[..., None]), 0, 255).astype(np.uint8)


def grain_of(pairs: Sequence[tuple[np.ndarray, np.ndarray]], covered: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Measure grain [3], of 255, and its coarseness, px, between frames that follow each other of a resting camera.

    Args:
        pairs: of uint8 [H, W, 3].
        covered: [H, W] bool, where the hand may be.
    """
    deviations, correlations = [], []
    for (first, second), mask in zip(pairs, covered, strict=True):
        change = second.astype(np.float32) - first
        rows, columns = (size // _TILE_PX for size in mask.shape)
        shape = (rows, _TILE_PX, columns, _TILE_PX)
        tiles = change[: rows * _TILE_PX, : columns * _TILE_PX].reshape(*shape, 3)
        is_free = ~mask[: rows * _TILE_PX, : columns * _TILE_PX].reshape(shape).any((1, 3))
        if is_free.any():
            of_tiles = tiles.std((1, 3))
            deviations.append(np.median(of_tiles[is_free], 0) / np.sqrt(2))
            calm = tiles.swapaxes(1, 2)[is_free & (of_tiles.max(-1) <= np.median(of_tiles[is_free].max(-1)))]
            calm = calm - calm.mean((1, 2), keepdims=True)
            products = (calm[:, :, 1:] * calm[:, :, :-1]).mean(), (calm**2).mean()
            correlations.append(products[0] / max(products[1], 1e-9))
    if not deviations:
        return np.zeros(3), 0.0
    correlation = float(np.clip(np.median(correlations), 1e-3, _MOST_CORRELATION))
    return np.median(deviations, 0), 0.5 / np.sqrt(-np.log(correlation))


def blur_of(render: Callable[[float], np.ndarray], real: np.ndarray, is_hand: np.ndarray) -> float | None:
    """Find the blur, px, with which a render is as sharp as the film; None: too little of the hand shows.

    Args:
        render: gives the picture uint8 [H, W, 3] with the avatar blurred by so many px.
        real: the film's picture.
        is_hand: [H, W] where both show a hand.
    """
    inside = blurred(is_hand.astype(np.float32), _INSIDE_PX / 2) > 1 - 1e-3
    if inside.sum() < _LEAST_PIXELS:
        return None
    wanted = np.log(_sharpness(real, inside))
    return min(_BLURS_PX, key=lambda blur_px: abs(np.log(_sharpness(render(blur_px), inside)) - wanted))


def _sharpness(picture: np.ndarray, inside: np.ndarray) -> float:
    """Compare what is finer than one px with what is coarser, inside a mask."""
    luma = picture.astype(np.float32) @ _LUMA
    fine, coarse = blurred(luma, _FINE_PX), blurred(luma, _COARSE_PX)
    return float((luma - fine)[inside].std() / max((fine - coarse)[inside].std(), 1e-6)) + 1e-6


def blurred(values: np.ndarray, deviation_px: float) -> np.ndarray:
    """Blur [H, W] or [H, W, C] by a Gaussian, the border repeated."""
    reach = int(np.ceil(_REACH * deviation_px))
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps / deviation_px) ** 2).astype(np.float32)
    weights /= weights.sum()
    for axis in (0, 1):
        padding = [(reach, reach) if k == axis else (0, 0) for k in range(values.ndim)]
        padded, size = np.pad(values, padding, mode="edge"), values.shape[axis]
        total = np.zeros(values.shape, np.float32)
        for start, weight in enumerate(weights):
            total += weight * np.take(padded, range(start, start + size), axis)
        values = total
    return values
