"""Low-resolution rays of a field of planes: traced, queried and composited by one fused kernel, then decoded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...field.conditions import LOCAL_POSE_CHANNELS, FrameConditions
from ...field.field import PRIOR_OFFSET, PRIOR_SLOPE, RELIEF_GAIN, MlpField, PlaneField
from ...field.rays import HandInView, RenderedRays
from ...field.sampler import SamplerConfig
from ...field.volume import Composite
from ...records.render_hooks import RenderHooks
from ..kernels.field import BLOCK, DENSITY_BLOCK, PackedField, RayOutputs, RayUnits, Skin, render_rays
from ..kernels.vectors import has_half_precision
from ..precision import Decoder, Precision
from ..reference import ChunkedRayRenderer, RayRenderer, ReferenceBackend
from .networks import decoder
from .rays import live_rays, rasterise_shell, surface_of
from .threads import in_parallel, on_all_threads


class GatheredRays(NamedTuple):
    """R rays of N samples before decoding.

    Attributes:
        pixel: [R] row * width + column, in the crop.
        view: [R, 3] unit directions, world.
        gathered: composited gathered features.
        t: [R, N] depth of each queried sample, m.
        dt: [R] depth step of the samples, m.
    """

    pixel: Tensor
    view: Tensor
    gathered: Composite
    t: Tensor
    dt: Tensor


@dataclass(frozen=True)
class FusedRayRenderer:
    """One field with its tables packed for the kernels.

    Attributes:
        field: its weights must not change while this is used.
        config: of the sampler.
        precision: of the decoder.
        rays_per_chunk: between two calls of `before_chunk`.
        rays_per_decode: per call of the decoder, whose activations then stay in the cache.
    """

    field: PlaneField
    config: SamplerConfig
    precision: Precision = "fp32"
    rays_per_chunk: int = 1 << 15
    rays_per_decode: int = 1 << 12

    def __call__(self, hand: HandInView, conditions: FrameConditions, hooks: RenderHooks) -> RenderedRays:
        """Render rays, as `RayRenderer`."""
        rays = self.gather(hand, conditions, hooks)
        hooks.on_stage("field")
        composite = self.decode(rays.gathered, rays.view)
        return RenderedRays(rays.pixel, composite, rays.t, rays.dt)

    def gather(self, hand: HandInView, conditions: FrameConditions, hooks: RenderHooks) -> GatheredRays:
        """Trace all rays that meet the shell, with the features gathered along them composited."""
        hooks.on_stage("rasterise")
        crossings = rasterise_shell(hand, self.config)
        hooks.on_stage("sample")
        pixel, directions, rays = live_rays(crossings, hand)
        surface, skin, units = surface_of(hand.mesh, hand.topology), self._skin(hand, conditions), self._units(hand)
        gathered, t, dt = self._buffers(len(pixel), units.samples)
        out = RayOutputs(*(values.numpy() for values in (*gathered, t, dt)))
        for start in range(0, len(pixel), self.rays_per_chunk):
            hooks.before_chunk()
            in_parallel(
                lambda first, last, start=start: render_rays(
                    rays, crossings, surface, skin, self._packed, units, start + first, start + last, out
                ),
                min(self.rays_per_chunk, len(pixel) - start),
            )
        return GatheredRays(pixel, directions / directions.norm(dim=-1, keepdim=True), gathered, t, dt)

    def decode(self, gathered: Composite, view: Tensor) -> Composite:
        """Shade rays as the field does (`PlaneField.shaded`)."""
        chunks = zip(*(values.split(self.rays_per_decode) for values in (*gathered, view)), strict=True)
        channels = [self.field.shaded(Composite(*chunk), view, self._decoder).channels for *chunk, view in chunks]
        return gathered._replace(channels=torch.cat(channels))

    def _skin(self, hand: HandInView, conditions: FrameConditions) -> Skin:
        channels = torch.cat([conditions.vertex_channels, self.field.light_code(conditions.visibility)], -1)
        return Skin(hand.topology.corner_uv.numpy(), channels.numpy())

    def _units(self, hand: HandInView) -> RayUnits:
        values = (self.config.shell_m, hand.camera.focal_px, hand.mesh.scale)
        shell_m, focal_px, scale = (np.float32(value) for value in values)
        return RayUnits(self.config.samples_along(hand), shell_m, focal_px, scale, hand.camera.is_orthographic)

    def _buffers(self, rays: int, samples: int) -> tuple[Composite, Tensor, Tensor]:
        """Allocate composited gathered features, sample depths [R, N] and steps [R]; all zero."""
        sizes = ((rays, self.field.gathered_channels), (rays,), (rays,), (rays, samples))
        return Composite(*(torch.zeros(size) for size in sizes)), torch.zeros(rays, samples), torch.zeros(rays)

    @cached_property
    def _decoder(self) -> Decoder:
        return decoder(self.field, torch.device("cpu"), self.precision)

    @cached_property
    def _packed(self) -> PackedField:
        return packed(self.field)


def packed(field: PlaneField) -> PackedField:
    """Pack the tables and weights of a field as the kernels take them."""
    planes = [*field.feature_planes, field.relief]
    tables = [_padded(plane.table, BLOCK) for plane in planes]
    starts = np.cumsum([0, *(table.size for table in tables)])[:-1]
    layout = [
        (start, plane.resolution, plane.heights, table.shape[1], plane.channels)
        for start, plane, table in zip(starts, planes, tables, strict=True)
    ]
    return PackedField(
        table=_narrow(np.concatenate([table.ravel() for table in tables])),
        layout=np.array(layout),
        texels_m=np.array([field.config.atlas_m / plane.resolution for plane in planes], np.float32),
        relief_gain=np.float32(RELIEF_GAIN),
        pose_channels=LOCAL_POSE_CHANNELS,
        near_bias=_padded(field.near.bias[None], DENSITY_BLOCK)[0],
        near_weight=np.ascontiguousarray(_padded(field.near.weight.T, DENSITY_BLOCK)[None]),
        density_weight=_padded(field.density.weight, DENSITY_BLOCK)[0],
        density_bias=np.float32(_array(field.density.bias)[0]),
        slope=np.float32(PRIOR_SLOPE),
        prior=np.float32(PRIOR_OFFSET),
    )


def _narrow(table: np.ndarray) -> np.ndarray:
    """Return the bits of half precision, in which avatars' files hold their planes, if the kernels can read them."""
    if not has_half_precision() or np.abs(table).max() > np.finfo(np.float16).max:
        return table
    return table.astype(np.float16).view(np.uint16)


def _array(values: Tensor) -> np.ndarray:
    return values.detach().cpu().numpy().astype(np.float32)


def _padded(values: Tensor, block: int) -> np.ndarray:
    """Add columns of zeros up to a whole number of blocks: [rows, columns]."""
    return np.pad(_array(values), ((0, 0), (0, -values.shape[1] % block)))


class FieldKernels(ReferenceBackend):
    """Fields of planes by kernels; the paper's field is traced by them and queried by torch."""

    def ray_renderer(self, field: MlpField | PlaneField, config: SamplerConfig, precision: Precision) -> RayRenderer:
        """Make a renderer, as the reference's."""
        if isinstance(field, PlaneField):
            return FusedRayRenderer(field, config, precision)
        return on_all_threads(ChunkedRayRenderer(self, field, config, precision))
