"""A relightable hand in one pose and view: what is rendered once, and what is rendered anew when the light changes.

Shadows of the hand upon itself, coefficients and their super-resolution are the same in every light. A lamp that moves
costs its shadow maps and one product; the sky's shadows change only with what stands around the hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import normalize

from ..compute.precision import Decoder
from ..compute.reference import ReferenceBackend
from ..field.rays import HandInView, RenderedRays, project, ray_directions
from ..field.relightable import LitField
from ..image.crop import Crop
from ..image.decode import linear_frame
from ..image.maps import depth_profile
from ..image.relighting import LitImage, SkinDepth, at_full_size, doubled
from ..image.surface_means import RayPlaces, smoothed_light
from ..light.lamp_samples import LampSamples
from ..light.light_samples import LightSamples
from ..light.lighting import LightFeatures, SurfacePoints, corrected
from ..light.shadow_maps import Bounds, PointShadows
from ..light.sky_samples import SkySamples
from ..records.depth_profile import DepthProfile
from ..records.frame import Frame
from ..records.light import Light, MeasuredLight
from ..records.render_hooks import OnStage
from ..records.shot import Shot
from ..surface.clear_rays import completed, filled, without_strays
from ..surface.detail_maps import DetailMaps
from ..surface.fine_mesh import FineMesh
from ..surface.hairs import PosedHairs, SeenHairs, seen_hairs, with_hairs
from ..surface.part_edges import PartEdges
from ..surface.ray_hits import RayHits
from .lit_rays import (
    NO_OCCLUDERS,
    HitSurface,
    LampSkins,
    features_among,
    light_shadows,
    occluding_triangles,
    ray_positions,
    shows_alone,
    skin_layers,
    sky_shadows,
    split_points,
    surface_points,
    surrounding_light,
    with_parts,
)
from .measured_light import AtRays, measured_at, without_noise


class PosedSkin(NamedTuple):
    """A person's known skin in a pose.

    Attributes:
        maps: of its detail.
        mesh: its surface.
        hits: where the rays of all low-resolution pixels meet that.
        hairs: on it; None: it shows none.
    """

    maps: DetailMaps
    mesh: FineMesh
    hits: RayHits
    hairs: PosedHairs | None = None


@dataclass(frozen=True)
class LitHand:
    """A hand at full size, in no light.

    Attributes:
        shot: what it shows; its light is not read.
        crop: of the image.
        hand: posed, in the low-resolution view.
        pixel: of the rays.
        points: where the rays meet the skin.
        skin: depth of the mesh at the low resolution's pixels.
        fine: that of the surface, where it is known.
        open_sky: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        image: coefficients and normals.
        edges: where one part of a known surface ends before or against another; None: it is not known.
        profile: of the rays; None: the image shows a surface that is known.
        albedo: [V, 3] of the skin at the mesh's vertices.
        surface: that the rays meet; None: it is not known.
        hairs: over the skin; None: there are none.
    """

    shot: Shot
    crop: Crop
    hand: HandInView
    pixel: Tensor
    points: SurfacePoints
    skin: SkinDepth
    fine: SkinDepth | None
    open_sky: PointShadows
    image: LitImage
    edges: PartEdges | None
    profile: DepthProfile | None
    albedo: Tensor
    surface: HitSurface | None
    hairs: SeenHairs | None = None

    def shows(self, shot: Shot) -> bool:
        """Whether a shot differs by its light at most."""
        ours, theirs = self.shot, shot
        return (
            ours.camera.size_px == theirs.camera.size_px
            and ours.pose.side == theirs.pose.side
            and (ours.hair, ours.is_moving) == (theirs.hair, theirs.is_moving)
            and np.array_equal(ours.vertices, theirs.vertices)
            and np.array_equal(ours.pose.theta, theirs.pose.theta)
            and np.array_equal(ours.camera.K, theirs.camera.K)
            and np.array_equal(ours.camera.cam2world, theirs.camera.cam2world)
        )

    @cached_property
    def bounds(self) -> Bounds:
        """Of the mesh."""
        return Bounds.of(self.hand.mesh)

    def is_measured(self, measured: MeasuredLight) -> Bool[Tensor, " R"]:
        """Whether the surface on which light was measured shows the skin that a ray meets, and no other beside it."""
        shown = self.fine if measured.on_surface and self.fine is not None else self.skin
        _, depth = project(self.hand.camera, self.points.position)
        return shows_alone(shown, depth, self.pixel, self.hand.camera.size_px)

    def features(self, backend: ReferenceBackend, light: Light) -> LightFeatures:
        """What a light does at the points."""
        samples, position = LightSamples.of(light, self.bounds), self.points.position
        occluders = occluding_triangles(light, position.device)
        of_sky = sky_shadows(backend, self.hand, occluders, position) if len(occluders) else self.open_sky
        of_sky = with_parts(of_sky, samples.sky, backend, self.hand, occluders, position)
        is_fine = light.penumbra == "fine"
        # Light that the hand sheds on itself is soft whatever its shadows.
        coarse = LampSamples.of(light.lamps, self.bounds) if is_fine else None
        skins = self._lamp_skins(is_fine)
        shadows = light_shadows(backend, self.hand, samples, occluders, position, of_sky, self.albedo, coarse, skins)
        places = RayPlaces.of(self.points, self.pixel, self.hand.camera.size_px, self.hand.mesh.scale)
        if light.measured is None:
            around = surrounding_light(backend, self.hand, samples._replace(lamps=coarse or samples.lamps), light)
            features = features_among(around, samples, shadows, self.open_sky, self.points, backend)
            return smoothed_light(features, places, backend.surface_means)
        features = backend.light_features(samples, shadows, self.points)
        features = smoothed_light(features, places, backend.surface_means)
        direct, indirect = measured_at(light.measured, self.crop, self.pixel, self.shot.camera.size_px)
        at_rays = AtRays(self.is_measured(light.measured), places, backend.surface_means)
        indirect = without_noise(at_rays.filled(indirect), places, backend.surface_means)
        features = corrected(features, self.points.normal, direct, indirect)
        of_rays = at_rays.filled(torch.cat([features.arriving, features.reflected], 1))
        return features._replace(arriving=of_rays[:, :3], reflected=of_rays[:, 3:])

    def _lamp_skins(self, is_fine: bool) -> LampSkins | None:
        """Of what moves, the mesh's own faces are fine enough, with their corners on the surface."""
        if self.surface is None:
            return None
        if not self.shot.is_moving:
            return self.surface.lamp_skins(is_fine)
        rough = self.surface.lamp_skin(self.hand.topology.faces)
        return LampSkins(rough, rough)

    def colours(self, backend: ReferenceBackend, features: LightFeatures) -> Float[Tensor, "3 H W"]:
        """Scene-linear colours of the crop's skin, premultiplied by alpha."""
        colours = backend.relit(self.image, features, self.pixel, self.hand.camera.size_px)
        if self.edges is None:
            return colours
        return backend.blended(colours, self.image.alpha, self.image.depth, self.edges)

    def frame(self, backend: ReferenceBackend, light: Light) -> Frame:
        """The hand in a light."""
        features, alpha, depth = self.features(backend, light), self.image.alpha, self.image.depth
        colours = self.colours(backend, features)
        if self.hairs is not None:
            colours, alpha = with_hairs(colours, alpha, self.hairs, features)
            depth = self.hairs.depth
        return linear_frame(colours, alpha, depth, self.crop, self.shot.camera.size_px, self.profile)


def render_lit_hand(
    shot: Shot,
    crop: Crop,
    hand: HandInView,
    rays: RenderedRays,
    field: LitField,
    superres: Callable[[Tensor], Tensor],
    backend: ReferenceBackend,
    decoder: Decoder,
    albedo: Float[Tensor, "V 3"],
    known: PosedSkin | None,
    on_stage: OnStage,
) -> LitHand:
    """Decode and enlarge the gathered rays of a relightable field; `albedo` as in `LitHand`; `known`, if it is."""
    device = rays.t.device
    on_stage("light")
    size_px = hand.camera.size_px
    rays, hits = (rays, None) if known is None else completed(rays, known.hits)
    directions = ray_directions(hand.camera, rays.pixel)
    view = normalize(directions, dim=-1)
    layers = skin_layers(backend, hand)
    skin = layers.seen_by(rays, size_px)
    position = ray_positions(hand, skin, rays.pixel, directions, rays.t, rays.dt, hits)
    places = layers.places(hand, skin, rays.pixel, position, hits, backend.skin_places)
    points = surface_points(field, rays.composite, position, view, places, hits)
    open_sky = sky_shadows(backend, hand, NO_OCCLUDERS.to(device), position)
    at_points, _ = split_points(open_sky, len(position))
    open_to = backend.openness(SkySamples.of(None, device), at_points, points.normal)
    on_stage("field")
    low = field.decode(rays.composite, view, open_to, decoder, backend.decoder_inputs)
    on_stage("superres")
    if known is None or hits is None:
        skin = skin_layers(backend, at_full_size(hand)).seen_by(rays, size_px)
        image = backend.lit_image(superres, low, points, rays.pixel, hand.camera, skin)
        profile, edges, surface = depth_profile(rays._replace(composite=low), crop, shot.camera.size_px), None, None
        hairs = None
    else:
        low = filled(low, rays.pixel, size_px, hits, skin.edge_m)
        full = doubled(hand.camera)
        seen = backend.seen_surface(known.mesh, full)
        at_pixels = skin._replace(depth=seen.depth)
        told = without_strays(points, low.alpha, hits, skin.edge_m)
        image = backend.lit_image(superres, low, told, rays.pixel, hand.camera, at_pixels)
        image = backend.detailed_image(image, seen, known.mesh, full, known.maps)
        profile, edges = None, seen.edges
        surface = HitSurface(known.mesh, hits.positions(hand.camera, directions, position))
        hairs = None if known.hairs is None else seen_hairs(known.hairs, full, image.depth, rays.pixel)
    of_mesh = SkinDepth(layers.mesh.depth, layers.edge_m)
    fine = None if known is None else of_mesh._replace(depth=known.hits.depth)
    rest = image, edges, profile, albedo, surface, hairs
    return LitHand(shot, crop, hand, rays.pixel, points, of_mesh, fine, open_sky, *rest)
