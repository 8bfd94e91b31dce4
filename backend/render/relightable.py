"""The pipeline of a relightable avatar: a G-buffer that is kept while only the light changes, and its light.

    1 pose         `pipeline`, `posed_surface`      the mesh; the avatar's surface over it, if it has one
    2 crop, 3 rays, 4 field    `pipeline`           what the field gathers along the rays
    5 visibility   `light_visibility`               shadows of sky, lamps, the hand and nearby geometry
    6 light        `light_visibility`, `measured_light`    what arrives at the rays' points
    7 G-buffer     `gbuffer`                        coefficients, normals, alpha and depth at full size
    8 develop      image x light -> scene-linear, in the whole image

The G-buffer comes before the light: a lamp that moves costs its shadow maps and one product.

Training (`training.step`) takes the same stages with a loss at its end. It differs in what follows, and each difference
is explicit: in this module's calls, or an argument of the stage that is named. In brackets stands what frames lose on
six pictures by Cycles if they do as training does (33.00 dB as they are; `research/log`).

- Frames add rays where the field misses the avatar's surface, and fill transparent ones (`surface.hole_filling`; 0 dB).
- Of a ray beside an outline, frames ask its opacity which surface it shows (`shown` of `primary_hits` and of
  `skin_at_full_size`); training takes the nearer one, for it keeps points and shadows while opacities are learnt (.01).
- Pixels take light from rays at their own depth (`skin` of `RelightableNetworks.enlarged`): in frames at that of the
  avatar's surface, in training at that of the mesh (.25).
- Where the surface stands far off the mesh, both trace the moved mesh (`SurfaceInView.met`), but frames look up the
  field on it as well, and training on the mesh (.17 if frames do not trace it either).
- Frames smooth light over neighbouring rays (`features` here), training does not (`LightVisibility.features`): frames
  would gain .14, and show the steps of soft shadows.
- For indirect diffuse, frames take the albedo at each vertex (`albedo`), training the mean of what a view shows
  (`LightVisibility.with_albedo`), as its field changes at every step: frames would gain .07.
- Frames that are kept take more samples of soft lamps on the rays than on the surfels (`at_surfels` of
  `light_visibility`); training takes the fewer for both (.02).
- Only frames blend the edges of parts (.33), draw hair and take light that was measured.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..compute.precision import Precision
from ..field.relightable import RelightableField
from ..field.sampler import SamplerConfig
from ..image.decode import linear_frame
from ..image.edge_avoiding_filter import RaySurfacePoints, smoothed_light
from ..image.maps import depth_profile
from ..image.shading import ShadingInputs, SurfaceDepth, doubled
from ..light.lamp_samples import LampSamples
from ..light.lighting import LightFeatures
from ..light.samples import LightSamples
from ..records.frame import Frame, empty_frame
from ..records.light import Light
from ..records.shot import Shot, SurfaceMesh
from ..surface.hairs import visible_hairs, with_hairs
from ..surface.hole_filling import add_missing_rays, inpaint
from ..surface.soft_borders import SoftBorders
from .albedo import vertex_albedo
from .avatar_surface import avatar_surface_of
from .gbuffer import DecodedRays, GBuffer, RelightableNetworks, SurfaceLayer
from .light_visibility import NO_OCCLUDERS, LightVisibility, light_visibility, sky_shadows
from .lit_shots import LitShots, light_of
from .measured_light import AtRays, measured_at
from .pipeline import Pipeline, PosedShot
from .posed_surface import SurfaceInView, SurfacePoser
from .primary_hits import LampShadowCasters, PrimaryHits, primary_hits, skin_at_full_size
from .progress import RenderProgress


class _LastGBuffer(threading.local):
    """Of each thread, the last G-buffer that it rendered, for the next light that falls on it; None before."""

    gbuffer: GBuffer | None = None


@dataclass(frozen=True)
class RelightablePipeline(Pipeline):
    """Renders frames in the shot's light, or in the capture's.

    Attributes:
        has_skin_detail: whether outline, normals and detail are those of the avatar's surface, if it has one.
    """

    has_skin_detail: bool = True

    def render(self, shot: Shot, progress: RenderProgress) -> Frame:
        """Render a frame; raises what `Renderer.render` raises."""
        if self.renders_at_once:
            progress.begin("pose")
            frame = self.at_once(shot)
            if frame is not None:
                return frame
        gbuffer = self.gbuffer_of(shot, progress)
        if gbuffer is None:
            return empty_frame(shot.camera.size_px)
        with self.backend.threads_of_frame(gbuffer.crop.pixels):
            return replace(self.developed(gbuffer, self.lit(gbuffer, shot)), is_lit=shot.light is not None)

    def gbuffer_of(self, shot: Shot, progress: RenderProgress) -> GBuffer | None:
        """Return this thread's last G-buffer if it shows the shot, else render it; None: no hand is in the picture."""
        progress.begin("pose")
        gbuffer = self._last.gbuffer
        if gbuffer is None or not gbuffer.shows(shot):
            posed = self.posed(shot)
            if posed is None:
                return None
            gbuffer = self._last.gbuffer = self.gbuffer(posed, progress)
        progress.begin("light")
        return gbuffer

    def lit(self, gbuffer: GBuffer, shot: Shot) -> LightFeatures:
        """Return what the shot's light, or the avatar's own, does at the rays' points."""
        light = light_of(shot, self.avatar)
        return self.features(gbuffer, self.visibility(gbuffer, light), light)

    def gbuffer(self, posed: PosedShot, progress: RenderProgress) -> GBuffer:
        """Render all that does not depend on the light."""
        with self.backend.threads_of_frame(posed.crop.pixels):
            conditions = self.conditions(posed, posed.hand.mesh.vertices.new_zeros(len(posed.shot.vertices), 0))
            progress.begin("rasterise")
            surface = None if self.surface is None else self.surface.posed(posed.shot, posed.hand)
            rays = self.rays(posed.hand if surface is None else surface.met(posed.hand), conditions, progress)
            progress.begin("light")
            rays, hits = (rays, None) if surface is None else add_missing_rays(rays, surface.hits)
            met = primary_hits(self.backend, posed.hand, rays, hits, rays, self.backend.mesh_points)
            sky_visibility = sky_shadows(self.backend, met.hand, NO_OCCLUDERS.to(self.device), met.position)
            progress.begin("field")
            networks = self._networks_of(posed.shot, progress)
            decoded = networks.decoded(met, rays.composite, sky_visibility)
            progress.begin("superres")
            if surface is None:
                layer, skin = None, skin_at_full_size(self.backend, posed.hand, rays)
                image = networks.enlarged(met, decoded, skin)
                profile = depth_profile(rays._replace(composite=decoded.low), posed.crop, posed.shot.camera.size_px)
            else:
                image, layer = self._on_surface(met, surface, decoded, networks)
                profile = None
            rest = decoded.points, sky_visibility, image, self._skin_albedo, profile, layer
            return GBuffer(posed.shot, posed.crop, met, *rest)

    def visibility(self, gbuffer: GBuffer, light: Light) -> LightVisibility:
        """Cast the shadows of a light."""
        samples = LightSamples.of(light, gbuffer.bounds)
        # Indirect diffuse light is soft whatever its shadows.
        at_surfels = LampSamples.of(light.lamps, gbuffer.bounds) if light.shadow_quality == "fine" else None
        hand, position, albedo = gbuffer.met.hand, gbuffer.met.position, gbuffer.albedo
        given = samples, position, gbuffer.sky_visibility, albedo, at_surfels, _lamp_skins(gbuffer, light)
        return light_visibility(self.backend, hand, light, *given)

    def features(self, gbuffer: GBuffer, visibility: LightVisibility, light: Light) -> LightFeatures:
        """Return what the light does at the rays' points, smoothed over neighbours on the same surface."""
        hand, points, means = gbuffer.met.hand, gbuffer.points, self.backend.edge_avoiding_mean
        hit_points = RaySurfacePoints.of(points, gbuffer.met.pixel, hand.camera.size_px, hand.mesh.scale)
        features = smoothed_light(visibility.features(points, self.backend), hit_points, means)
        if light.measured is None:
            return features
        direct, indirect = measured_at(light.measured, gbuffer.crop, gbuffer.met.pixel, gbuffer.shot.camera.size_px)
        at_rays = AtRays(gbuffer.is_measured(light.measured), hit_points, means)
        return at_rays.corrected(features, points.normal, direct, indirect)

    def colours(self, gbuffer: GBuffer, features: LightFeatures) -> Float[Tensor, "3 H W"]:
        """Return scene-linear colours of the crop's skin, premultiplied by alpha."""
        image, met = gbuffer.image, gbuffer.met
        colours = self.backend.shade_image(image, features, met.pixel, met.hand.camera.size_px)
        if gbuffer.layer is None:
            return colours
        return self.backend.blended(colours, image.alpha, image.depth, gbuffer.layer.edges)

    def developed(self, gbuffer: GBuffer, features: LightFeatures) -> Frame:
        """Return the frame in a light."""
        colours, alpha, depth = self.colours(gbuffer, features), gbuffer.image.alpha, gbuffer.image.depth
        hairs = None if gbuffer.layer is None else gbuffer.layer.hairs
        if hairs is not None:
            colours, alpha = with_hairs(colours, alpha, hairs, features)
            depth = hairs.depth
        return linear_frame(colours, alpha, depth, gbuffer.crop, gbuffer.shot.camera.size_px, gbuffer.profile)

    @torch.inference_mode()
    def posed_surface(self, shot: Shot) -> SurfaceMesh | None:
        """Return the avatar's surface as frames that are kept show it; None: it has none."""
        if self.surface is None:
            return None
        fine = self.surface.mesh(shot.pose, self.mesh(shot), self.topology_of(shot).frames)
        return SurfaceMesh(fine.vertices.cpu().numpy(), fine.faces.cpu().numpy())

    def forget(self) -> None:
        """Forget this thread's G-buffer."""
        self._last.gbuffer = None

    @property
    def sampler(self) -> SamplerConfig:
        """How rays that meet the hand are sampled."""
        config = self.avatar.config.sampler
        return config if self.surface is None else config.at_surface

    @property
    def mean_albedo(self) -> np.ndarray:
        """[3] linear diffuse reflectance of the skin."""
        return self._vertex_albedo.mean(0)

    @cached_property
    def surface(self) -> SurfacePoser | None:
        """The avatar's surface; None: it has none, or it is not wanted."""
        skin = avatar_surface_of(self.avatar, self.device) if self.has_skin_detail else None
        return None if skin is None else SurfacePoser(skin, self.hand, self.device, self.backend)

    def _on_surface(
        self, met: PrimaryHits, surface: SurfaceInView, rays: DecodedRays, networks: RelightableNetworks
    ) -> tuple[ShadingInputs, SurfaceLayer]:
        """Return the image with the outline and the detail of the avatar's surface, and that surface's layer."""
        full, edge_m = doubled(met.hand.camera), met.mesh_depth.edge_m
        assert met.hits is not None
        low = inpaint(rays.low, met.pixel, met.hand.camera.size_px, met.hits, edge_m)
        low = self._borders.softened(low, met.pixel, met.hand.camera, met.hit_points, met.hits, edge_m)
        rays = rays._replace(low=low)
        seen = self.backend.visible_surface(surface.shown, full)
        image = networks.enlarged(met, rays, SurfaceDepth(seen.depth, edge_m))
        image = self.backend.detailed_image(image, seen, surface.shown, full, surface.maps)
        if surface.pale is not None:
            image = surface.pale.paled(image, seen, surface.shown, full)
        hairs = None if surface.hairs is None else visible_hairs(surface.hairs, full, image.depth, met.pixel)
        return image, SurfaceLayer(
            met.on_surface(surface.mesh), SurfaceDepth(surface.hits.depth, edge_m), seen.edges, hairs
        )

    def _networks_of(self, shot: Shot, progress: RenderProgress) -> RelightableNetworks:
        precision = self.precision_of(shot)
        if precision not in self._networks:
            field, superres = self.field, self.copied(self.avatar.superres)
            assert isinstance(field, RelightableField)
            self._networks[precision] = RelightableNetworks.of(field, superres, self.backend, precision)
        networks = self._networks[precision]
        return replace(networks, superres=progress.cancellable(networks.superres))

    @cached_property
    def _shots(self) -> LitShots | None:
        """What renders frames at once; None: the avatar has no surface, or it is not wanted."""
        return LitShots.of(self.avatar, self.hand, self.backend) if self.has_skin_detail else None

    @cached_property
    def _networks(self) -> dict[Precision, RelightableNetworks]:
        """In the precisions that have been asked for."""
        return {}

    @cached_property
    def _borders(self) -> SoftBorders:
        return SoftBorders.of(self.hand.f, self.hand.vt[self.hand.ft])

    @cached_property
    def _vertex_albedo(self) -> np.ndarray:
        return vertex_albedo(self.avatar, self.hand)

    @cached_property
    def _skin_albedo(self) -> Tensor:
        return self.tensor(self._vertex_albedo)

    @cached_property
    def _last(self) -> _LastGBuffer:
        return _LastGBuffer()


def _lamp_skins(gbuffer: GBuffer, light: Light) -> LampShadowCasters | None:
    """Choose the skins that cast lamps' shadows; of what moves, the mesh's own faces, corners on the surface."""
    if gbuffer.layer is None:
        return None
    if gbuffer.shot.quality == "final":
        return gbuffer.layer.hit.shadow_casters(light.shadow_quality == "fine")
    rough = gbuffer.layer.hit.shadow_caster(gbuffer.met.hand.topology.faces)
    return LampShadowCasters(rough, rough)
