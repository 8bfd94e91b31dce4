"""How dark furrows of the skin's relief are, whatever light falls on it (ambient occlusion of a height map).

A bump mapped normal tells which way the skin of a furrow faces, but not that it lies between walls. Under a sky and in
a lamp's shadow, where light comes from everywhere, that alone would show; walls hide a part of it from the skin
between them, and what they reflect is redder. As all of the detail, shades are what is left after a blur: the tone of
the skin stays.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate

REACH_MM = 0.26
"""From a furrow to the skin that it is compared with."""
TONE_MM = 1.05
"""Side of the squares over which shades come to nothing."""
SHADE_OF_SLOPE, DEEPEST = 1.8, 0.35
"""Logarithm of the pigment of a furrow whose depth is `REACH_MM`, were it not for the most of it."""
_HIGHEST = 0.02  # of a crest, in the same measure: those that are higher see no more of the sky


def furrow_shade(relief_mm: Float[np.ndarray, "N N"], texel_mm: float) -> Float[np.ndarray, "N N"]:
    """Compute the logarithm of pigment that darkens furrows: below 0 in them, above on the skin between.

    Args:
        relief_mm: heights over an atlas.
        texel_mm: side of its texels.
    """
    heights = torch.as_tensor(np.ascontiguousarray(relief_mm), dtype=torch.float32)[None, None]
    slope = (_around(heights, _texels(REACH_MM / 2, texel_mm)) - heights) / REACH_MM
    shade = (SHADE_OF_SLOPE * slope.clamp(min=-_HIGHEST)).clamp(max=DEEPEST)
    tone = avg_pool2d(shade, _texels(TONE_MM, texel_mm))
    return (interpolate(tone, size=shade.shape[-2:], mode="bilinear") - shade)[0, 0].numpy()


def _around(plane: Float[Tensor, "1 1 N N"], reach: int) -> Float[Tensor, "1 1 N N"]:
    """Average twice over so many texels to each side; what lies beyond the map does not count."""
    for _ in range(2):
        plane = avg_pool2d(plane, 2 * reach + 1, 1, reach, count_include_pad=False)
    return plane


def _texels(length_mm: float, texel_mm: float) -> int:
    return max(1, round(length_mm / texel_mm))
