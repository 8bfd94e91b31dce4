"""Indirect light from nearby geometry, treated as a near-field environment.

Lamps, sky and the lit hand shine on the patches (`nearby_geometry`), which reflect it once on each other and then on
the hand. There it is treated as the sky's: it arrives from a direction, which the hand may hide, on diffuse, scattering
and glossy skin.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .brdf import ggx
from .indirect_diffuse import IndirectDiffuse, indirect_diffuse
from .lighting import LightFeatures, SurfacePoints, SurfelIrradiance, around_surface
from .nearby_geometry import Patches
from .prefiltered_environment import from_square, on_square
from .samples import LightSamples
from .shadow_maps import PointShadows
from .sky_samples import SkySamples

CELLS = 32
"""Side of the square on which the sphere of directions is laid out (`cell_of`)."""
_POINTS_AT_ONCE, _GPU_POINTS_AT_ONCE = 512, 1 << 14
"""As many as a CPU's cache holds, and as many as keep a GPU busy."""
# Patches are as wide as the sky's directions are apart: between these, visibility is interpolated.
_NEAREST, _SPREAD_RAD = 4, 0.3


class PatchIrradiance(NamedTuple):
    """What P patches receive from a light whose sky has K directions, and L lamps.

    Attributes:
        patches: diffuse.
        of_sky: [K, P] their diffuse light for a flux of 1 from each direction.
        of_lamps: [L, P] the same for each lamp's rgb.
    """

    patches: Patches
    of_sky: Tensor
    of_lamps: Tensor

    def emitted(
        self, light: LightSamples, skin: SurfelIrradiance, indirect: IndirectDiffuse = indirect_diffuse
    ) -> Float[Tensor, "P 3"]:
        """Compute the radiance of the patches, after one exchange among them and with the hand's light on them.

        Args:
            light: sampled.
            skin: of the hand, in that light.
            indirect: as `indirect_diffuse`.
        """
        patches = self.patches
        received = self.of_sky.T @ light.sky.flux + self.of_lamps.T @ light.lamps.rgb
        first = patches.albedo * received
        of_hand = indirect(patches.position, patches.normal, skin.surfels, skin.emitted(light))
        return first + patches.albedo * (patches.exchanged() @ first + of_hand)


class NearFieldFeatures(NamedTuple):
    """What is added to the `LightFeatures` of the same names."""

    sky_vectors: Tensor
    near_field_specular: Tensor
    scattered: Tensor

    def diffuse(self, normal: Float[Tensor, "R 3"]) -> Float[Tensor, "R 3"]:
        """Compute the near-field light that a white diffuse surface with these normals reflects."""
        return (self.sky_vectors * normal[..., None]).sum(1).clamp(min=0)

    def added_to(self, features: LightFeatures) -> LightFeatures:
        """Add the near-field light to the features."""
        return features._replace(**{name: getattr(features, name) + value for name, value in self._asdict().items()})


def near_field_light(
    patches: Patches, sky_visibility: PointShadows, emitted: Float[Tensor, "P 3"], points: SurfacePoints
) -> NearFieldFeatures:
    """Compute the near-field light of R points from patches; form factors add up to 1 at most, as in indirect diffuse.

    Args:
        patches: around the hand.
        sky_visibility: shadows of the sky by the hand alone, at the points.
        emitted: radiance of the patches.
        points: on the skin.
    """
    parts, at_once = [], _POINTS_AT_ONCE if emitted.device.type == "cpu" else _GPU_POINTS_AT_ONCE
    for index in torch.arange(len(points.position), device=emitted.device).split(at_once):
        some = (values[index].detach() for values in points[:-1])
        parts.append(_near_field_light(patches, sky_visibility.lit[:, index], emitted, *some))
    return NearFieldFeatures(*(torch.cat(values) for values in zip(*parts, strict=True)))


def _near_field_light(
    patches: Patches, occlusion: Tensor, emitted: Tensor, position: Tensor, normal: Tensor, relief: Tensor, view: Tensor
) -> NearFieldFeatures:
    towards, factors, distance = patches.factors(position)
    nearest, weights = (values[cell_of(towards)] for values in sky_cells(emitted.device))
    sky_visibility = occlusion.T.gather(1, nearest.flatten(1)).reshape(nearest.shape)
    factors = factors * (sky_visibility * weights).sum(-1)
    cosine = (towards * relief[:, None]).sum(-1)
    factors = factors / (factors * cosine.clamp(min=0)).sum(1, keepdim=True).clamp(min=1)
    radius_rad = (patches.area_m2 / torch.pi).sqrt() / distance
    lobes = ggx(relief[:, None], towards, view[:, None], radius_rad)
    around = around_surface((towards * normal[:, None]).sum(-1))
    return NearFieldFeatures(
        sky_vectors=torch.einsum("rp,rpx,pc->rxc", factors * (cosine > 0), towards, emitted),
        near_field_specular=torch.einsum("rpg,rp,pc->rgc", lobes, factors, emitted),
        scattered=torch.einsum("rp,rps,pc->rsc", factors, around, emitted),
    )


def cell_of(towards: Float[Tensor, "*n 3"]) -> Int[Tensor, "*n"]:
    """Find the cell of unit directions on the octahedral map of `CELLS` x `CELLS`."""
    column, row = (((value + 1) * (CELLS / 2)).long().clamp(0, CELLS - 1) for value in on_square(towards))
    return row * CELLS + column


@cache
def sky_cells(device: torch.device) -> tuple[Int[Tensor, "N 4"], Float[Tensor, "N 4"]]:
    """Find the sky's directions that are nearest to the middle of each cell, and their weights, whose sum is 1."""
    middle = (torch.arange(CELLS, device=device) + 0.5) * (2 / CELLS) - 1
    v, u = torch.meshgrid(middle, middle, indexing="ij")
    cosine, nearest = (from_square(u, v).reshape(-1, 3) @ SkySamples.of(None, device).towards.T).topk(_NEAREST)
    return nearest, torch.softmax((cosine - 1) / _SPREAD_RAD**2, 1)
