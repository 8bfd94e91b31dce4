"""Low-resolution rays of a field of planes, by the kernels: marched, then decoded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from ..field.conditions import LOCAL_POSE_CHANNELS, FrameConditions
from ..field.field import RELIEF_GAIN, PlaneField
from ..geometry.mesh import PosedMesh, Topology
from ..kernels.compiled import in_parallel
from ..kernels.march import march
from ..rays import View, ray_directions, ray_origin
from ..sampler import SamplerConfig
from ..volume import Composite
from .shell import Layers, live_pixels, surface_arrays

# Rays marched between two looks at `should_stop`.
_RAYS_AT_ONCE = 1 << 15


@dataclass(frozen=True)
class Marcher:
    """One field, its tables packed for the kernels. The field must not be trained on while this lives."""

    field: PlaneField
    config: SamplerConfig

    def march(
        self,
        layers: Layers,
        mesh: PosedMesh,
        topology: Topology,
        conditions: FrameConditions,
        view: View,
        before_chunk: Callable[[], None] = lambda: None,
    ) -> tuple[Tensor, Tensor, Composite]:
        """Pixel [R], unit direction [R, 3] and composited features of all rays that meet the shell.

        Args:
            layers: the rasterised shell.
            mesh: the posed hand.
            topology: its topology.
            conditions: of the pose.
            view: the low-resolution camera.
            before_chunk: called between chunks of rays; what it raises ends the march.
        """
        pixel = torch.as_tensor(live_pixels(layers))
        directions = ray_directions(view, pixel)
        exposure = self.field.exposure(conditions.visibility)
        vertex_channels = torch.cat([conditions.vertex_channels, exposure], -1).numpy()
        inputs = (
            *(values.numpy() for values in (pixel, directions, ray_origin(view))),
            self.config.samples_per_ray,
            *(np.float32(value) for value in (self.config.shell_m, view.K[0, 0], mesh.scale)),
            tuple(layers),
            surface_arrays(mesh, topology),
            topology.corner_uv.numpy(),
            vertex_channels,
            LOCAL_POSE_CHANNELS,
            *self._packed,
        )
        told = Composite(*(torch.zeros(len(pixel), *size) for size in ((self.field.told_channels,), (), ())))
        out = [values.numpy() for values in told]
        for first in range(0, len(pixel), _RAYS_AT_ONCE):
            before_chunk()
            count = min(_RAYS_AT_ONCE, len(pixel) - first)
            in_parallel(
                lambda a, b, first=first: march(*inputs, first + a, first + b, *out), count, torch.get_num_threads()
            )
        return pixel, directions / directions.norm(dim=-1, keepdim=True), told

    @cached_property
    def _packed(self) -> tuple:
        """Tables and weights as the kernel takes them: `march`'s arguments from `table` to `density_bias`."""
        planes = [*self.field.planes, self.field.relief]
        tables = [plane.table.detach().cpu().numpy() for plane in planes]
        starts = np.cumsum([0, *(table.size for table in tables)])[:-1]
        layout = [
            (start, p.resolution, p.heights, t.shape[1]) for start, p, t in zip(starts, planes, tables, strict=True)
        ]
        near, density = (
            [value.detach().cpu().numpy() for value in (layer.weight, layer.bias)]
            for layer in (self.field.near, self.field.density)
        )
        return (
            np.concatenate([table.ravel() for table in tables]),
            np.array(layout, np.int64),
            np.array([self.field.config.atlas_m / plane.resolution for plane in planes], np.float32),
            np.float32(RELIEF_GAIN),
            _padded(near[0]),
            near[1],
            density[0][0].copy(),
            np.float32(density[1][0]),
        )


def _padded(weight: np.ndarray) -> np.ndarray:
    """[inputs, hidden] of a layer's weight, rows of zeros added to a multiple of 4."""
    return np.pad(weight.T, ((0, -weight.shape[1] % 4), (0, 0)))
