"""The exposure and white balance of a film's frames, by what stands behind the hand.

A camera that meters by itself exposes a palm and the darker back of a hand alike, and so hides what tells a light skin
from a deep one. The backdrop does not change: what it seems to, is the camera's gain. Two things would hide that gain.
The camera sways in the hand, so that frames are laid over one another first. And before a deep skin much of a light
backdrop is clipped: what it shows there is no value, but a least one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..capture.masks.mask import load_opencv
from ..capture.picture import srgb_to_linear

_SAMPLE_PX = 64, 36
_SWAY_CELLS, _STEP_CELLS = (6, 8), 2  # rows and columns to each side, and between those that are tried first
_DARKEST, _BRIGHTEST = 0.04, 0.95  # encoded
_ADDED = 1e-4  # to linear values, before their logarithm
_ROUNDS = 4
_OUTLIER = 0.3  # of the logarithm
_MOST_DEVIATION = 0.12  # of the logarithm, beyond which the backdrop is not the same
_LEAST_CELLS = 40
_CENSORED_ROUNDS = 4
_EVERY = 3  # columns of which one is compared while the shift is looked for


class _Laid(NamedTuple):
    """How a frame lies over the backdrop: its shift (rows, columns) in cells, and its gain [3]."""

    shift: tuple[int, int]
    gain: np.ndarray


def backdrop_sample(picture: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
    """Make a small picture [36, 64, 3] of logarithms of linear colours.

    NaN where the hand is or too little light is; infinite where it is clipped.

    Args:
        picture: [H, W, 3] uint8 of the whole frame.
        hand_px: (left, top, right, bottom) of the hand in it, px.
    """
    cv2 = load_opencv()
    small = cv2.resize(picture, _SAMPLE_PX, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    values = np.where(small > _BRIGHTEST, np.inf, np.log(srgb_to_linear(small) + _ADDED))
    is_backdrop = small.min(-1) > _DARKEST
    scale = np.array(_SAMPLE_PX) / (picture.shape[1], picture.shape[0])
    left, top, right, bottom = (np.asarray(hand_px).reshape(2, 2) * scale).ravel()
    is_backdrop[max(0, int(top) - 1) : int(bottom) + 2, max(0, int(left) - 1) : int(right) + 2] = False
    return np.where(is_backdrop[..., None], values, np.nan)


def backdrop_gains(samples: Sequence[np.ndarray]) -> np.ndarray | None:
    """Return the logarithm [K, 3] of each frame's gain, their means 0; None: the backdrop is not the same in all.

    Args:
        samples: of `backdrop_sample`.
    """
    frames = [np.asarray(sample, np.float64) for sample in samples]
    backdrop = _known(max(frames, key=lambda one: np.isfinite(one).sum()))
    laid = [_Laid((0, 0), np.zeros(3))] * len(frames)
    for number in range(_ROUNDS):
        reach = _SWAY_CELLS if number == 0 else (0, 0)
        found = [_laid(frame, backdrop, one, reach) for frame, one in zip(frames, laid, strict=True)]
        laid = [one for one in found if one is not None]
        if len(laid) < len(frames):
            return None
        backdrop = _median([_over_backdrop(frame, one) for frame, one in zip(frames, laid, strict=True)])
    off = [_over_backdrop(frame, one) - backdrop for frame, one in zip(frames, laid, strict=True)]
    deviation = np.median(np.abs(np.concatenate([each[np.isfinite(each)] for each in off])))
    gains = np.stack([one.gain for one in laid])
    return None if deviation > _MOST_DEVIATION else gains - gains.mean(0)


def _known(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan)


def _over_backdrop(frame: np.ndarray, laid: _Laid) -> np.ndarray:
    """Return the backdrop [36, 64, 3] that a frame shows; NaN where it shows none."""
    moved = np.full_like(frame, np.nan)
    to, of = _overlap(laid.shift, frame.shape)
    moved[to] = _known(frame)[of] - laid.gain
    return moved


def _median(values: Sequence[np.ndarray]) -> np.ndarray:
    stacked = np.stack(values)
    count = np.isfinite(stacked).sum(0)
    return np.where(count > 0, np.nanmedian(np.where(count > 0, stacked, 0.0), 0), np.nan)


def _overlap(shift: tuple[int, int], shape: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return the parts of the backdrop and of a frame that is shifted over it."""
    to = tuple(slice(max(0, by), size + min(0, by)) for by, size in zip(shift, shape, strict=False))
    of = tuple(slice(max(0, -by), size - max(0, by)) for by, size in zip(shift, shape, strict=False))
    return to, of


def _laid(frame: np.ndarray, backdrop: np.ndarray, before: _Laid, reach: tuple[int, int]) -> _Laid | None:
    """Lay a frame over the backdrop; None: too little of it is seen."""
    shift = _best_shift(frame[..., 1], backdrop[..., 1], before.shift, reach)
    if shift is None:
        return None
    to, of = _overlap(shift, frame.shape)
    gains = [_gain(frame[of][..., channel], backdrop[to][..., channel]) for channel in range(3)]
    return None if any(gain is None for gain in gains) else _Laid(shift, np.array(gains))


def _best_shift(
    frame: np.ndarray, backdrop: np.ndarray, about: tuple[int, int], reach: tuple[int, int]
) -> tuple[int, int] | None:
    """Find the shift about another under which a frame [36, 64] is most like the backdrop, in a gain of its own."""
    best, costs = about, {}
    for step in (_STEP_CELLS, 1):
        rows, columns = reach if step > 1 else (step, step)
        for row in range(best[0] - rows, best[0] + rows + 1, step):
            for column in range(best[1] - columns, best[1] + columns + 1, step):
                costs[row, column] = _unlike(frame, backdrop, (row, column))
        best = min(costs, key=lambda shift: costs[shift])
    return best if np.isfinite(costs[best]) else None


def _unlike(frame: np.ndarray, backdrop: np.ndarray, shift: tuple[int, int]) -> float:
    to, of = _overlap(shift, frame.shape)
    shown, behind = frame[of][:, ::_EVERY], backdrop[to][:, ::_EVERY]
    gain = _gain(shown, behind, _LEAST_CELLS // _EVERY)
    if gain is None:
        return np.inf
    residual = _residual(shown, behind, gain)
    return float(np.minimum(np.abs(residual), _OUTLIER).mean())


def _residual(shown: np.ndarray, behind: np.ndarray, gain: float) -> np.ndarray:
    """Return by how much what is shown [N] is brighter than the backdrop with a gain; what is clipped is a bound."""
    both = ~np.isnan(shown) & np.isfinite(behind)
    shown, expected = shown[both], behind[both] + gain
    return np.where(np.isinf(shown), (_CLIPPED - expected).clip(0), shown - expected)


def _gain(shown: np.ndarray, behind: np.ndarray, fewest: int = _LEAST_CELLS) -> float | None:
    """Find the median gain; what is clipped counts where it is brighter than that gain would have it. None: too few."""
    both = ~np.isnan(shown) & np.isfinite(behind)
    shown, behind = shown[both], behind[both]
    is_clipped = np.isinf(shown)
    known, least = (shown - behind)[~is_clipped], (_CLIPPED - behind)[is_clipped]
    if len(known) < fewest:
        return None
    gain = np.median(known)
    for _ in range(_CENSORED_ROUNDS):
        more = least[least > gain]
        if not len(more):
            break
        gain = np.median(np.concatenate([known, more]))
    return float(gain)


_CLIPPED = float(np.log(srgb_to_linear(np.array(_BRIGHTEST)) + _ADDED))
