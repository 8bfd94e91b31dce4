"""What an avatar's atlas says of its texels: how sure they are, and whether they show a mark of one hand alone.

Marks are tattoos, writing, scars and large moles, which the person's other hand does not have. A mark stands out from
the skin around it, over more than spots do; nails, which do, too, are not marks.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from .atlas_texels import AtlasTexels
from .detail_maps_file import ATLAS_MM

_AROUND_MM, _BLUR_MM = 8.0, 0.4  # deviations: of what counts as around, and of what is compared with it
_STANDS_OUT, _PEAK = 0.3, 0.5  # of logarithms
_LEAST_MM2 = 10.0
_BORDER_MM, _NAIL_BORDER_MM = 1.2, 2.0
_LEAST_CONFIDENCE, _INSIDE = 0.25, 0.5
_ROUNDS = 3  # marks found are no longer what is around
_RESOLUTION, _CONFIDENCE_RESOLUTION = 512, 256


def confidence_map(texels: AtlasTexels, confidence: np.ndarray) -> np.ndarray:
    """Return the confidence [T] of texels as a map [C, C] uint8, the mean over each one's finer ones."""
    whole = texels.as_map(confidence[:, None])
    means = _reduced(whole, min(_CONFIDENCE_RESOLUTION, len(whole)))[..., 0]
    return (255 * means).round().clip(0, 255).astype(np.uint8)


def marks_map(texels: AtlasTexels, log_ratio: np.ndarray, confidence: np.ndarray, nail: np.ndarray) -> np.ndarray:
    """Find the marks.

    Args:
        texels: of the atlas.
        log_ratio: [T, 3] logarithm of the factor on albedo.
        confidence: [T] how sure it is.
        nail: [Q, Q] positive on nails.

    Returns:
        [K, K] uint8: 255 on marks.
    """
    size = min(_RESOLUTION, texels.resolution)
    mm = ATLAS_MM / size
    inside = np.zeros(texels.resolution**2, np.float32)
    inside[texels.pixel] = 1
    whole = np.concatenate([texels.as_map(log_ratio), texels.as_map(confidence[:, None])], -1)
    image, sure = np.split(_reduced(whole, size), [3], -1)
    at = np.arange(size) * len(nail) // size
    is_nail = _widened(nail[np.ix_(at, at)] > 0, _NAIL_BORDER_MM / mm)
    is_inside = _reduced(inside.reshape(texels.resolution, -1, 1), size)[..., 0] > _INSIDE
    free = is_inside & (sure[..., 0] > _LEAST_CONFIDENCE) & ~is_nail
    marks = np.zeros_like(free)
    for _ in range(_ROUNDS):
        around = _weighted_blur(image, (free & ~marks).astype(np.float32), _AROUND_MM / mm)
        blurred = ndimage.gaussian_filter(image - around, (_BLUR_MM / mm, _BLUR_MM / mm, 0))
        marks = _widened(_large(np.abs(blurred).max(-1) * free, mm), _BORDER_MM / mm)
    return np.where(marks, 255, 0).astype(np.uint8)


def _reduced(image: np.ndarray, size: int) -> np.ndarray:
    share = len(image) // size
    return image.reshape(size, share, size, share, -1).mean((1, 3))


def _weighted_blur(image: np.ndarray, weight: np.ndarray, sigma_px: float) -> np.ndarray:
    total = ndimage.gaussian_filter(weight, sigma_px)[..., None]
    return ndimage.gaussian_filter(image * weight[..., None], (sigma_px, sigma_px, 0)) / np.maximum(total, 1e-4)


def _large(deviation: np.ndarray, mm: float) -> np.ndarray:
    labels = np.zeros(deviation.shape, np.int32)
    count = ndimage.label(deviation > _STANDS_OUT, np.ones((3, 3)), output=labels)
    each = np.arange(1, int(np.asarray(count)) + 1)
    area_mm2 = np.asarray(ndimage.sum_labels(labels > 0, labels, each)) * mm**2
    is_mark = (area_mm2 > _LEAST_MM2) & (np.asarray(ndimage.maximum(deviation, labels, each)) > _PEAK)
    return np.concatenate([[False], is_mark])[labels]


def _widened(mask: np.ndarray, by_px: float) -> np.ndarray:
    return np.asarray(ndimage.distance_transform_edt(~mask)) <= by_px if mask.any() else mask
