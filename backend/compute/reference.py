"""The reference backend: every stage in plain torch, on any device, with gradients."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..field.conditions import FrameConditions
from ..field.field import MlpField, PlaneField
from ..field.rays import CameraTensors, HandInView, RenderedRays, SurfaceRays, split_rays, view_directions
from ..field.relightable import RelightableField
from ..field.sampler import SamplerConfig, first_hit
from ..field.shade import shade
from ..field.surface_tracking import trace
from ..field.volume import Composite
from ..geometry.local_rotation import local_rotations
from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..hand.lbs import skin_motion
from ..image.crop import hand_extent
from ..image.depth_steps import coefficients_at_steps, normals_at_steps
from ..image.edge_avoiding_filter import edge_avoiding_mean
from ..image.shading import (
    ShadingInputs,
    SurfaceDepth,
    shade_image,
    shading_inputs,
    shares_of_rays,
    smooth_enlarged_rays,
)
from ..light.indirect_diffuse import MeshPoints, indirect_diffuse
from ..light.lighting import AmbientOcclusion, SurfacePoints, ambient_occlusion, light_features
from ..light.near_field_light import near_field_light
from ..light.shadow_maps import Bounds, PointShadows, ShadowViews, look_up_reference, point_shadows
from ..light.visibility import lit_share_reference, visibility_transfer
from ..records.render_hooks import RenderHooks
from ..surface.detail_mesh import detail_mesh, visible_surface
from ..surface.edge_antialiasing import blended
from ..surface.ray_hits import ray_hits
from ..surface.shading_detail import detailed_image
from .precision import Precision, autocast, decoder_in_precision, in_precision
from .whole_frames import BakedFrameRenderer, BakedModel, LitFrameRenderer, LitModel

RayRenderer = Callable[[HandInView, FrameConditions, RenderHooks], RenderedRays]
"""Renders the low-resolution rays of one field, without gradients; what `RenderHooks.before_chunk` raises ends it."""


class ReferenceBackend:
    """The stages of a frame as `geometry`, `hand`, `light`, `field`, `image` and `surface` define them.

    This is the type of every backend: others inherit from it and override, with the same signatures, what they compute
    faster. Gradients are promised of `shade` alone.

    Attributes:
        frames_at_once: of a sequence, in threads that share the processor, where one by one would take longer.
        renders_whole_frames: whether it renders whole frames at once, and not only stage by stage.
    """

    frames_at_once = 1
    renders_whole_frames = False

    skin_motion = staticmethod(skin_motion)
    posed_mesh = staticmethod(posed_mesh)
    hand_extent = staticmethod(hand_extent)
    local_rotations = staticmethod(local_rotations)

    first_hit = staticmethod(first_hit)
    trace = staticmethod(trace)
    decoder = staticmethod(decoder_in_precision)

    lit_share = staticmethod(lit_share_reference)
    look_up = staticmethod(look_up_reference)
    ambient_occlusion = staticmethod(ambient_occlusion)
    light_features = staticmethod(light_features)
    mesh_points = staticmethod(MeshPoints.of)
    indirect_diffuse = staticmethod(indirect_diffuse)
    near_field_light = staticmethod(near_field_light)

    superres = staticmethod(in_precision)
    smooth_enlarged_rays = staticmethod(smooth_enlarged_rays)
    shares_of_rays = staticmethod(shares_of_rays)
    normals_at_steps = staticmethod(normals_at_steps)
    coefficients_at_steps = staticmethod(coefficients_at_steps)
    view_directions = staticmethod(view_directions)
    edge_avoiding_mean = staticmethod(edge_avoiding_mean)
    shade_image = staticmethod(shade_image)

    detail_mesh = staticmethod(detail_mesh)
    visible_surface = staticmethod(visible_surface)
    ray_hits = staticmethod(ray_hits)
    detailed_image = staticmethod(detailed_image)
    blended = staticmethod(blended)

    def lit_frames(self, model: LitModel) -> LitFrameRenderer:
        """Return what renders whole lit frames of a model, if `renders_whole_frames`."""
        raise NotImplementedError

    def baked_frames(self, model: BakedModel) -> BakedFrameRenderer:
        """Return what renders whole frames in a capture's light, if `renders_whole_frames`."""
        raise NotImplementedError

    @staticmethod
    def threads_of_frame(pixels: int) -> AbstractContextManager[None]:
        """Return a context for rendering a frame of this many pixels, in which threads are shared as suits it."""
        return nullcontext()

    def visibility(self, mesh: PosedMesh, topology: Topology) -> Float[Tensor, "V K"]:
        """Compute visibility, as `light.visibility.visibility_transfer`, by `lit_share`."""
        return visibility_transfer(mesh, topology, self.lit_share)

    def point_shadows(
        self,
        mesh: PosedMesh,
        faces: Int[Tensor, "F 3"],
        occluders: Float[Tensor, "T 3 3"],
        views: ShadowViews,
        points: Float[Tensor, "P 3"],
        map_px: int,
        bounds: Bounds | None = None,
    ) -> PointShadows:
        """Compute shadows at points, as `light.shadow_maps.point_shadows`, by `look_up`."""
        return point_shadows(mesh, faces, occluders, views, points, map_px, bounds, self.look_up)

    @staticmethod
    def shade(
        field: MlpField | PlaneField,
        rays: SurfaceRays,
        hand: HandInView,
        conditions: FrameConditions,
        shell_m: float,
    ) -> Composite:
        """Shade rays, as `field.shade.shade`, with gradients to the weights and, if required, to the geometry."""
        return shade(field, rays, hand, conditions, shell_m)

    @staticmethod
    def decoder_inputs(
        field: RelightableField, gathered: Composite, view: Float[Tensor, "R 3"], occlusion: AmbientOcclusion
    ) -> Float[Tensor, "R C"]:
        """Compute the decoder's inputs, as `RelightableField.decoder_inputs`."""
        return field.decoder_inputs(gathered, view, occlusion)

    def shading_inputs(
        self,
        superres: Callable[[Tensor], Tensor],
        low: Composite,
        points: SurfacePoints,
        pixel: Int[Tensor, " R"],
        camera: CameraTensors,
        skin: SurfaceDepth,
    ) -> ShadingInputs:
        """Enlarge rays, as `image.shading.shading_inputs`, by `smooth_enlarged_rays` and what follows it above."""
        parts = self.smooth_enlarged_rays, self.shares_of_rays, self.normals_at_steps, self.view_directions
        return shading_inputs(superres, low, points, pixel, camera, skin, *parts, self.coefficients_at_steps)

    def ray_renderer(self, field: MlpField | PlaneField, config: SamplerConfig, precision: Precision) -> RayRenderer:
        """Make a renderer of this field; weights must not change in use, nor a decoder's or super-resolution's."""
        return ChunkedRayRenderer(self, field, config, precision)


@dataclass(frozen=True)
class ChunkedRayRenderer:
    """Traces all rays with a backend, then shades them in chunks of `samples_per_chunk`, which bounds memory."""

    backend: ReferenceBackend
    field: MlpField | PlaneField
    config: SamplerConfig
    precision: Precision = "fp32"
    samples_per_chunk: int = 65536

    def __call__(self, hand: HandInView, conditions: FrameConditions, hooks: RenderHooks) -> RenderedRays:
        """Render rays, as `RayRenderer`."""
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
