"""Low-resolution rays of a field of planes, by the kernels: marched, then decoded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..nerf.conditions import LOCAL_POSE_CHANNELS, FrameConditions
from ..nerf.field import PRIOR_OFFSET, PRIOR_SLOPE, RELIEF_GAIN, PlaneField
from ..nerf.rays import HandInView, ray_directions, ray_origin
from ..nerf.sampler import SamplerConfig
from ..nerf.volume import Composite
from .kernels.compiled import in_parallel
from .kernels.fused import march
from .kernels.planes import BLOCK
from .shell import ShellCrossings, live_pixels, surface_arrays

# Rays marched between two looks at `should_stop`.
_RAYS_AT_ONCE = 1 << 15
_RAYS_DECODED_AT_ONCE = 1 << 12


class PackedField(NamedTuple):
    """A field's tables and weights as the kernel takes them; indexed by position in `kernels.march`.

    Attributes:
        table: flat texels of all planes, the relief's last, channels padded to whole blocks.
        layout: [planes, 5] start in the table, resolution, heights, channels with their padding, and without.
        texels_m: [planes] size of a texel on the skin.
        relief_gain: factor of the relief.
        pose_channels: of the local pose.
        near_bias: [hidden].
        near_weight: [inputs, hidden], inputs padded with zeros to a multiple of 4.
        density_weight: [hidden].
        density_bias: of the density.
        slope: of the density's prior over height.
        prior: its offset.
    """

    table: np.ndarray
    layout: np.ndarray
    texels_m: np.ndarray
    relief_gain: np.float32
    pose_channels: int
    near_bias: np.ndarray
    near_weight: np.ndarray
    density_weight: np.ndarray
    density_bias: np.float32
    slope: np.float32
    prior: np.float32

    @classmethod
    def of(cls, field: PlaneField) -> PackedField:
        """Pack a field."""
        planes = [*field.planes, field.relief]
        tables = [_padded(plane.table, BLOCK) for plane in planes]
        starts = np.cumsum([0, *(table.size for table in tables)])
        widths = [(table.shape[1], plane.channels) for plane, table in zip(planes, tables, strict=True)]
        sizes = [(plane.resolution, plane.heights, *width) for plane, width in zip(planes, widths, strict=True)]
        return cls(
            table=np.concatenate([table.ravel() for table in tables]),
            layout=np.array([(start, *size) for start, size in zip(starts, sizes, strict=False)]),
            texels_m=np.array([field.config.atlas_m / plane.resolution for plane in planes], np.float32),
            relief_gain=np.float32(RELIEF_GAIN),
            pose_channels=LOCAL_POSE_CHANNELS,
            near_bias=_array(field.near.bias),
            near_weight=np.ascontiguousarray(_padded(field.near.weight, 4).T),
            density_weight=_array(field.density.weight)[0].copy(),
            density_bias=np.float32(_array(field.density.bias)[0]),
            slope=np.float32(PRIOR_SLOPE),
            prior=np.float32(PRIOR_OFFSET),
        )


class Marched(NamedTuple):
    """R rays of N samples.

    Attributes:
        pixel: [R] row * width + column.
        direction: [R, 3] unit length, world.
        told: composited features.
        t: [R, N] depth of each sample that was asked for, m.
        dt: [R] depth step of the samples, m.
    """

    pixel: Tensor
    direction: Tensor
    told: Composite
    t: Tensor
    dt: Tensor


def _array(values: Tensor) -> np.ndarray:
    return values.detach().cpu().numpy().astype(np.float32)


def _padded(values: Tensor, block: int) -> np.ndarray:
    """[rows, columns] with columns of zeros added up to a whole number of blocks."""
    return np.pad(_array(values), ((0, 0), (0, -values.shape[1] % block)))


@dataclass(frozen=True)
class Marcher:
    """One field, its tables packed for the kernels. The field must not be trained on while this lives."""

    field: PlaneField
    config: SamplerConfig

    def march(
        self,
        layers: ShellCrossings,
        hand: HandInView,
        conditions: FrameConditions,
        before_chunk: Callable[[], None] = lambda: None,
    ) -> Marched:
        """All rays that meet the shell.

        Args:
            layers: the rasterised shell.
            hand: before its camera.
            conditions: of the pose.
            before_chunk: called between chunks of rays; what it raises ends the march.
        """
        mesh, topology, view = hand
        pixel = torch.as_tensor(live_pixels(layers))
        directions = ray_directions(view, pixel)
        exposure = self.field.exposure(conditions.visibility)
        channels = torch.cat([conditions.vertex_channels, exposure], -1)
        units = (np.float32(value) for value in (self.config.shell_m, view.focal_px, mesh.scale))
        inputs = (
            *(values.numpy() for values in (pixel, directions, ray_origin(view))),
            tuple(layers),
            surface_arrays(mesh, topology),
            (topology.corner_uv.numpy(), channels.numpy()),
            self._packed,
            (self.config.samples_per_ray, *units),
        )
        rays, samples = len(pixel), self.config.samples_per_ray
        sizes = ((rays, self.field.gathered_channels), (rays,), (rays,), (rays, samples))
        told = Composite(*(torch.zeros(size) for size in sizes))
        t, dt = torch.zeros(rays, samples), torch.zeros(rays)
        out = [values.numpy() for values in (*told, t, dt)]
        for first in range(0, rays, _RAYS_AT_ONCE):
            before_chunk()
            count = min(_RAYS_AT_ONCE, rays - first)
            in_parallel(
                lambda a, b, first=first: march(*inputs, first + a, first + b, *out), count, torch.get_num_threads()
            )
        return Marched(pixel, directions / directions.norm(dim=-1, keepdim=True), told, t, dt)

    def decode(self, told: Composite, direction: Tensor) -> Composite:
        """What the field makes of composited features, in pieces that stay in the cache."""
        pieces = zip(*(values.split(_RAYS_DECODED_AT_ONCE) for values in (*told, direction)), strict=True)
        channels = [self.field.decode(Composite(*told), direction).channels for *told, direction in pieces]
        return told._replace(channels=torch.cat(channels))

    @cached_property
    def _packed(self) -> PackedField:
        return PackedField.of(self.field)
