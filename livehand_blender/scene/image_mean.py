"""The mean colour of an image, found once until the image changes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import bpy
import mathutils
import numpy as np

from .colour import in_rec709
from .node_values import image_state

_STILL = ("FILE", "GENERATED")
_LINEAR = ("Non-Color", "Linear Rec.709", "Linear")
_KEPT = 256
_MOST_VALUES = 1 << 20


@dataclass(frozen=True)
class _Image:
    """An image, equal to another in the same state."""

    state: str
    image: bpy.types.Image = field(compare=False)


def mean_colour(image: bpy.types.Image) -> np.ndarray | None:
    """[3] linear Rec.709; None of an image without pixels, of films, tiles, and spaces neither sRGB nor linear."""
    if image.source not in _STILL:  # of others Blender gives the pixels of one frame or tile
        return None
    return _mean_colour(_Image(str(image_state(image)), image))


@lru_cache(maxsize=_KEPT)
def _mean_colour(one: _Image) -> np.ndarray | None:
    image = one.image
    if len(image.pixels) == 0:
        return None
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    rgba = values.reshape(-1, image.channels)
    colours = rgba[:: -(-len(values) // _MOST_VALUES), : min(image.channels, 3)]
    space = image.colorspace_settings.name
    if image.is_float:  # Blender has converted these
        return in_rec709(_rgb(colours))
    if space in _LINEAR:
        return _rgb(colours)
    return _rgb(_decoded()[np.rint(255 * colours).astype(int)]) if space == "sRGB" else None


def _decoded() -> np.ndarray:
    """[256] linear light of the values of an sRGB byte."""
    return np.array([mathutils.Color([value / 255] * 3).from_srgb_to_scene_linear().r for value in range(256)])


def _rgb(colours: np.ndarray) -> np.ndarray:
    """[3] the mean of colours [N, 1 or 3]."""
    return np.broadcast_to(colours.mean(0, dtype=float), 3).copy()
