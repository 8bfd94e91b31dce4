"""Breakdown of an image's squared error by cause: silhouette, occlusion edges, contact, and the skin between.

Every pixel belongs to the first region that it matches:

- silhouette: within 3 px of the ground truth's outline, outside the hand, or where the render has a hole;
- occlusion: within 3 px of a depth step between two parts of the posed mesh (a finger over the palm);
- contact: the mesh there sees less than half of the sky it faces (between fingers, in a fist);
- interior: the rest of the hand. Its signed error is split by frequency: `shading` is the part that a Gaussian of 8 px
  keeps, `texture` the part that it removes.

Lengths in pixels are for a 334x512 image; other sizes scale them by the square root of the area.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .metrics import psnr_db
from .neighbourhood import distance_px, masked_blur
from .visible_surface import VisibleSurface

_REFERENCE_PIXELS = 334 * 512
_BAND_PX, _SHADING_SIGMA_PX, _FILL_SIGMA_PX = 3.0, 8.0, 3.0
# A finger on the palm stands out by half its thickness, 6 to 8 mm. Skin seen at an angle of 78 degrees recedes by the
# width of 5 pixels from one pixel to the next.
_STEP_M, _STEP_FOOTPRINTS = 0.003, 5.0
_CONTACT_OPENNESS = 0.5
_MIN_ALPHA = 1 / 255  # at lower alpha, straight colour is noise

CAUSES = ("silhouette", "occlusion", "contact", "shading", "texture")


class ErrorRegions(NamedTuple):
    """[H, W] each; every pixel lies in exactly one. `silhouette` includes the background."""

    silhouette: Tensor
    occlusion: Tensor
    contact: Tensor
    interior: Tensor


REGIONS = ErrorRegions._fields


class Breakdown(NamedTuple):
    """Shares of one image's squared error by cause, which add up to 1, and of the hand's pixels by region.

    Attributes:
        share: of each cause in `CAUSES`; zeros where the images are equal.
        area: of each region in `REGIONS`; of the silhouette, the part inside the hand.
        psnr_true_alpha: dB, of the full image with the render's colours and the ground truth's alpha.
    """

    share: dict[str, float]
    area: dict[str, float]
    psnr_true_alpha: float


def error_breakdown(image: Float[Tensor, "H W 4"], truth: Float[Tensor, "H W 4"], surface: VisibleSurface) -> Breakdown:
    """Break down one image's error by region; images hold encoded colour times alpha, and alpha."""
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
        psnr_true_alpha=psnr_db(with_other_alpha(image, truth[..., 3]), truth[..., :3]),
    )


def regions_of(alpha: Float[Tensor, "H W"], true_alpha: Float[Tensor, "H W"], surface: VisibleSurface) -> ErrorRegions:
    """Divide an image whose alpha is `alpha` into regions."""
    hand, band_px = true_alpha > 0.5, _scaled(_BAND_PX, true_alpha)
    silhouette = ~hand | (alpha <= 0.5) | _near(_outline(hand), band_px)
    occlusion = ~silhouette & _near(depth_steps(surface), band_px)
    contact = ~silhouette & ~occlusion & (surface.ambient_occlusion < _CONTACT_OPENNESS)
    return ErrorRegions(silhouette, occlusion, contact, ~silhouette & ~occlusion & ~contact)


def depth_steps(surface: VisibleSurface) -> Bool[Tensor, "H W"]:
    """Mark both pixels of every neighbouring pair whose depths on the mesh differ clearly."""
    depth, is_mesh = surface.depth, surface.depth.isfinite()
    far_enough = torch.maximum(_STEP_M * surface.scale, _STEP_FOOTPRINTS * surface.footprint)

    def differ(here: tuple, there: tuple) -> Tensor:
        step = (depth[here] - depth[there]).abs() > torch.minimum(far_enough[here], far_enough[there])
        return step & is_mesh[here] & is_mesh[there]

    return _pairs(differ, depth.shape)


def low_frequency_share(difference: Float[Tensor, "H W 3"], region: Bool[Tensor, "H W"], sigma_px: float) -> float:
    """Compute the share of a region's squared error that a Gaussian blur within it keeps; 1 if there is no error.

    The kept and removed parts are not quite orthogonal; their cross term is divided in proportion.
    """
    signed = difference.permute(2, 0, 1)
    low, _ = masked_blur(signed, region.to(signed.dtype), sigma_px)
    kept, removed = (float((x**2)[:, region].double().sum()) for x in (low, signed - low))
    return kept / (kept + removed) if kept + removed else 1.0


def with_other_alpha(image: Float[Tensor, "H W 4"], alpha: Float[Tensor, "H W"]) -> Float[Tensor, "H W 3"]:
    """Multiply straight colours by another alpha; transparent pixels take the colour of the 3 px around them."""
    colour, own = image[..., :3].permute(2, 0, 1), image[..., 3]
    straight = (colour / own.clamp(min=_MIN_ALPHA)).clamp(max=1)
    is_known = own >= _MIN_ALPHA
    around, _ = masked_blur(straight, own * is_known, _scaled(_FILL_SIGMA_PX, own))
    return (torch.where(is_known, straight, around) * alpha).permute(1, 2, 0)


def _outline(hand: Bool[Tensor, "H W"]) -> Bool[Tensor, "H W"]:
    """Mark pixels with a neighbour on the other side of the outline."""
    return _pairs(lambda here, there: hand[here] != hand[there], hand.shape)


def _pairs(differ, shape: tuple[int, ...]) -> Bool[Tensor, "H W"]:
    """Mark both pixels of every vertical or horizontal pair of neighbours for which `differ(here, there)` holds."""
    marked = torch.zeros(shape, dtype=torch.bool)
    everything, first, last = slice(None), slice(None, -1), slice(1, None)
    for here, there in (((first, everything), (last, everything)), ((everything, first), (everything, last))):
        found = differ(here, there)
        marked[here] |= found
        marked[there] |= found
    return marked


def _near(edge: Bool[Tensor, "H W"], band_px: float) -> Bool[Tensor, "H W"]:
    """Mark pixels within the band; the edge itself runs half a pixel beside the centres of its marked pixels."""
    return distance_px(edge, max(band_px - 0.5, 0.0)).isfinite()


def _scaled(length_px: float, image: Tensor) -> float:
    return length_px * sqrt(image.shape[0] * image.shape[1] / _REFERENCE_PIXELS)
