"""A rasteriser of Gaussian splats: elliptical weighted averages (Zwicker et al. 2001), composited in order.

As the common viewers have it: a Gaussian is projected by the affine approximation at its middle, widened by 0.3 px^2,
cut off at three standard deviations and left out where its opacity is below one step of 255; splats are ordered by
their distance from the camera.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...records.camera import Camera
from .gaussians import Splats

_WIDENED_PX2 = 0.3
_CUT = 3.0  # standard deviations
_LEAST_OPACITY, _MOST_OPACITY = 1 / 255, 0.99
_LEAST_TRANSMITTANCE = 1e-4
_NEAR_M = 0.01


class SplatWeights(NamedTuple):
    """How much each of N splats gives to each of P pixels, in K entries: what both are about is linear in these.

    Attributes:
        pixel: [K] int32, rows of pixels from the top.
        splat: [K] int32.
        weight: [K] float32; those of a pixel sum to its opacity.
        pixels: P.
        splats: N.
    """

    pixel: Tensor
    splat: Tensor
    weight: Tensor
    pixels: int
    splats: int

    def shown(self, values: np.ndarray) -> np.ndarray:
        """Sum what splats [N, C] give to the pixels: [P, C] float32."""
        return self._summed(values, self.splat, self.pixel, self.pixels)

    def gathered(self, picture: np.ndarray) -> np.ndarray:
        """Sum what pixels [P, C] give to the splats, the transpose of `shown`: [N, C] float32."""
        return self._summed(picture, self.pixel, self.splat, self.splats)

    def pruned(self, least: float) -> SplatWeights:
        """Leave out smaller weights."""
        kept = self.weight >= least
        return self._replace(pixel=self.pixel[kept], splat=self.splat[kept], weight=self.weight[kept])

    def squared(self) -> SplatWeights:
        """Square the weights."""
        return self._replace(weight=self.weight**2)

    def _summed(self, values: np.ndarray, of: Tensor, to: Tensor, count: int) -> np.ndarray:
        given = torch.as_tensor(values, dtype=torch.float32)
        terms = given[of] * self.weight[:, None]
        return torch.zeros(count, given.shape[1]).index_add_(0, to, terms).numpy()


class _Ellipses(NamedTuple):
    """M splats before the camera, the nearest first: rows of the splats, middles [M, 2] px, covariances [M, 3] px^2."""

    row: Tensor
    middle_px: Tensor
    covariance: Tensor


@torch.inference_mode()
def splat_weights(splats: Splats, camera: Camera) -> SplatWeights:
    """Compute how much each splat gives to each pixel: of colours, what `shown` returns is premultiplied."""
    ellipses = _projected(splats, camera)
    opacity = torch.as_tensor(splats.opacity, dtype=torch.float32)[ellipses.row]
    pixel, entry, alpha = _fragments(ellipses, opacity, camera.size_px)
    order = torch.sort(pixel, stable=True).indices  # keeps the order of distances within a pixel
    pixel, entry, alpha = pixel[order], entry[order], alpha[order]
    passed = torch.log1p(-alpha.double()).cumsum(0)
    before = passed - torch.log1p(-alpha.double())
    is_first = torch.ones_like(pixel, dtype=torch.bool)
    is_first[1:] = pixel[1:] != pixel[:-1]
    start = torch.cummax(torch.where(is_first, torch.arange(len(pixel)), 0), 0).values
    transmittance = torch.exp(before - before[start]).float()
    kept = transmittance >= _LEAST_TRANSMITTANCE
    width, height = camera.size_px
    entries = pixel[kept].int(), ellipses.row[entry[kept]].int(), (alpha * transmittance)[kept]
    return SplatWeights(*entries, pixels=width * height, splats=len(splats))


def rasterised(splats: Splats, camera: Camera) -> np.ndarray:
    """Draw splats: [H, W, 4] float32, sRGB-encoded colour on black, at most 1, and opacity."""
    width, height = camera.size_px
    weights = splat_weights(splats, camera)
    values = np.concatenate([splats.colors(camera.origin), np.ones((len(splats), 1))], 1).astype(np.float32)
    return weights.shown(values).reshape(height, width, 4).clip(0, 1)


def _projected(splats: Splats, camera: Camera) -> _Ellipses:
    tensors = (splats.positions, splats.rotations, splats.scales, camera.cam2world, camera.K)
    positions, rotations, scales, cam2world, K = (torch.as_tensor(one, dtype=torch.float32) for one in tensors)
    from_camera = positions - cam2world[:3, 3]
    row = torch.sort(from_camera.norm(dim=1), stable=True).indices
    in_camera = from_camera[row] @ cam2world[:3, :3]
    is_before = in_camera[:, 2] > _NEAR_M
    row, (x, y, z) = row[is_before], in_camera[is_before].unbind(1)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([K[0, 0] / z, zero, -K[0, 0] * x / z**2], 1),
            torch.stack([zero, K[1, 1] / z, -K[1, 1] * y / z**2], 1),
        ],
        1,
    )
    spread = jacobian @ cam2world[:3, :3].T @ _matrices(rotations[row]) * scales[row, None]
    covariance = spread @ spread.transpose(1, 2)
    widened = torch.stack(
        [covariance[:, 0, 0] + _WIDENED_PX2, covariance[:, 0, 1], covariance[:, 1, 1] + _WIDENED_PX2], 1
    )
    middle_px = torch.stack([K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]], 1)
    return _Ellipses(row, middle_px, widened)


def _fragments(ellipses: _Ellipses, opacity: Tensor, size_px: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor]:
    """Find (pixel, entry of the ellipses, alpha) of all pixels whose centre an ellipse covers, ordered by entry."""
    limit = torch.tensor(size_px)
    reach = _CUT * ellipses.covariance[:, [0, 2]].sqrt()
    first = (ellipses.middle_px - reach - 0.5).ceil().long().clamp(min=0)
    last = torch.minimum((ellipses.middle_px + reach - 0.5).floor().long(), limit - 1)
    extent = (last - first + 1).clamp(min=0)
    count = extent.prod(1)
    entry = torch.repeat_interleave(torch.arange(len(count)), count)
    within = torch.arange(len(entry)) - (count.cumsum(0) - count)[entry]
    column = first[entry, 0] + within % extent[entry, 0]
    row = first[entry, 1] + torch.div(within, extent[entry, 0], rounding_mode="floor")
    dx, dy = (torch.stack([column, row], 1) + 0.5 - ellipses.middle_px[entry]).unbind(1)
    xx, xy, yy = ellipses.covariance[entry].unbind(1)
    squared = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    alpha = (opacity[entry] * torch.exp(-squared / 2)).clamp(max=_MOST_OPACITY)
    kept = (squared <= _CUT**2) & (alpha >= _LEAST_OPACITY)
    return (row * size_px[0] + column)[kept], entry[kept], alpha[kept]


def _matrices(quaternions: Tensor) -> Tensor:
    w, x, y, z = quaternions.unbind(1)
    return torch.stack(
        [
            torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], 1),
            torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], 1),
            torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1),
        ],
        1,
    )
