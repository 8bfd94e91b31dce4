"""What pictures agree on: the mean of what they say about each texel, those that contradict the others counting less.

Each picture has an exposure and a white balance of its own. A channel that a camera clipped was at least as bright: it
counts where it says more than the others do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

_OUTLIER = 0.12  # of the logarithm
_REWEIGHTED = 4
_SAME = 0.01  # of the logarithm: a bound that made the mean is not below it
_GAIN_SHRINK = 0.7  # of a picture's own exposure and white balance, which shading may feign
_LEAST_GAIN_WEIGHT = 50.0


@dataclass(frozen=True)
class GatheredRatio:
    """Logarithms of the person's albedo over the base's.

    Attributes:
        mean: [T, 3].
        weight: [T] of all pictures; 0: no picture shows it.
        deviation: of pictures from the mean, of the logarithm.
        flow_px: mean length of the flow on the hand; 0 without flow.
        log_gain: [K, 3] of each picture's exposure and white balance.
    """

    mean: np.ndarray
    weight: np.ndarray
    deviation: float
    flow_px: float
    log_gain: np.ndarray


class TexelSighting(NamedTuple):
    """Of one picture: weight [T], logarithm of the ratio [T, 3], where it is a lower bound [T, 3]; mean flow."""

    weight: np.ndarray
    log_ratio: np.ndarray
    is_bound: np.ndarray
    flow_px: float


def agreed_ratio(sightings: Sequence[TexelSighting], guess: np.ndarray) -> GatheredRatio:
    """Average robustly, in turn with each picture's gain.

    Args:
        sightings: of all pictures.
        guess: [T, 3] logarithms of the ratio; a channel that no picture measures is as far from it as the others are.
    """
    gains = np.zeros((len(sightings), 3), np.float32)
    weights = [sighting.weight.astype(np.float32) for sighting in sightings]
    mean, total = _mean(sightings, weights, gains, guess, np.full_like(guess, np.inf))
    deviation = 0.0
    for _ in range(_REWEIGHTED):
        squares = np.zeros(2)
        for index, sighting in enumerate(sightings):
            off = sighting.log_ratio.astype(np.float32) - mean
            gains[index] = _gain(off, weights[index][:, None] * ~sighting.is_bound)
            off -= gains[index]
            is_known = ~sighting.is_bound | (off > -_SAME)
            square = (off * off * is_known).sum(1) / np.maximum(is_known.sum(1), 1)
            weights[index] = sighting.weight / (1 + square / _OUTLIER**2) ** 1.5
            squares += (weights[index] * square).sum(), weights[index].sum()
        gains -= gains.mean(0)
        mean, total = _mean(sightings, weights, gains, guess, mean)
        deviation = float(np.sqrt(squares[0] / max(squares[1], 1e-9)))
    flow_px = float(np.mean([sighting.flow_px for sighting in sightings]))
    return GatheredRatio(mean, total, deviation, flow_px, gains)


def _mean(
    sightings: Sequence[TexelSighting],
    weights: Sequence[np.ndarray],
    gains: np.ndarray,
    guess: np.ndarray,
    previous: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Average what was measured, and bounds above the mean before [T, 3]; returns the mean weight of channels, too."""
    total, sums = np.zeros_like(guess), np.zeros_like(guess)
    for sighting, weight, gain in zip(sightings, weights, gains, strict=True):
        off = sighting.log_ratio.astype(np.float32) - gain - guess
        share = weight[:, None] * (~sighting.is_bound | (off > previous - guess - _SAME))
        total += share
        sums += share * off
    off, is_known = sums / np.maximum(total, 1e-6), total > 0
    hue = off.sum(1, keepdims=True) / np.maximum(is_known.sum(1, keepdims=True), 1)
    return guess + np.where(is_known, off, hue), total.mean(1)


def _gain(off: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the logarithm [3] of a picture's gain: a share of the median of what it is brighter by, by weight."""
    gain = np.zeros(3, np.float32)
    for channel, each in enumerate(weight.T):
        if each.sum() >= _LEAST_GAIN_WEIGHT:
            gain[channel] = _GAIN_SHRINK * np.median(off[each > 0.3 * each.max(), channel])
    return gain
