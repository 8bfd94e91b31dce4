"""What pictures agree on: the mean of what they say about each texel, those that contradict the others counting less.

Each picture has an exposure and a white balance of its own. A channel that a camera clipped was at least as bright: it
counts where it says more than the others do.

What is coarse in a picture is light as much as skin. Light is never known exactly: a finger is darker in one picture
and brighter in the next than the model says, and a robust mean of each texel alone would believe one picture here and
another one beside it, with an edge between them. So that part is levelled first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...system.parallel_map import parallel_map

_OUTLIER = 0.12  # of the logarithm
_REWEIGHTED = 4
_SAME = 0.01  # of the logarithm: a bound that made the mean is not below it
_GAIN_SHRINK = 0.7  # of a picture's own exposure and white balance, which shading may feign
_LEAST_GAIN_WEIGHT = 50.0
_PART_TEXELS = 1 << 14  # of which a processor's cache holds all that a mean takes


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
    """What one picture says.

    Attributes:
        weight: [T].
        log_ratio: [T, 3] logarithm of the ratio.
        coarse: [T, 3] what of it is coarse; NaN where clipped channels do not let it be seen.
        is_bound: [T, 3] where the logarithm is a lower bound.
        flow_px: mean length of the flow.
    """

    weight: np.ndarray
    log_ratio: np.ndarray
    coarse: np.ndarray
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
        given = list(zip(sightings, weights, strict=True))
        found = parallel_map(lambda each, mean=mean: _agreement(*each, mean), given)
        weights = [each.weight for each in found]
        gains = np.stack([each.gain for each in found])
        gains -= gains.mean(0)
        mean, total = _mean(sightings, weights, gains, guess, mean)
        squares, sums = np.sum([(each.squares, each.weight.sum()) for each in found], 0)
        deviation = float(np.sqrt(squares / max(sums, 1e-9)))
    flow_px = float(np.mean([sighting.flow_px for sighting in sightings]))
    return GatheredRatio(mean, total, deviation, flow_px, gains)


class _Agreement(NamedTuple):
    """How one picture agrees with the mean: logarithm [3] of its gain, new weights [T], weighted sum of squares."""

    gain: np.ndarray
    weight: np.ndarray
    squares: float


def _agreement(sighting: TexelSighting, weight: np.ndarray, mean: np.ndarray) -> _Agreement:
    off = sighting.log_ratio.astype(np.float32) - mean
    gain = _gain(off, weight[:, None] * ~sighting.is_bound)
    off -= gain
    is_known = ~sighting.is_bound | (off > -_SAME)
    square = (off * off * is_known).sum(1) / np.maximum(is_known.sum(1), 1)
    weight = sighting.weight / (1 + square / _OUTLIER**2) ** 1.5
    return _Agreement(gain, weight, float((weight * square).sum()))


def _mean(
    sightings: Sequence[TexelSighting],
    weights: Sequence[np.ndarray],
    gains: np.ndarray,
    guess: np.ndarray,
    previous: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Average what was measured, and bounds above the mean before [T, 3]; returns the mean weight of channels, too."""

    def of_part(part: slice) -> tuple[np.ndarray, np.ndarray]:
        of_guess, of_previous = guess[part], previous[part]
        total, sums = np.zeros_like(of_guess), np.zeros_like(of_guess)
        for sighting, weight, gain in zip(sightings, weights, gains, strict=True):
            off = sighting.log_ratio[part].astype(np.float32) - gain - of_guess
            share = weight[part, None] * (~sighting.is_bound[part] | (off > of_previous - of_guess - _SAME))
            total += share
            sums += share * off
        off, is_known = sums / np.maximum(total, 1e-6), total > 0
        hue = off.sum(1, keepdims=True) / np.maximum(is_known.sum(1, keepdims=True), 1)
        return of_guess + np.where(is_known, off, hue), total.mean(1)

    parts = [slice(first, first + _PART_TEXELS) for first in range(0, len(guess), _PART_TEXELS)]
    means, totals = zip(*parallel_map(of_part, parts), strict=True)
    return np.concatenate(means), np.concatenate(totals)


def _gain(off: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the logarithm [3] of a picture's gain: a share of the median of what it is brighter by, by weight."""
    gain = np.zeros(3, np.float32)
    for channel, each in enumerate(weight.T):
        if each.sum() >= _LEAST_GAIN_WEIGHT:
            gain[channel] = _GAIN_SHRINK * np.median(off[each > 0.3 * each.max(), channel])
    return gain


_LEVEL_OUTLIER = 0.15  # of the logarithm; farther ones count in inverse proportion: that has one optimum, and no edges
_LEVEL_ROUNDS = 4
_LEVELLED = 0.9  # share of what is off
_GAIN_TEXELS = 1 << 15  # of which a picture's gain is told


def levelled(sightings: Sequence[TexelSighting]) -> list[TexelSighting]:
    """Take from each picture most of what is coarse and unlike the others', beyond its gain.

    Args:
        sightings: of all pictures.
    """
    level = _agreed_level(sightings)

    def moved(sighting: TexelSighting) -> TexelSighting:
        off = np.nan_to_num(sighting.coarse.astype(np.float32) - level)
        return sighting._replace(log_ratio=(sighting.log_ratio - _LEVELLED * off).astype(np.float16))

    return parallel_map(moved, sightings)


def _agreed_level(sightings: Sequence[TexelSighting]) -> np.ndarray:
    """Return the coarse part [T, 3] that pictures agree on."""
    count = len(sightings[0].weight)
    some = _CoarseParts.of(sightings, slice(0, count, -(-count // _GAIN_TEXELS)))
    gains = np.zeros((len(sightings), 3), np.float32)
    for _ in range(_LEVEL_ROUNDS):
        off = some.coarse - some.robust_mean(gains)
        gains = np.stack([_gain(*each) for each in zip(off, some.weight[..., None], strict=True)])
        gains -= gains.mean(0)
    parts = [slice(first, first + _PART_TEXELS) for first in range(0, count, _PART_TEXELS)]
    return np.concatenate(parallel_map(lambda part: _CoarseParts.of(sightings, part).robust_mean(gains), parts))


class _CoarseParts(NamedTuple):
    """What is coarse [K, t, 3] in K pictures of some texels, and how well they show it [K, t]."""

    coarse: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, sightings: Sequence[TexelSighting], texels: slice) -> _CoarseParts:
        coarse = np.stack([one.coarse[texels] for one in sightings]).astype(np.float32)
        weight = np.sqrt(np.stack([one.weight[texels] for one in sightings]).astype(np.float32))
        return cls(np.nan_to_num(coarse), weight * np.isfinite(coarse).all(-1))

    def robust_mean(self, gains: np.ndarray) -> np.ndarray:
        """Return the mean [t, 3] beyond the pictures' gains [K, 3], from which far ones count little."""
        even, weight, mean = self.coarse - gains[:, None], self.weight, np.float32(0)
        for _ in range(_LEVEL_ROUNDS):
            mean = (weight[..., None] * even).sum(0) / np.maximum(weight.sum(0), 1e-6)[:, None]
            weight = self.weight / (1 + np.linalg.norm(even - mean, axis=-1) / _LEVEL_OUTLIER)
        return np.asarray(mean)
