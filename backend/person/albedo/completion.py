"""The person's whole atlas from what was gathered: delighting as an estimate with a prior, and completion by place.

The logarithm of the ratio is prior(place; numbers) + low + high. Light and albedo trade what is coarse: an error of the
light's estimate looks like a large stain. So of what is coarser than some millimetres a share is kept (`low`), that the
pictures' agreement allows, and it dies out over the surface where nothing was seen; what is finer is the person's.

Skin that no picture shows has the base's own fine pigment. Where the person's varies more, patches of the person's are
added; where it varies less, the base's is faded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from ...surface.atlas_texels import AtlasTexels
from ...surface.skin_patches import RestPoints, patched
from ..lit_model.numbers import ToneFamily, ToneFit, fitted_numbers
from .gathering import GatheredRatio

_MOST_WEIGHT = 2.0  # of a texel: more pictures do not make it surer
_SMOOTH_EDGES = 6.0  # of the Laplacian against data: what is coarser than about 4 mm
_REACH_EDGES = 12.0  # over which it dies out where nothing was seen
_KEPT_LOW = 0.75
_SURE_WEIGHT = 0.15
_SURE_AROUND = 0.3, 0.6  # mean confidence around a texel at which it begins to count, and counts fully
_COPIED, _HALF_SEEN = 0.75, 0.5  # confidence of skin that is copied; from which on nothing is added
_SURE_ALL_AROUND = 0.9  # mean confidence around what tells of contrast: beside what is not seen, much is a mistake
_VARIANCE_EDGES = 60.0  # of the Laplacian: over which contrast is told
_LEAST_FADED = 0.5  # of the base's own pigment
_LEAST_VARIANCE, _MOST_DEVIATIONS = 1e-5, 4.0


@dataclass(frozen=True)
class CompletedRatio:
    """The person's albedo over the base's.

    Attributes:
        log_ratio: [T, 3] of all texels.
        prior: [T, 3] what the numbers alone say.
        confidence: [T] 0 where nothing was seen to 1.
        numbers: of the skin.
    """

    log_ratio: np.ndarray
    prior: np.ndarray
    confidence: np.ndarray
    numbers: ToneFit


def completed_ratio(
    texels: AtlasTexels,
    gathered: GatheredRatio,
    family: ToneFamily,
    base_log_albedo: np.ndarray,
    melanin: float,
    kept_low: float = _KEPT_LOW,
) -> CompletedRatio:
    """Complete what was gathered.

    Args:
        texels: of the atlas.
        gathered: in the light as it was estimated.
        family: of skins, at the surface's vertices.
        base_log_albedo: [N, 3] of the base.
        melanin: of the skin.
        kept_low: share of what is coarse and not explained by the numbers.
    """
    observed, weight = texels.at_vertices(gathered.mean, np.minimum(gathered.weight, _MOST_WEIGHT))
    numbers = fitted_numbers(family, observed + base_log_albedo, weight, melanin)
    light = numbers.log_gain + numbers.log_tint
    prior = family.log_albedo(numbers.melanin, numbers.blood) - base_log_albedo
    left = np.where(weight[:, None] > 0, observed - light - prior, 0)
    smooth = _smoothed(texels, left, weight, _SMOOTH_EDGES, 0.0)
    spread = _smoothed(texels, kept_low * smooth, weight, 1.0, 1 / _REACH_EDGES**2)
    confidence = _confidence(texels, gathered.weight)
    of_prior, of_low, of_spread = (texels.at_texels(values.astype(np.float32)) for values in (prior, smooth, spread))
    high = gathered.mean - light.astype(np.float32) - of_prior - of_low
    seen = of_prior + kept_low * of_low + high
    log_ratio = confidence[:, None] * seen + (1 - confidence[:, None]) * (of_prior + of_spread)
    return CompletedRatio(log_ratio, of_prior, confidence, numbers)


def with_unseen_detail(
    texels: AtlasTexels,
    completed: CompletedRatio,
    base_log_albedo: np.ndarray,
    points: RestPoints,
    is_nail: np.ndarray,
    is_mark: np.ndarray,
) -> CompletedRatio:
    """Give the skin that no picture shows the contrast of what is seen around it.

    Args:
        texels: of the atlas.
        completed: what the pictures say.
        base_log_albedo: [T, 3] of the base, with its fine pigment.
        points: where the texels lie at rest.
        is_nail: [T] which no skin is like.
        is_mark: [T] of one hand alone; spots that are as large tell of contrast, but are not copied.
    """
    of_base = _fine(texels, base_log_albedo)
    of_person = _fine(texels, completed.log_ratio + base_log_albedo)
    is_sure = ~is_nail & (completed.confidence > _COPIED)
    around = _local_mean(texels, completed.confidence, np.ones_like(completed.confidence))
    is_sure &= around > _SURE_ALL_AROUND
    is_copied = is_sure & ~is_mark
    if not is_copied.any():
        return completed
    own_squared, base_squared = ((fine**2).mean(1) for fine in (of_person, of_base))
    trusted, everywhere = is_sure.astype(np.float32), np.ones(len(is_sure), np.float32)
    base_variance = _local_mean(texels, base_squared, everywhere)
    own_variance = _local_mean(texels, own_squared, trusted)
    more = own_variance - _local_mean(texels, base_squared, trusted)
    copied_variance = _local_mean(texels, own_squared, is_copied.astype(np.float32))
    deviation = np.sqrt(copied_variance.clip(_LEAST_VARIANCE))[:, None]
    texture = patched(points, (of_person / deviation).clip(-_MOST_DEVIATIONS, _MOST_DEVIATIONS), is_copied)
    kept = np.sqrt((1 + more / base_variance.clip(_LEAST_VARIANCE)).clip(_LEAST_FADED**2, 1))
    added = np.sqrt(more.clip(0))[:, None] * texture + (kept - 1)[:, None] * of_base
    unseen = (1 - completed.confidence / _HALF_SEEN).clip(0)[:, None] * ~(is_nail | is_mark)[:, None]
    return replace(completed, log_ratio=(completed.log_ratio + unseen * added).astype(np.float32))


def _fine(texels: AtlasTexels, values: np.ndarray) -> np.ndarray:
    """Return what is finer than some millimetres of values [T, C]."""
    ones = np.ones(len(values), np.float32)
    smooth = _smoothed(texels, *texels.at_vertices(values, ones), _SMOOTH_EDGES, 0.0)
    return values - texels.at_texels(smooth.astype(np.float32))


def _local_mean(texels: AtlasTexels, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Average values [T] around each texel, by weights [T]; far from all it is the nearest mean."""
    mean = _smoothed(texels, *texels.at_vertices(values[:, None], weight), _VARIANCE_EDGES, 0.0)
    return texels.at_texels(mean.astype(np.float32))[:, 0]


def _confidence(texels: AtlasTexels, weight: np.ndarray) -> np.ndarray:
    """Return how sure each texel is [T]: what is seen alone, amid skin that no picture shows, is mostly a mistake."""
    alone = weight / (weight + _SURE_WEIGHT)
    at_vertices, _ = texels.at_vertices(alone[:, None], np.ones_like(weight))
    around = _smoothed(texels, at_vertices, np.ones(len(at_vertices)), _SMOOTH_EDGES, 0.0)
    share = texels.at_texels(around.astype(np.float32))[:, 0]
    low, high = _SURE_AROUND
    return (alone * ((share - low) / (high - low)).clip(0, 1)).astype(np.float32)


def _smoothed(
    texels: AtlasTexels, values: np.ndarray, weight: np.ndarray, smoothness: float, decay: float
) -> np.ndarray:
    """Fit a smooth field to values [N, C] of vertices with weights [N], which returns to 0 where they have none.

    Args:
        texels: of the surface.
        values: to be smoothed.
        weight: of them.
        smoothness: of the Laplacian, against weights of 1.
        decay: of the field itself, against the Laplacian.
    """
    trusted = sparse.diags(np.minimum(weight, 1.0))
    laplacian = texels.laplacian
    system = trusted + smoothness * (laplacian + max(decay, 1e-6) * sparse.eye(len(values)))
    goal = trusted @ values
    return np.stack(
        [linalg.cg(system.tocsr(), goal[:, channel], rtol=1e-4, maxiter=400)[0] for channel in range(values.shape[1])],
        1,
    )
