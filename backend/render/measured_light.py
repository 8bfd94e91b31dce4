"""Light that a path tracer measured on the bare hand, at the rays of a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from ..image.crop import Crop
from ..image.edge_avoiding_filter import EdgeAvoidingMean, RaySurfacePoints, edge_avoiding_mean
from ..light.lighting import LightFeatures, diffuse_light
from ..records.light import MeasuredLight

# Sides, in measured pixels, of the squares whose mean is taken: the next larger one where the smaller hardly shows the
# hand, as for rays that pass beside the bare mesh, through the shell.
_SIDES = (3, 9, 27)
_STRIDES = (1, 2, 4)  # of the passes of `without_noise`, in rays
# Of a square; of less, the path tracer's few samples are noise.
_LEAST_COVERED = 0.2
_LEAST_KNOWN = 1e-3  # of the weights about a ray
_TINY = 1e-6
# Of the mean light, and how much brighter than ours measured light may be before it counts as another.
_NEXT_TO_NOTHING, _MOST_ARRIVING = 0.02, 1.1
_DARKEST = 1e-8


def measured_at(
    measured: MeasuredLight, crop: Crop, pixel: Tensor, size_px: tuple[int, int]
) -> tuple[Float[Tensor, "R 3"], Float[Tensor, "R 3"]]:
    """Average direct and indirect light at rays over the hand's measured pixels around each, for they are noisy.

    Args:
        measured: of the whole image.
        crop: of the image, in whose low resolution the rays lie.
        pixel: of the rays, in the crop.
        size_px: of the whole image.
    """
    colours = np.concatenate([measured.direct, measured.indirect], -1) * measured.alpha[..., None]
    maps = np.concatenate([colours, measured.alpha[..., None]], -1).astype(np.float32)
    image = torch.as_tensor(maps, device=pixel.device).permute(2, 0, 1)[None]
    x = 2 * (pixel % crop.width + crop.x0) + 1
    y = 2 * (torch.div(pixel, crop.width, rounding_mode="floor") + crop.y0) + 1
    # From 0..size to -1..1, where the borders of the image lie.
    place = torch.stack([x * (2 / size_px[0]) - 1, y * (2 / size_px[1]) - 1], -1)[None, None].float()
    found = image.mean((2, 3)).expand(len(pixel), -1)  # of the whole hand, where it is nowhere near
    for side in reversed(_SIDES):
        smooth = avg_pool2d(image, side, stride=1, padding=side // 2)
        values = grid_sample(smooth, place, padding_mode="border", align_corners=False)[0, :, 0].T
        found = torch.where(values[:, 6:] > _LEAST_COVERED, values, found)
    straight = found[:, :6] / found[:, 6:].clamp(min=_TINY)
    return straight[:, :3], straight[:, 3:]


class AtRays(NamedTuple):
    """Which rays may be given what was measured at their pixels.

    Attributes:
        shows: [R] whether the surface on which it was measured is there the one that a ray meets.
        hit_points: of the rays.
        means: over them.
    """

    shows: Tensor
    hit_points: RaySurfacePoints
    means: EdgeAvoidingMean = edge_avoiding_mean

    def filled(self, values: Float[Tensor, "R C"]) -> Float[Tensor, "R C"]:
        """Fill the rays without a measurement by means of those nearby on the same surface, if there are any.

        A mesh ends beside the surface that is seen: along outlines, light of the palm was that of the finger before.
        """
        shows = self.shows[:, None].to(values)
        known = torch.cat([values * shows, shows], 1)
        for stride in _STRIDES:
            known = self.means(known, self.hit_points, stride)
        share = known[:, -1:]
        return torch.where(self.shows[:, None] | (share < _LEAST_KNOWN), values, known[:, :-1] / share.clamp(min=_TINY))

    def corrected(
        self,
        features: LightFeatures,
        normal: Float[Tensor, "R 3"],
        direct: Float[Tensor, "R 3"],
        indirect: Float[Tensor, "R 3"],
    ) -> LightFeatures:
        """Return what a light does at the rays, as bright as what was measured there (`measured_at`)."""
        indirect = without_noise(self.filled(indirect), self.hit_points, self.means)
        features = corrected(features, normal, direct, indirect)
        of_rays = self.filled(torch.cat([features.arriving, features.reflected], 1))
        return features._replace(arriving=of_rays[:, :3], reflected=of_rays[:, 3:])


def without_noise(
    values: Float[Tensor, "R 3"], hit_points: RaySurfacePoints, means: EdgeAvoidingMean = edge_avoiding_mean
) -> Float[Tensor, "R 3"]:
    """Denoise what varies slowly over the skin, as indirect light does, by means over rays on the same surface.

    Three passes over 3 x 3 rays, each twice as far apart.
    """
    for stride in _STRIDES:
        values = means(values, hit_points, stride)
    return values


def corrected(
    features: LightFeatures, normal: Float[Tensor, "R 3"], direct: Float[Tensor, "R 3"], indirect: Float[Tensor, "R 3"]
) -> LightFeatures:
    """Correct the features by the light that was measured on a white surface at their points.

    Where less light arrives than ours, all of it is scaled down; what arrives besides, as from surfaces that emit, is
    taken for diffuse.

    Args:
        features: of the same light.
        normal: of the mesh, unit.
        direct: from lamps, sky and emitting surfaces.
        indirect: reflected by the scene and the hand.
    """
    ours = diffuse_light(features, normal)
    # Where ours is next to nothing, the ratio is next to meaningless: it tends to 1.
    floor = _NEXT_TO_NOTHING * ours.mean(0)
    arriving = ((direct + floor) / (ours + floor).clamp(min=_DARKEST)).clamp(0, _MOST_ARRIVING)
    besides = (direct - arriving * ours).clamp(min=0)
    return features._replace(arriving=arriving, reflected=indirect + besides)
