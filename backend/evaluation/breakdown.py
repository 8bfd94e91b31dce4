"""Where a picture's squared error lies: at the silhouette, at inner edges, in contact, or in the skin between.

Every pixel belongs to one region, the first that claims it:

- silhouette: within 3 px of the ground truth's outline, outside the hand, or where ours has a hole;
- occlusion: within 3 px of a depth step between two parts of the posed mesh (a finger over the palm);
- contact: the mesh there sees less than half of the sky it faces (between fingers, in a fist);
- interior: the rest of the hand. Its error is halved by frequency: `shading` is what a Gaussian of 8 px leaves of the
  signed error, `texture` what it takes away.

Pixels are those of a 334x512 image; other sizes scale them by the root of their area.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .metrics import psnr_db
from .neighbourhood import distance_px, masked_blur
from .seen_surface import SeenSurface

_REFERENCE_PIXELS = 334 * 512
_BAND_PX, _SHADING_SIGMA_PX, _FILL_SIGMA_PX = 3.0, 8.0, 3.0
# A finger that lies on the palm stands out by half its thickness, 6 to 8 mm; skin seen at 78 degrees falls by 5 pixels'
# widths from one pixel to the next.
_STEP_M, _STEP_FOOTPRINTS = 0.003, 5.0
_CONTACT_OPENNESS = 0.5
_LEAST_ALPHA = 1 / 255  # fainter colour, divided by its alpha, is noise

CAUSES = ("silhouette", "occlusion", "contact", "shading", "texture")


class ErrorRegions(NamedTuple):
    """[H, W] each; together every pixel once. `silhouette` holds the background too."""

    silhouette: Tensor
    occlusion: Tensor
    contact: Tensor
    interior: Tensor


REGIONS = ErrorRegions._fields


class Breakdown(NamedTuple):
    """Shares of one image's squared error by cause (they add up to 1), and of the hand's pixels by region.

    Attributes:
        share: of `CAUSES`; zeros where the pictures are equal.
        area: of `REGIONS` (of the silhouette, the hand's side of the band).
        psnr_true_alpha: dB, full image: our colours with the ground truth's alpha.
    """

    share: dict[str, float]
    area: dict[str, float]
    psnr_true_alpha: float


def error_breakdown(image: Float[Tensor, "H W 4"], truth: Float[Tensor, "H W 4"], surface: SeenSurface) -> Breakdown:
    """Break one image's error down; encoded colour times alpha, and alpha."""
    regions = regions_of(image[..., 3], truth[..., 3], surface)
    difference = (image - truth)[..., :3]
    squared = (difference**2).sum(-1).double()
    errors = {name: float(squared[region].sum()) for name, region in regions._asdict().items()}
    inside = errors.pop("interior")
    low = low_frequency_share(difference, regions.interior, _scaled(_SHADING_SIGMA_PX, regions.interior))
    errors |= {"shading": inside * low, "texture": inside * (1 - low)}
    total, hand = sum(errors.values()), truth[..., 3] > 0.5
    return Breakdown(
        share={name: errors[name] / total if total else 0.0 for name in CAUSES},
        area={name: float((region & hand).sum() / hand.sum()) for name, region in regions._asdict().items()},
        psnr_true_alpha=psnr_db(with_alpha(image, truth[..., 3]), truth[..., :3]),
    )


def regions_of(alpha: Float[Tensor, "H W"], true_alpha: Float[Tensor, "H W"], surface: SeenSurface) -> ErrorRegions:
    """The regions of an image whose alpha is `alpha`."""
    hand, band_px = true_alpha > 0.5, _scaled(_BAND_PX, true_alpha)
    silhouette = ~hand | (alpha <= 0.5) | _near(_outline(hand), band_px)
    occlusion = ~silhouette & _near(depth_steps(surface), band_px)
    contact = ~silhouette & ~occlusion & (surface.openness < _CONTACT_OPENNESS)
    return ErrorRegions(silhouette, occlusion, contact, ~silhouette & ~occlusion & ~contact)


def depth_steps(surface: SeenSurface) -> Bool[Tensor, "H W"]:
    """Both pixels of every neighbouring pair that see parts of the mesh at clearly different depths."""
    depth, is_mesh = surface.depth, surface.depth.isfinite()
    far_enough = torch.maximum(_STEP_M * surface.scale, _STEP_FOOTPRINTS * surface.footprint)

    def differ(here: tuple, there: tuple) -> Tensor:
        step = (depth[here] - depth[there]).abs() > torch.minimum(far_enough[here], far_enough[there])
        return step & is_mesh[here] & is_mesh[there]

    return _pairs(differ, depth.shape)


def low_frequency_share(difference: Float[Tensor, "H W 3"], region: Bool[Tensor, "H W"], sigma_px: float) -> float:
    """Of the squared error in a region, the part that a Gaussian blur within the region leaves; 1 where all is zero.

    The blur and what it takes away are not quite orthogonal: what they add to neither is shared out in proportion.
    """
    signed = difference.permute(2, 0, 1)
    low, _ = masked_blur(signed, region.to(signed.dtype), sigma_px)
    kept, taken = (float((x**2)[:, region].double().sum()) for x in (low, signed - low))
    return kept / (kept + taken) if kept + taken else 1.0


def with_alpha(image: Float[Tensor, "H W 4"], alpha: Float[Tensor, "H W"]) -> Float[Tensor, "H W 3"]:
    """Our straight colours times another alpha; where we have none, those of the 3 px around."""
    colour, own = image[..., :3].permute(2, 0, 1), image[..., 3]
    straight = (colour / own.clamp(min=_LEAST_ALPHA)).clamp(max=1)
    is_known = own >= _LEAST_ALPHA
    around, _ = masked_blur(straight, own * is_known, _scaled(_FILL_SIGMA_PX, own))
    return (torch.where(is_known, straight, around) * alpha).permute(1, 2, 0)


def _outline(hand: Bool[Tensor, "H W"]) -> Bool[Tensor, "H W"]:
    """Pixels with a neighbour on the other side."""
    return _pairs(lambda here, there: hand[here] != hand[there], hand.shape)


def _pairs(differ, shape: tuple[int, ...]) -> Bool[Tensor, "H W"]:
    """Both pixels of every pair of neighbours, below and beside, of which `differ(here, there)` says so."""
    marked = torch.zeros(shape, dtype=torch.bool)
    everything, first, last = slice(None), slice(None, -1), slice(1, None)
    for here, there in (((first, everything), (last, everything)), ((everything, first), (everything, last))):
        found = differ(here, there)
        marked[here] |= found
        marked[there] |= found
    return marked


def _near(edge: Bool[Tensor, "H W"], band_px: float) -> Bool[Tensor, "H W"]:
    """Pixels within the band; the edge itself runs half a pixel beside the centres of those it is marked by."""
    return distance_px(edge, max(band_px - 0.5, 0.0)).isfinite()


def _scaled(length_px: float, image: Tensor) -> float:
    return length_px * sqrt(image.shape[0] * image.shape[1] / _REFERENCE_PIXELS)
