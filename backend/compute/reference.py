"""The reference backend: every stage in plain torch, on any device, with gradients."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ..field.conditions import FrameConditions
from ..field.field import MlpField, PlaneField
from ..field.rays import HandInView, RenderedRays, SurfaceRays, split_rays
from ..field.relightable import LitField
from ..field.sampler import SamplerConfig, first_hit
from ..field.shade import shade
from ..field.trace import trace
from ..field.volume import Composite
from ..geometry.local_rotation import local_rotations
from ..geometry.mesh import posed_mesh
from ..hand.lbs import skin_motion
from ..image.relighting import lit_image, relit
from ..image.surface_means import surface_means
from ..light.bounce import SkinPlaces, bounced
from ..light.lighting import Openness, light_features, openness
from ..light.shadow_maps import point_shadows
from ..light.surrounding_light import near_light
from ..light.visibility import visibility_transfer
from ..surface.fine_mesh import fine_mesh, seen_surface
from ..surface.part_edges import blended
from ..surface.ray_hits import ray_hits
from ..surface.skin_detail import detailed_image
from .backend import Precision, RayRenderer, RenderBackend, RenderHooks, autocast, decoder_in_precision, in_precision


class ReferenceBackend:
    """The stages as `geometry` and `field` define them."""

    frames_at_once = 1

    skin_motion = staticmethod(skin_motion)
    posed_mesh = staticmethod(posed_mesh)
    local_rotations = staticmethod(local_rotations)
    visibility = staticmethod(visibility_transfer)
    point_shadows = staticmethod(point_shadows)
    first_hit = staticmethod(first_hit)
    openness = staticmethod(openness)
    light_features = staticmethod(light_features)
    skin_places = staticmethod(SkinPlaces.of)
    bounced = staticmethod(bounced)
    near_light = staticmethod(near_light)
    surface_means = staticmethod(surface_means)
    decoder = staticmethod(decoder_in_precision)
    superres = staticmethod(in_precision)
    lit_image = staticmethod(lit_image)
    fine_mesh = staticmethod(fine_mesh)
    seen_surface = staticmethod(seen_surface)
    ray_hits = staticmethod(ray_hits)
    detailed_image = staticmethod(detailed_image)
    relit = staticmethod(relit)
    blended = staticmethod(blended)
    trace = staticmethod(trace)
    shade = staticmethod(shade)

    def threads_of_frame(self, pixels: int) -> AbstractContextManager[None]:
        """As the protocol: torch does everything, on all its threads."""
        return nullcontext()

    def decoder_inputs(
        self, field: LitField, gathered: Composite, view: Float[Tensor, "R 3"], open_to: Openness
    ) -> Float[Tensor, "R C"]:
        """As the protocol."""
        return field.decoder_inputs(gathered, view, open_to)

    def ray_renderer(self, field: MlpField | PlaneField, config: SamplerConfig, precision: Precision) -> RayRenderer:
        """As the protocol."""
        return ChunkedRayRenderer(self, field, config, precision)


@dataclass(frozen=True)
class ChunkedRayRenderer:
    """Traces all rays with a backend, then shades them in chunks of `samples_per_chunk`, which bounds memory."""

    backend: RenderBackend
    field: MlpField | PlaneField
    config: SamplerConfig
    precision: Precision = "fp32"
    samples_per_chunk: int = 65536

    def __call__(self, hand: HandInView, conditions: FrameConditions, hooks: RenderHooks) -> RenderedRays:
        """As `RayRenderer`."""
        hooks.on_stage("sample")
        rays = self.backend.trace(hand, self.config)
        hooks.on_stage("field")
        with autocast(rays.t.device, self.precision):
            composite = self.shade(rays, hand, conditions, hooks)
        return RenderedRays(rays.pixel, composite, rays.t, rays.dt)

    def shade(self, rays: SurfaceRays, hand: HandInView, conditions: FrameConditions, hooks: RenderHooks) -> Composite:
        """Query the field at traced rays, chunk by chunk."""
        parts = []
        for chunk in split_rays(rays, max(1, self.samples_per_chunk // rays.t.shape[1])):
            hooks.before_chunk()
            parts.append(self.backend.shade(self.field, chunk, hand, conditions, self.config.shell_m))
        return Composite(*(torch.cat(values) for values in zip(*parts, strict=True)))
