"""The dome: the light of captures whose light does not vary. Z up, front -Y."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..records.light import Sky, sky_directions

SKY_SIZE = (64, 32)
"""(width, height) of the skies of captures, texels."""
_FINER = 4  # a texel is the mean of so many directions along each side


class Lobe(NamedTuple):
    """A soft light: direction towards it, linear radiance, and cosine exponent (larger is narrower)."""

    towards: tuple[float, float, float]
    radiance: tuple[float, float, float]
    exponent: float

    def at(self, directions: np.ndarray) -> np.ndarray:
        """Look up its radiance [..., 3] from the unit directions [..., 3]."""
        cosine = directions @ (np.array(self.towards) / np.linalg.norm(self.towards))
        return np.maximum(cosine, 0)[..., None] ** self.exponent * np.array(self.radiance)


KEY = Lobe((-0.75, -0.75, 0.75), (9.5, 9.0, 8.3), 42)
FILL = Lobe((0.8, -0.35, -0.5), (1.5, 1.7, 2.0), 14)
KICK = Lobe((-0.75, 0.45, 0.6), (1.5, 1.4, 1.3), 10)
BACK = Lobe((0.55, 0.80, 0.55), (3.6, 3.4, 3.15), 20)
LOBES = (KEY, FILL, KICK, BACK)
GROUND, ZENITH = (0.22, 0.205, 0.19), (0.36, 0.39, 0.44)


@cache
def dome_sky() -> Sky:
    """Draw the dome as a map of `SKY_SIZE`."""
    up = fine_directions()[..., 2:]
    gradient = np.array(GROUND) + (up + 1) / 2 * (np.array(ZENITH) - np.array(GROUND))
    return sky_of(gradient + sum(lobe.at(fine_directions()) for lobe in LOBES))


@cache
def fine_directions() -> np.ndarray:
    """Compute [H, W, 3] unit directions of a map that is finer than `SKY_SIZE`, for `sky_of`."""
    return sky_directions(SKY_SIZE[1] * _FINER, SKY_SIZE[0] * _FINER)


def sky_of(radiance: np.ndarray) -> Sky:
    """Reduce a finer map to `SKY_SIZE` by the means of its texels; the values are half floats."""
    solid_angles = np.linalg.norm(fine_directions()[..., :2], axis=-1)[..., None]
    total, weight = _block_sums(radiance * solid_angles), _block_sums(solid_angles)
    return Sky((total / weight).astype(np.float16).astype(np.float32))


def _block_sums(fine: np.ndarray) -> np.ndarray:
    width, height = SKY_SIZE
    return np.reshape(fine, (height, _FINER, width, _FINER, -1)).sum((1, 3))
