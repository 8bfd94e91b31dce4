"""What of a light reaches points of the skin: shadows by the hand itself and by nearby geometry, and their light.

`light_visibility` is the road of frames and of training alike. It depends on no network: training keeps what it
returns, in a byte each (`LightVisibility.packed`), and mixes the light anew at every step (`lit_by`).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..compute.reference import ReferenceBackend
from ..field.rays import HandInView
from ..light.indirect_diffuse import Surfels, surfel_vertices
from ..light.lamp_samples import LampSamples
from ..light.lighting import FrameShadows, LightFeatures, SurfacePoints, SurfelIrradiance, irradiance_at_surfels
from ..light.near_field_light import PatchIrradiance
from ..light.nearby_geometry import Patches
from ..light.samples import LightSamples
from ..light.shadow_maps import (
    CELL_MAP_PX,
    LAMP_MAP_PX,
    MAX_DEPTH_IN_M,
    SKY_MAP_PX,
    SOFT_MAP_PX,
    SURFEL_MAP_PX,
    Bounds,
    PointShadows,
    ShadowViews,
)
from ..light.sky_samples import SKY_DIRECTIONS, ShadowedSky, SkySamples
from ..records.light import Light
from .primary_hits import LampShadowCaster, LampShadowCasters

NO_OCCLUDERS = torch.zeros(0, 3, 3)


class LightVisibility(NamedTuple):
    """What of a sampled light reaches R points of the skin.

    Attributes:
        samples: the light.
        shadows: of sky and lamps at the points, by the hand and by occluders.
        sky_visibility: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        around: the light that nearby geometry receives; None: nothing does.
    """

    samples: LightSamples
    shadows: FrameShadows
    sky_visibility: PointShadows
    around: PatchIrradiance | None

    def lit_by(self, samples: LightSamples) -> LightVisibility:
        """Return the same visibility of other strengths of the same lamps and sky."""
        return self._replace(samples=samples)

    def with_albedo(self, albedo: Float[Tensor, " 3"]) -> LightVisibility:
        """Return the same on a hand whose skin has this albedo everywhere, for its indirect diffuse light."""
        surfels = self.shadows.surfels._replace(albedo=albedo)
        return self._replace(shadows=self.shadows._replace(surfels=surfels))

    def features(self, points: SurfacePoints, backend: ReferenceBackend) -> LightFeatures:
        """Compute the light features of the points, with near-field light from nearby geometry."""
        return features_with_nearby(self.around, self.samples, self.shadows, self.sky_visibility, points, backend)

    def packed(self) -> PackedVisibility:
        """Return the same in a byte for each share and depth, without the samples."""
        sky, lamps, surfels = self.shadows
        return PackedVisibility(_packed(sky), _packed(lamps), _packed(self.sky_visibility), surfels, self.around)


class PackedVisibility(NamedTuple):
    """A `LightVisibility` to be kept, by the same names."""

    sky: tuple[Tensor, Tensor]
    lamps: tuple[Tensor, Tensor]
    sky_visibility: tuple[Tensor, Tensor]
    surfels: SurfelIrradiance
    around: PatchIrradiance | None

    def unpacked(self, samples: LightSamples) -> LightVisibility:
        """Return the visibility of the light whose samples these are."""
        shadows = FrameShadows(_unpacked(self.sky), _unpacked(self.lamps), self.surfels)
        return LightVisibility(samples, shadows, _unpacked(self.sky_visibility), self.around)


def light_visibility(
    backend: ReferenceBackend,
    hand: HandInView,
    light: Light,
    samples: LightSamples,
    position: Float[Tensor, "R 3"],
    sky_visibility: PointShadows,
    albedo: Tensor,
    at_surfels: LampSamples | None = None,
    shadow_casters: LampShadowCasters | None = None,
) -> LightVisibility:
    """Cast the shadows of a light at points.

    Args:
        backend: computes them.
        hand: posed.
        light: whose occluders count, unless it was measured among them.
        samples: of it, or of several among the same occluders.
        position: of the points, m, world.
        sky_visibility: as in `LightVisibility`.
        albedo: as in `light_shadows`.
        at_surfels: as `lamps_on_surfels` there.
        shadow_casters: as there.
    """
    occluders = occluding_triangles(light, position.device)
    of_cells = sky_shadows(backend, hand, occluders, position) if len(occluders) else sky_visibility
    of_sky = with_parts(of_cells, samples.sky, backend, hand, occluders, position)
    shadows = light_shadows(backend, hand, samples, occluders, position, of_sky, albedo, at_surfels, shadow_casters)
    around = None
    if light.measured is None:
        emitted = samples if at_surfels is None else samples._replace(lamps=at_surfels)
        around = nearby_geometry_of(backend, hand, emitted, light)
    return LightVisibility(samples, shadows, sky_visibility, around)


def occluding_triangles(light: Light, device: torch.device) -> Float[Tensor, "T 3 3"]:
    """Return the triangles of nearby geometry, world, m."""
    return torch.as_tensor(light.occluders, dtype=torch.float32, device=device)


def sky_shadows(
    backend: ReferenceBackend, hand: HandInView, occluders: Float[Tensor, "T 3 3"], position: Float[Tensor, "R 3"]
) -> PointShadows:
    """Cast the shadows of the sky's cells at points and then at the surfels, whatever light comes from there."""
    views, of_cell = ShadowedSky.of(hand.light_quality.sky_directions, position.device)
    shadows = _distant_shadows(backend, hand, occluders, position, views, CELL_MAP_PX)
    if len(views.distance) == SKY_DIRECTIONS:
        return shadows
    return PointShadows(shadows.lit[of_cell], shadows.depth_in_m[of_cell])


def with_parts(
    of_cells: PointShadows,
    sky: SkySamples,
    backend: ReferenceBackend,
    hand: HandInView,
    occluders: Float[Tensor, "T 3 3"],
    position: Float[Tensor, "R 3"],
) -> PointShadows:
    """Add to given shadows of a sky's cells those of the parts of divided ones, as `sky_shadows`."""
    parts = torch.arange(SKY_DIRECTIONS, len(sky.towards), device=position.device)
    if not len(parts):
        return of_cells
    views = sky.views().chosen(parts)
    of_parts = _distant_shadows(backend, hand, occluders, position, views, SKY_MAP_PX)
    return PointShadows(*(torch.cat(values) for values in zip(of_cells, of_parts, strict=True)))


def _distant_shadows(
    backend: ReferenceBackend, hand: HandInView, occluders: Tensor, position: Tensor, views: ShadowViews, map_px: int
) -> PointShadows:
    vertices = hand.mesh.vertices
    points = torch.cat([position, vertices[surfel_vertices(len(vertices), hand.light_quality.surfels)]])
    return backend.point_shadows(hand.mesh, hand.topology.faces, occluders, views, points, map_px)


def light_shadows(
    backend: ReferenceBackend,
    hand: HandInView,
    light: LightSamples,
    occluders: Float[Tensor, "T 3 3"],
    position: Float[Tensor, "R 3"],
    of_sky: PointShadows,
    albedo: Tensor,
    lamps_on_surfels: LampSamples | None = None,
    shadow_casters: LampShadowCasters | None = None,
) -> FrameShadows:
    """Cast the shadows of a light at points, by the hand itself and by occluders.

    Args:
        backend: computes them.
        hand: posed.
        light: sampled.
        occluders: triangles of the scene, [T, 3, 3] m, world, that may shadow the points.
        position: of the points, m, world.
        of_sky: as `sky_shadows` gives them.
        albedo: of the skin, for indirect diffuse light, [V, 3] of the vertices or [3] of all.
        lamps_on_surfels: the lamps as they light the surfels, in fewer samples; None: as everywhere.
        shadow_casters: cast and take their shadows; None: the mesh does, at the points.
    """
    surfels, bounds = Surfels.of(hand.mesh, hand.topology, hand.light_quality.surfels), Bounds.of(hand.mesh)

    def cast(views: ShadowViews, skin: LampShadowCaster, map_px: int) -> PointShadows:
        return backend.point_shadows(skin.mesh, skin.faces, occluders, views, skin.position, map_px, bounds)

    def of_lamps(lamps: LampSamples, skins: LampShadowCasters, hard_px: int, soft_px: int) -> PointShadows:
        views, is_hard = lamps.views(bounds), lamps.is_hard
        if is_hard.all() or (skins.hard is skins.soft and hard_px == soft_px):
            return cast(views, skins.hard, hard_px)
        if not is_hard.any():
            return cast(views, skins.soft, soft_px)
        soft, hard = ((~is_hard).nonzero()[:, 0], is_hard.nonzero()[:, 0])
        parts = (cast(views.chosen(soft), skins.soft, soft_px), cast(views.chosen(hard), skins.hard, hard_px))
        order = torch.cat([soft, hard]).argsort()
        return PointShadows(*(torch.cat(values)[order] for values in zip(*parts, strict=True)))

    on_mesh = LampShadowCaster(hand.mesh, hand.topology.faces, position)
    at_surfels = on_mesh._replace(position=surfels.position)
    # Apart, for a map is as fine as its points are near.
    lamps = of_lamps(light.lamps, shadow_casters or LampShadowCasters(on_mesh, on_mesh), LAMP_MAP_PX, SOFT_MAP_PX)
    probe_light = light._replace(lamps=light.lamps if lamps_on_surfels is None else lamps_on_surfels)
    probe_lamps = of_lamps(probe_light.lamps, LampShadowCasters(at_surfels, at_surfels), SURFEL_MAP_PX, SURFEL_MAP_PX)
    sky, probe_sky = split_points(of_sky, len(position))
    of_probes = irradiance_at_surfels(probe_light, probe_sky, probe_lamps, surfels)
    of_discs = albedo if albedo.dim() == 1 else albedo[surfels.chosen]
    return FrameShadows(sky, lamps, SurfelIrradiance(surfels, of_discs, *of_probes))


def nearby_geometry_of(
    backend: ReferenceBackend,
    hand: HandInView,
    samples: LightSamples,
    light: Light,
) -> PatchIrradiance | None:
    """Find nearby geometry, and what it receives from a light; None: nothing there would reflect any.

    Args:
        backend: computes the shadows.
        hand: posed.
        samples: of the light, or of several among the same occluders.
        light: whose occluders count.
    """
    patches = Patches.around(light, hand.mesh.vertices)
    if len(patches.position) == 0:
        return None
    points, occluders = patches.points, occluding_triangles(light, patches.position.device)
    bounds = points.bounds_with(hand.mesh.vertices)

    def cast(views: ShadowViews, map_px: int) -> PointShadows:
        lifted = points.lifted(bounds, map_px)
        return backend.point_shadows(hand.mesh, hand.topology.faces, occluders, views, lifted, map_px, bounds)

    sky, lamps = cast(samples.sky.views(), SKY_MAP_PX), cast(samples.lamps.views(bounds), LAMP_MAP_PX)
    received = irradiance_at_surfels(samples, sky, lamps, points.surfels)
    return PatchIrradiance(patches, *(patches.mean(values) for values in received))


def features_with_nearby(
    around: PatchIrradiance | None,
    light: LightSamples,
    shadows: FrameShadows,
    sky_visibility: PointShadows,
    points: SurfacePoints,
    backend: ReferenceBackend,
) -> LightFeatures:
    """Compute a light's features at points, with near-field light on them and on the skin that lights them indirectly.

    Args:
        around: patches of nearby geometry and their irradiance, if there are any.
        light: sampled.
        shadows: at the points.
        sky_visibility: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        points: on the skin.
        backend: computes the features.
    """
    if around is None:
        return backend.light_features(light, shadows, points)
    skin = shadows.surfels
    emitted = around.emitted(light, skin, backend.indirect_diffuse)
    at_points, at_surfels = split_points(sky_visibility, len(points.position))
    on_probes = backend.near_field_light(around.patches, at_surfels, emitted, SurfacePoints.of(skin.surfels))
    skin = skin._replace(besides=on_probes.diffuse(skin.surfels.normal))
    features = backend.light_features(light, shadows._replace(surfels=skin), points)
    return backend.near_field_light(around.patches, at_points, emitted, points).added_to(features)


def split_points(shadows: PointShadows, count: int) -> tuple[PointShadows, PointShadows]:
    """Split the shadows into those at the first `count` points, and at the others."""
    lit, depth_in_m = shadows
    first = PointShadows(lit[:, :count], depth_in_m[:, :count])
    return first, PointShadows(lit[:, count:], depth_in_m[:, count:])


def _packed(shadows: PointShadows) -> tuple[Tensor, Tensor]:
    return (shadows.lit * 255).round().byte(), (shadows.depth_in_m * (255 / MAX_DEPTH_IN_M)).round().byte()


def _unpacked(packed: tuple[Tensor, Tensor]) -> PointShadows:
    lit, depth_in = packed
    return PointShadows(lit.float() / 255, depth_in.float() * (MAX_DEPTH_IN_M / 255))
