"""Low-resolution rays of a field of planes: traced, queried and composited by kernels, then decoded by torch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from ...field.conditions import FrameConditions
from ...field.field import MlpField, PlaneField
from ...field.rays import HandInView, RenderedRays, SurfaceRays, split_rays
from ...field.sampler import SamplerConfig
from ...field.volume import Composite
from ...records.render_hooks import RenderHooks
from ..precision import Decoder, Precision, decoder_in_precision
from ..reference import ChunkedRayRenderer, RayRenderer, ReferenceBackend
from .kernels.compiled import launch
from .kernels.planes import gather_samples, sum_samples, weigh_samples
from .ray_stages import trace


class FlatField(NamedTuple):
    """Tables and weights of a field of planes, as the kernels take them.

    Attributes:
        table: flat texels of all planes, the relief's last.
        layout: [planes, 4] start in the table, resolution, heights, channels.
        texels_m: [planes] size of a texel on the skin, template metres.
        near_weight: [hidden, inputs] of the density's hidden layer.
        near_bias: [hidden].
        density_weight: [1, hidden].
        density_bias: [1].
    """

    table: Tensor
    layout: Tensor
    texels_m: Tensor
    near_weight: Tensor
    near_bias: Tensor
    density_weight: Tensor
    density_bias: Tensor

    @classmethod
    def of(cls, field: PlaneField) -> FlatField:
        """Lay out a field, whose weights must not change while this is used."""
        planes = [*field.feature_planes, field.relief]
        tables = [plane.table.detach().float().flatten() for plane in planes]
        starts = [0]
        for table in tables:
            starts.append(starts[-1] + len(table))
        layout = [
            (start, plane.resolution, plane.heights, plane.channels)
            for start, plane in zip(starts, planes, strict=False)
        ]
        device, layers = tables[0].device, (field.near, field.density)
        weights = (values.detach().float() for layer in layers for values in (layer.weight, layer.bias))
        texels_m = [field.config.atlas_m / plane.resolution for plane in planes]
        return cls(
            torch.cat(tables),
            torch.tensor(layout, dtype=torch.int32, device=device),
            torch.tensor(texels_m, device=device),
            *weights,
        )


@dataclass(frozen=True)
class PlaneRayRenderer:
    """Renders the rays of one field, whose weights must not change while this is used.

    Attributes:
        field: of planes.
        config: of the sampler.
        precision: of the decoder.
        samples_per_chunk: between two calls of `before_chunk`; bounds memory.
    """

    field: PlaneField
    config: SamplerConfig
    precision: Precision = "fp32"
    samples_per_chunk: int = 1 << 19

    def __call__(self, hand: HandInView, conditions: FrameConditions, hooks: RenderHooks) -> RenderedRays:
        """Render rays, as `RayRenderer`."""
        hooks.on_stage("sample")
        rays = trace(hand, self.config)
        hooks.on_stage("field")
        channels = torch.cat([conditions.vertex_channels, self.field.light_code(conditions.visibility)], -1)
        parts = []
        for chunk in split_rays(rays, max(1, self.samples_per_chunk // rays.t.shape[1])):
            hooks.before_chunk()
            parts.append(self._shaded(chunk, hand, channels))
        composite = Composite(*(torch.cat(values) for values in zip(*parts, strict=True)))
        return RenderedRays(rays.pixel, composite, rays.t, rays.dt)

    def _shaded(self, rays: SurfaceRays, hand: HandInView, channels: Tensor) -> Composite:
        view = torch.nn.functional.normalize(rays.directions, dim=-1)
        return self.field.shaded(self.gathered(rays, hand, channels), view, self._decoder(rays.t.device))

    def gathered(self, rays: SurfaceRays, hand: HandInView, channels: Tensor) -> Composite:
        """Query the field at traced rays and composite what they gather; `channels` [V, C] are the vertices'."""
        count, samples = rays.t.shape
        units = torch.stack([hand.mesh.scale.new_tensor(self.config.shell_m), hand.camera.focal_px, hand.mesh.scale])
        features, sigma = rays.t.new_empty(count * samples, self.field.gathered_channels), torch.empty_like(rays.t)
        surface = hand.topology.faces, hand.topology.corner_uv, channels
        launch(gather_samples, (count, samples), *rays.samples, rays.t, units, *surface, *self._flat, features, sigma)
        alpha, depth = rays.t.new_empty(count), rays.t.new_empty(count)
        found = Composite(rays.t.new_empty(count, features.shape[1]), alpha, depth, torch.empty_like(sigma))
        steps = sigma, rays.t, rays.dt, rays.directions, rays.is_stopped, units, 0.0
        launch(weigh_samples, count, *steps, *found[1:])
        launch(sum_samples, tuple(found.channels.shape), features, found.weights, found.channels)
        return found

    def _decoder(self, device: torch.device) -> Decoder:
        return decoder_in_precision(self.field, device, self.precision)

    @cached_property
    def _flat(self) -> FlatField:
        return FlatField.of(self.field)


class FieldStages(ReferenceBackend):
    """Fields of planes by Warp; the paper's field is traced by it and queried by torch."""

    def ray_renderer(self, field: MlpField | PlaneField, config: SamplerConfig, precision: Precision) -> RayRenderer:
        """Make a renderer, as the reference's."""
        if isinstance(field, PlaneField):
            return PlaneRayRenderer(field, config, precision)
        return ChunkedRayRenderer(self, field, config, precision)
