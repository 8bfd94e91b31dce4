"""What a frame's light does at the points of a hand: features that are linear in its lamps and in its sky.

A relightable field gives every ray coefficients that do not depend on the light; a pixel's colour is the sum of
coefficients times these features. Shadows and what is spread inside the skin are computed per low-resolution ray; what
depends on the fine normal is evaluated at full size, from the direction and strength in which light arrives there.

All light is in units of the radiance of a white diffuse surface (irradiance / pi).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from . import brdf
from .brdf import bump_shadowing, clamped_reflection_normal, ggx, hidden_bumps, horizon_occlusion, squared_alphas
from .indirect_diffuse import IndirectDiffuse, MeshPoints, Surfels, indirect_diffuse, indirect_diffuse_on_mesh
from .lamp_samples import LampSamples
from .prefiltered_environment import PrefilteredEnvironment
from .samples import LightSamples
from .shadow_maps import PointShadows
from .sky_samples import SkySamples

SCATTER_M = (0.004, 0.0012)
"""Depths to which light enters the skin: long and short mean free paths (of red and blue light), template metres."""
WRAP = (0.7, 0.0)
"""How far light reaches around the surface by these depths: a share of the cosine."""
EVEN_LIGHT = (1.7, 1.25)
"""What light of radiance 1 from everywhere comes to at these depths: the scale of the coefficients."""
SCATTERED_SCALE = tuple(even / (1 + wrap) ** 2 for wrap, even in zip(WRAP, EVEN_LIGHT, strict=True))
"""Factors of the cosine plus `WRAP`, by which light from everywhere comes to `EVEN_LIGHT`."""
BELOW_HORIZON = -0.25
"""Cosine of a ray's normal and a lamp from which on none of its light counts: rays' normals are as coarse as faces."""
SKY_CELL_RAD = 0.6
"""Half the angle over which each of the sky's directions is spread where its share in a lobe is weighed: beyond its
cell, so that all are even."""
_TINY = 1e-8


class SurfelIrradiance(NamedTuple):
    """What P surfels (`light.indirect_diffuse`) receive from a light whose sky has K directions, and L lamps.

    Attributes:
        surfels: the skin.
        albedo: [P, 3], or [3] of all.
        of_sky: [K, P] their diffuse light for a flux of 1 from each direction.
        of_lamps: [L, P] the same for each lamp's rgb.
        besides: [P, 3] what they receive of nearby geometry; None: nothing.
    """

    surfels: Surfels
    albedo: Tensor
    of_sky: Tensor
    of_lamps: Tensor
    besides: Tensor | None = None

    def received(self, light: LightSamples) -> Float[Tensor, "P 3"]:
        """Compute the diffuse light that arrives, as the radiance of a white surface."""
        of_sky = (self.of_sky[..., None] * light.sky.flux[:, None]).sum(0)  # a product of matrices may differ by a bit
        received = of_sky + (self.of_lamps[..., None] * light.lamps.rgb[:, None]).sum(0)
        return received if self.besides is None else received + self.besides

    def mean_received(self, light: LightSamples) -> Float[Tensor, " C"]:
        """Compute the mean of the arriving diffuse light over the skin."""
        share = self.surfels.area_m2 / self.surfels.area_m2.sum()
        return (share[:, None] * self.received(light)).sum(0)

    def emitted(self, light: LightSamples) -> Float[Tensor, "P 3"]:
        """Compute the radiance of the surfels."""
        return self.albedo * self.received(light)


class FrameShadows(NamedTuple):
    """The shadows of a light whose sky has K directions and which has L lamps.

    Attributes:
        sky: of the sky's directions at R points.
        lamps: of the lamps' samples at R points.
        surfels: the skin, for indirect diffuse light on these points.
    """

    sky: PointShadows
    lamps: PointShadows
    surfels: SurfelIrradiance


class SurfacePoints(NamedTuple):
    """Where R rays meet the skin.

    Attributes:
        position: [R, 3] m, world.
        normal: [R, 3] unit, of the mesh.
        relief_normal: [R, 3] unit, with the learnt relief.
        view: [R, 3] unit, from the camera.
        hit_points: on the mesh.
    """

    position: Tensor
    normal: Tensor
    relief_normal: Tensor
    view: Tensor
    hit_points: MeshPoints

    @classmethod
    def of(cls, surfels: Surfels) -> SurfacePoints:
        """Take surfels for points of the skin, seen straight on."""
        position, normal = surfels.position, surfels.normal
        first = torch.zeros(len(position), 3, device=position.device)
        first[:, 0] = 1
        return cls(position, normal, normal, -normal, MeshPoints(surfels.chosen[:, None].expand(-1, 3), first))


class AmbientOcclusion(NamedTuple):
    """Of R points: the share [R] of the sky that they see, weighted by the cosine, and its mean direction [R, 3]."""

    share: Tensor
    towards: Tensor


class LightFeatures(NamedTuple):
    """What light does at R points, for L lamps.

    Attributes:
        lamp_vectors: [R, L, 3] direction times strength in which each lamp's unshadowed light arrives, for an rgb of 1.
        lamp_rgb: [L, 3].
        lamp_radius_rad: [L] half the angle of each lamp.
        sky_vectors: [R, 3, 3] the same of the sky, for each colour.
        lobe_visibility: [R, 2] the share of the sky's gloss that arrives in each lobe: what the hand and nearby
            geometry do not hide.
        mirrored: the whole sky.
        near_field_specular: [R, 2, 3] nearby geometry, in these lobes.
        scattered: [R, 2, 3] light that arrives inside the skin, at the two depths of `SCATTER_M`.
        arriving: [R, 3] factor of all of the above, where light was measured; else 1.
        reflected: [R, 3] light besides: indirect diffuse, or what was measured, as the radiance of a white diffuse
            surface.
    """

    lamp_vectors: Tensor
    lamp_rgb: Tensor
    lamp_radius_rad: Tensor
    sky_vectors: Tensor
    lobe_visibility: Tensor
    mirrored: PrefilteredEnvironment
    near_field_specular: Tensor
    scattered: Tensor
    arriving: Tensor
    reflected: Tensor


class DirectFeatures(NamedTuple):
    """What arrives at R points from lamps and sky; as in `LightFeatures`."""

    lamp_vectors: Tensor
    sky_vectors: Tensor
    lobe_visibility: Tensor
    scattered: Tensor

    def with_indirect(
        self,
        light: LightSamples,
        skin: SurfelIrradiance,
        points: SurfacePoints,
        indirect: IndirectDiffuse = indirect_diffuse,
    ) -> LightFeatures:
        """Add what the skin reflects on the points, by `indirect_diffuse` or what equals it."""
        position, (sky, lamps) = points.position, light
        at_points = points.hit_points, position, points.normal
        return LightFeatures(
            lamp_vectors=self.lamp_vectors,
            lamp_rgb=lamps.rgb,
            lamp_radius_rad=lamps.radius_rad,
            sky_vectors=self.sky_vectors,
            lobe_visibility=self.lobe_visibility,
            mirrored=sky.mirrored,
            near_field_specular=position.new_zeros(len(position), 2, 3),
            scattered=self.scattered,
            arriving=torch.ones_like(position),
            reflected=indirect_diffuse_on_mesh(*at_points, skin.surfels, skin.emitted(light), indirect),
        )


def ambient_occlusion(sky: SkySamples, shadows: PointShadows, normal: Float[Tensor, "R 3"]) -> AmbientOcclusion:
    """Compute the ambient occlusion of points with these normals."""
    seen = shadows.lit * (sky.towards @ normal.T).clamp_(min=0)
    share = seen.sum(0) * (4 / len(sky.towards))
    return AmbientOcclusion(share, torch.nn.functional.normalize(seen.T @ sky.towards, dim=-1))


def light_features(light: LightSamples, shadows: FrameShadows, points: SurfacePoints) -> LightFeatures:
    """Compute the light features of points, without gradients: those that depend on normals vary slowly with them."""
    sky, lamps = light
    position, normal, relief_normal, view = (values.detach() for values in points[:-1])
    points = SurfacePoints(position, normal, relief_normal, view, points.hit_points)
    towards, strength = lamps.arriving(points.position)
    lit = _unblocked(lamps, shadows.lamps)
    depth_in_m = lamps.shadow[:, None] * shadows.lamps.depth_in_m
    of_lamps = _scattered(towards, strength, depth_in_m, points.normal)
    # What is far below the horizon must not weigh against the rest; close to it, a pixel's own normal decides.
    faces = (towards * points.relief_normal).sum(-1) > BELOW_HORIZON
    vectors = towards * (strength * lit * faces)[..., None]
    count = len(lamps.rgb)
    summed = [
        values.new_zeros(count, *values.shape[1:]).index_add(0, lamps.lamp, values) for values in (vectors, of_lamps)
    ]
    sky_towards = sky.towards[:, None].expand(-1, len(points.position), -1)
    of_sky = _scattered(sky_towards, torch.ones_like(shadows.sky.lit), shadows.sky.depth_in_m, points.normal)
    facing = (sky.towards @ points.relief_normal.T > 0) * shadows.sky.lit
    direct = DirectFeatures(
        lamp_vectors=summed[0].transpose(0, 1),
        sky_vectors=torch.einsum("kr,kx,kc->rxc", facing, sky.towards, sky.flux),
        lobe_visibility=_lobe_visibility(sky, shadows.sky.lit, points),
        scattered=torch.einsum("lrs,lc->rsc", summed[1], lamps.rgb) + torch.einsum("krs,kc->rsc", of_sky, sky.flux),
    )
    return direct.with_indirect(light, shadows.surfels, points)


def irradiance_at_surfels(
    light: LightSamples, sky: PointShadows, lamps: PointShadows, surfels: Surfels
) -> tuple[Float[Tensor, "K P"], Float[Tensor, "L P"]]:
    """Compute `of_sky` and `of_lamps` of `SurfelIrradiance`, by the shadows at the surfels."""
    towards, strength = light.lamps.arriving(surfels.position)
    facing = (towards * surfels.normal).sum(-1).clamp(min=0)
    of_samples = strength * _unblocked(light.lamps, lamps) * facing
    of_lamps = of_samples.new_zeros(len(light.lamps.rgb), of_samples.shape[1]).index_add(
        0, light.lamps.lamp, of_samples
    )
    return sky.lit * (light.sky.towards @ surfels.normal.T).clamp(min=0), of_lamps


def _unblocked(lamps: LampSamples, shadows: PointShadows) -> Float[Tensor, "K P"]:
    """Compute the share of each sample's light that arrives; all of it from lamps that cast no shadows."""
    return lamps.shadow[:, None] * shadows.lit + (1 - lamps.shadow[:, None])


def _scattered(
    towards: Float[Tensor, "K R 3"],
    strength: Float[Tensor, "K R"],
    depth_in_m: Float[Tensor, "K R"],
    normal: Float[Tensor, "R 3"],
) -> Float[Tensor, "K R 2"]:
    """Compute the light of each sample that arrives inside the skin: around the terminator, through thin parts."""
    around = around_surface((towards * normal).sum(-1))
    decayed = torch.stack([torch.exp(-depth_in_m / scatter_m) for scatter_m in SCATTER_M], -1)
    return strength[..., None] * around * decayed


def around_surface(cosine: Float[Tensor, "*n"]) -> Float[Tensor, "*n 2"]:
    """Compute what arrives at both depths of a light of strength 1, by the cosine of its direction and the normal."""
    scales = zip(WRAP, SCATTERED_SCALE, strict=True)
    return torch.stack([scale * (cosine + wrap).clamp(min=0) for wrap, scale in scales], -1)


def _lobe_visibility(sky: SkySamples, lit: Float[Tensor, "K R"], points: SurfacePoints) -> Float[Tensor, "R 2"]:
    """Compute the share of the sky in each lobe that nothing hides."""
    towards = sky.towards[:, None].expand(-1, len(points.view), -1)
    lobes = ggx(points.relief_normal, towards, points.view, sky.flux.new_full((), SKY_CELL_RAD))
    bright = lobes * sky.brightness[:, None, None]
    return (bright * lit[..., None]).sum(0) / bright.sum(0).clamp(min=_TINY)


UNUSED, SCATTERED, DIFFUSE, GLOSS = slice(0, 3), slice(3, 9), slice(9, 12), slice(12, 14)
"""Where these lie among the coefficients. The first were of a mean light, which nothing reads any more."""
SMOOTH = 6
"""The first coefficients, to light deep in the skin, have no detail."""
COEFFICIENTS = 14
RELIGHTABLE_FEATURES = 16
"""Features of a ray for super-resolution, beside its coefficients."""


class BumpMapping(NamedTuple):
    """The skin at P points whose normals are bump mapped.

    Attributes:
        surface_normal: [P, 3] unit, world, without what is bump mapped.
        blurred_normal: [P, 3] unit, world, with the relief that light shows which is scattered far.
        sharpness: [3] the share of the diffuse light of each colour that shows all relief; the rest shows the blurred.
        alpha_squared: [P] of the gloss of skin.
        nail: [P] 1 on nails, 0 on skin.
    """

    surface_normal: Tensor
    blurred_normal: Tensor
    sharpness: Tensor
    alpha_squared: Tensor
    nail: Tensor

    @classmethod
    def smooth(cls, normal: Float[Tensor, "P 3"]) -> BumpMapping:
        """Describe skin with these normals, without bump mapping and nails, and as glossy everywhere."""
        count = len(normal)
        squared = normal.new_full((count,), float(squared_alphas(None, None)[1]))
        return cls(normal, normal, normal.new_ones(3), squared, normal.new_zeros(count))

    @property
    def alphas_squared(self) -> Float[Tensor, "P 2"]:
        """Of both lobes."""
        tight, broad = squared_alphas(self.nail, self.alpha_squared)
        return torch.stack([torch.as_tensor(tight), torch.as_tensor(broad)], 1)


def shaded_colour(
    coefficients: Float[Tensor, "P 14"],
    normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    features: LightFeatures,
    skin: BumpMapping | None = None,
) -> Float[Tensor, "P 3"]:
    """Compute the scene-linear colours of P points, whose features are given for each.

    Args:
        coefficients: of the field, not negative; premultiplied by alpha if the colour is to be.
        normal: unit, world, with all relief.
        view: unit, from the camera.
        features: as `light_features`, at these points.
        skin: bump mapping of the avatar's surface; None: there is none.
    """
    return _colour_of_skin(coefficients, normal, view, features, skin or BumpMapping.smooth(normal))


def _colour_of_skin(
    coefficients: Float[Tensor, "P 14"],
    normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    features: LightFeatures,
    skin: BumpMapping,
) -> Float[Tensor, "P 3"]:
    strength = features.lamp_vectors.norm(dim=-1)
    towards = features.lamp_vectors / strength.clamp(min=_TINY)[..., None]
    surface, nail = skin.surface_normal, skin.nail
    mirroring = clamped_reflection_normal(normal, surface, view)
    steeper = clamped_reflection_normal(brdf.glossy_normal(normal, surface), surface, view)
    at_lamps = steeper[:, None], towards, view[:, None], features.lamp_radius_rad
    of_skin = nail, skin.alpha_squared, hidden_bumps(skin.alpha_squared), surface
    lobes = ggx(*at_lamps, *(values[:, None] for values in of_skin))
    lamps_mirrored = torch.einsum("plg,lc->pgc", lobes * strength[..., None], features.lamp_rgb)
    squared = skin.alphas_squared
    leaving = horizon_occlusion(mirroring, surface, view, squared)
    sky_mirrored = (
        features.mirrored.specular(mirroring, view, squared) * (leaving * features.lobe_visibility)[..., None]
    )
    specular = lamps_mirrored + sky_mirrored + features.near_field_specular
    scattering = coefficients[:, SCATTERED].reshape(-1, 2, 3)
    of_lamps, of_sky = _diffuse_light_of(skin, normal, towards, features)
    inside = coefficients[:, DIFFUSE] * (of_lamps + of_sky)
    # Light that enters a little deeper shows the relief, too.
    relief = of_lamps - lamps_on(features, surface)
    shallow = (features.scattered[:, 1] + SCATTERED_SCALE[1] * relief).clamp(min=0)
    inside = inside + scattering[:, 0] * features.scattered[:, 0] + scattering[:, 1] * shallow
    even, of_surface = (features.mirrored.of_even_light(bent, view, squared) for bent in (mirroring, surface))
    under = (1 - _of_lobes(even, nail)) / (1 - _of_lobes(of_surface, nail))
    direct = inside * under[:, None] + (coefficients[:, GLOSS, None] * specular).sum(1)
    # Gloss mirrors skin as well, which is about as bright around the mirrored view as everywhere.
    mirrored_skin = (coefficients[:, GLOSS] * even * leaving).sum(1, keepdim=True)
    return direct * features.arriving + (reflectance(coefficients) + mirrored_skin) * features.reflected


def _diffuse_light_of(
    skin: BumpMapping, normal: Float[Tensor, "P 3"], towards: Float[Tensor, "P L 3"], features: LightFeatures
) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 3"]]:
    """Compute the diffuse light of lamps, and of the sky."""
    both = (normal, skin.blurred_normal)
    sharp, blurred = (
        lamps_on(features, bent, bump_shadowing(bent[:, None], skin.surface_normal[:, None], towards)) for bent in both
    )
    sharp_sky, blurred_sky = (sky_on(features, bent) for bent in both)
    return torch.lerp(blurred, sharp, skin.sharpness), torch.lerp(blurred_sky, sharp_sky, skin.sharpness)


def _of_lobes(values: Float[Tensor, "P 2"], nail: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """Pick the first lobe's value on nails, the second's on skin: what gloss reflects does not enter (as in Cycles)."""
    return torch.lerp(values[:, 1], values[:, 0], nail)


def reflectance(coefficients: Float[Tensor, "P C"]) -> Float[Tensor, "P 3"]:
    """Compute the reflectance of diffuse light from coefficients; the albedo, if they are not premultiplied."""
    return coefficients[:, DIFFUSE] + coefficients[:, SCATTERED].reshape(-1, 2, 3).sum(1)


def diffuse_light(features: LightFeatures, normal: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    """Compute what a white diffuse surface with these normals reflects."""
    return lamps_on(features, normal) + sky_on(features, normal)


def lamps_on(
    features: LightFeatures, normal: Float[Tensor, "P 3"], share: Float[Tensor, "P L"] | None = None
) -> Float[Tensor, "P 3"]:
    """Compute `diffuse_light` of the lamps; of each one's light a share, all of it for None."""
    of_lamps = (features.lamp_vectors * normal[:, None]).sum(-1).clamp(min=0)
    return (of_lamps if share is None else of_lamps * share) @ features.lamp_rgb


def sky_on(features: LightFeatures, normal: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    """Compute `diffuse_light` of the sky."""
    return torch.einsum("px,pxc->pc", normal, features.sky_vectors).clamp(min=0)
