"""The exposure and white balance of each frame of a film, by what stands behind the hand.

A camera that meters by itself exposes a palm and the darker back of a hand alike, and so hides what tells a light skin
from a deep one. The backdrop does not change: what it seems to, is the camera's gain.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from ..capture.masks.mask import load_opencv
from ..capture.picture import srgb_to_linear

_SIZE_PX = 64, 36
_DARKEST, _BRIGHTEST = 0.04, 0.97  # encoded
_ROUNDS = 6
_MOST_DEVIATION = 0.12  # of the logarithm, beyond which the backdrop is not the same
_LEAST_CELLS = 40


def backdrop_sample(picture: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
    """Make a small picture [36, 64, 3] of logarithms of linear colours; NaN where the hand is, too dark or too bright.

    Args:
        picture: [H, W, 3] uint8 of the whole frame.
        hand_px: (left, top, right, bottom) of the hand in it, px.
    """
    cv2 = load_opencv()
    small = cv2.resize(picture, _SIZE_PX, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    is_useful = (small.min(-1) > _DARKEST) & (small.max(-1) < _BRIGHTEST)
    scale = np.array(_SIZE_PX) / (picture.shape[1], picture.shape[0])
    left, top, right, bottom = (np.asarray(hand_px).reshape(2, 2) * scale).ravel()
    is_useful[max(0, int(top) - 1) : int(bottom) + 2, max(0, int(left) - 1) : int(right) + 2] = False
    return np.where(is_useful[..., None], np.log(srgb_to_linear(small) + 1e-4), np.nan)


def backdrop_gains(samples: Sequence[np.ndarray]) -> np.ndarray | None:
    """Return the logarithm [K, 3] of each frame's gain, their means 0; None: the backdrop is not the same in all.

    Args:
        samples: of `backdrop_sample`.
    """
    values = np.stack([sample.reshape(-1, 3) for sample in samples]).astype(np.float64)
    is_often = np.isfinite(values[..., 0]).mean(0) > 0.5
    if is_often.sum() < _LEAST_CELLS:
        return None
    values, gains = values[:, is_often], np.zeros((len(samples), 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a frame may show none of it
        for _ in range(_ROUNDS):
            backdrop = np.nanmedian(values - gains[:, None], 0)
            gains = np.nanmedian(values - backdrop, 1)
        deviation = np.nanmedian(np.abs(values - backdrop - gains[:, None]))
    if not np.isfinite(gains).all() or deviation > _MOST_DEVIATION:
        return None
    return gains - gains.mean(0)
