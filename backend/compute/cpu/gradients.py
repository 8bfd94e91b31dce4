"""`field.shade.shade` by kernels, with gradients to the field's weights, and `FeaturePlane.forward` with gradients.

One autograd function leads from the weights to composited gathered features, with its gradient written out. torch's
own gradient has the same values but spends its time on temporary copies of all gathered features.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import softplus

from ...field.conditions import LOCAL_POSE_CHANNELS, FrameConditions
from ...field.encoding import FeaturePlane
from ...field.field import PRIOR_OFFSET, PRIOR_SLOPE, RELIEF_GAIN, MlpField, PlaneField
from ...field.rays import HandInView, SurfaceRays
from ...field.shade import RayGeometry
from ...field.shade import shade as shade_reference
from ...field.volume import Composite, Steps
from ...geometry.mesh import Topology
from ...geometry.uvh import SurfaceSamples
from ..kernels import gradients as kernels
from ..reference import ReferenceBackend
from .arrays import as_arrays
from .threads import in_parallel

# An optical depth of transmittance 1e-13, as in `field.volume`.
_OPAQUE = 30.0

Sizes = tuple[int, int, int]
"""Resolution, heights, channels of a plane."""


class Samples(NamedTuple):
    """Samples on the surface; nothing here is learned.

    Attributes:
        samples: [S] on the surface.
        height: [S] in units of the shell.
        footprint_m: [S] width of a pixel there.
        steps: of the rays.
        topology: of the hand.
        channels: [V, C] of the vertices: normal, rotation, local pose, light.
    """

    samples: SurfaceSamples
    height: Tensor
    footprint_m: Tensor
    steps: Steps
    topology: Topology
    channels: Tensor


def shade(
    field: MlpField | PlaneField,
    rays: SurfaceRays,
    hand: HandInView,
    conditions: FrameConditions,
    shell_m: float,
) -> Composite:
    """Query the field at the samples and composite each ray.

    The kernels have no gradient to the geometry: if one is required, and for the paper's field, torch computes
    everything but the reading of planes.
    """
    geometry = RayGeometry.of(rays, hand)
    if not isinstance(field, PlaneField) or _needs_geometry_gradient(rays, conditions, geometry.steps):
        return shade_reference(field, rays, hand, conditions, shell_m, read_plane)
    light = field.light_code(conditions.visibility).float()
    channels = torch.cat([conditions.vertex_channels, light.detach()], 1)
    height = rays.samples.height_m / shell_m
    samples = Samples(rays.samples, height, geometry.footprint_m, geometry.steps, hand.topology, channels)
    weights = (field.near.weight, field.near.bias, field.density.weight, field.density.bias)
    tables = [plane.table for plane in (*field.feature_planes, field.relief)]
    gathered = Composite(*_CompositeAlongRays.apply(field, samples, light, *weights, *tables))
    return field.shaded(gathered, geometry.view)


def _needs_geometry_gradient(rays: SurfaceRays, conditions: FrameConditions, steps: Steps) -> bool:
    geometry = (*rays.samples, conditions.vertex_channels, conditions.visibility, rays.directions, *steps)
    return torch.is_grad_enabled() and any(values.requires_grad for values in geometry)


class _CompositeAlongRays(torch.autograd.Function):
    """From the light code [V, E], the density's weights and the planes' tables to the fields of `Composite`.

    The samples' weights have no gradient: no loss uses them.
    """

    @staticmethod
    def forward(
        ctx: Any, field: PlaneField, samples: Samples, light: Tensor, *weights: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        near_weight, near_bias, density_weight, density_bias, *tables = (w.detach() for w in weights)
        precision = torch.get_autocast_dtype("cpu") if torch.is_autocast_enabled("cpu") else torch.float32
        planes = _planes_of(field, samples)
        uv, gathered, relief = _gather(planes, tables, samples, field.gathered_channels)
        near = gathered[:, : near_weight.shape[1]].to(precision)
        hidden = torch.addmm(near_bias.to(precision), near, near_weight.to(precision).T).relu_()
        raw = torch.addmm(density_bias.to(precision), hidden, density_weight.to(precision).T)[:, 0]
        logit = raw.float() + PRIOR_SLOPE * samples.height + PRIOR_OFFSET
        seen, weight, after = _composite(logit, gathered, samples.steps)
        ctx.planes, ctx.samples, ctx.shape = planes, samples, light.shape
        ctx.kept = uv, gathered, relief, near, hidden, logit, weight, after
        ctx.save_for_backward(near_weight, density_weight, *tables, *seen)
        ctx.mark_non_differentiable(weight)
        return *seen, weight

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *outward: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        near_weight, density_weight, *tables, _, alpha, depth = ctx.saved_tensors
        uv, gathered, relief, near, hidden, logit, weight, after = ctx.kept
        samples, precision = ctx.samples, near.dtype
        of_gathered, of_optical = torch.empty_like(gathered), torch.empty_like(weight)
        arrays = as_arrays(samples.steps.t, gathered.view(-1), weight, after, alpha, depth)
        _run(
            len(weight),
            kernels.composite_gradient,
            arrays,
            as_arrays(*outward[:3]),
            as_arrays(of_gathered.view(-1), of_optical),
        )
        of_logit = (of_optical * samples.steps.step_mm[:, None]).view(-1) * logit.sigmoid()
        of_raw = of_logit.to(precision)[:, None]
        of_hidden = (of_raw @ density_weight.to(precision)).mul_(hidden.sign())  # ten times faster than a mask
        of_gathered[:, : near.shape[1]] += of_hidden @ near_weight.to(precision)
        of_density = (of_raw.T @ hidden).float(), of_logit.sum(0, keepdim=True)
        of_near = (of_hidden.T @ near).float(), of_hidden.sum(0, dtype=torch.float32)
        of_tables, of_light = _gather_gradient(
            ctx.planes, tables, samples, uv, gathered, relief, of_gathered, ctx.shape
        )
        return None, None, of_light, *of_near, *of_density, *of_tables


class _Plane(NamedTuple):
    """A plane and its fade at the samples [S]."""

    sizes: Sizes
    fade: Tensor


def _planes_of(field: PlaneField, samples: Samples) -> list[_Plane]:
    """Return the field's planes, the relief's last."""
    planes = [*field.feature_planes, field.relief]
    fades = [field.fade(plane, samples.footprint_m) for plane in planes]
    fades[-1] = RELIEF_GAIN * fades[-1]
    sizes = [(plane.resolution, plane.heights, plane.channels) for plane in planes]
    return [_Plane(size, fade) for size, fade in zip(sizes, fades, strict=True)]


def _gather(
    planes: list[_Plane], tables: list[Tensor], samples: Samples, columns: int
) -> tuple[Float[Tensor, "S 2"], Float[Tensor, "S K"], Float[Tensor, "S 3"]]:
    """Gather atlas coordinates of the samples, their features, and the relief's offset."""
    count = len(samples.height)
    uv, gathered, relief = (torch.empty(count, width) for width in (2, columns, 3))
    face, barycentric, faces, channels, corner_uv = _surface(samples)
    _run(count, kernels.atlas_coordinates, (face, barycentric, corner_uv), (), as_arrays(uv))
    *others, bumps = zip(planes, tables, strict=True)
    at = 0
    for plane, table in others:
        _read(plane, table, uv, samples.height, gathered, at)
        at += plane.sizes[2]
    _read(*bumps, uv, samples.height, relief, 0)
    where = (face, barycentric, *as_arrays(samples.height, relief), faces, channels, LOCAL_POSE_CHANNELS)
    flat = gathered.view(-1).numpy()
    in_parallel(lambda first, last: kernels.gather_features(*where, first, last, flat, columns, at), count)
    return uv, gathered, relief


def _read(plane: _Plane, table: Tensor, uv: Tensor, height: Tensor, out: Tensor, at: int) -> None:
    texels, *place, flat = as_arrays(table.reshape(-1), uv, height, plane.fade, out.view(-1))
    in_parallel(
        lambda first, last: kernels.read_samples(texels, plane.sizes, *place, first, last, flat, out.shape[1], at),
        len(uv),
    )


def _composite(
    logit: Float[Tensor, " S"], gathered: Float[Tensor, "S K"], steps: Steps
) -> tuple[tuple[Tensor, Tensor, Tensor], Tensor, Tensor]:
    """Compute (channels, alpha, depth), and each sample's weight and the transmittance behind it, both [R, N]."""
    optical_depth = softplus(logit).view(steps.t.shape) * steps.step_mm[:, None]
    optical_depth[:, -1] += _OPAQUE * steps.is_stopped
    clear = torch.exp(-optical_depth)
    rays, weight, after = len(clear), torch.empty_like(clear), torch.empty_like(clear)
    seen = torch.empty(rays, gathered.shape[1]), torch.empty(rays), torch.empty(rays)
    _run(
        rays, kernels.composite_rays, as_arrays(clear, steps.t, gathered.view(-1)), (), as_arrays(weight, after, *seen)
    )
    return seen, weight, after


def _gather_gradient(
    planes: list[_Plane],
    tables: list[Tensor],
    samples: Samples,
    uv: Float[Tensor, "S 2"],
    gathered: Float[Tensor, "S K"],
    relief: Float[Tensor, "S 3"],
    outward: Float[Tensor, "S K"],
    light_shape: torch.Size,
) -> tuple[list[Tensor], Tensor]:
    """Compute gradients of the tables and of the vertices' light [V, E] from those of the gathered features."""
    face, barycentric, faces, channels, _ = _surface(samples)
    columns = gathered.shape[1]
    widths = [plane.sizes[2] for plane in planes[:-1]]
    starts = [sum(widths[:k]) for k in range(len(widths))]
    of_tables = [
        _table_gradient(table, (uv, samples.height, plane.fade), outward, plane.sizes, at)
        for plane, table, at in zip(planes[:-1], tables[:-1], starts, strict=True)
    ]
    normal_at = sum(widths) + 2 + LOCAL_POSE_CHANNELS
    of_relief = torch.empty_like(relief)
    where = (face, barycentric, relief.numpy(), faces, channels, *as_arrays(gathered.view(-1), outward.view(-1)))
    in_parallel(
        lambda first, last: kernels.relief_gradient(*where, columns, normal_at, first, last, of_relief.numpy()),
        len(relief),
    )
    relief_place = uv, samples.height, planes[-1].fade
    of_tables.append(_table_gradient(tables[-1], relief_place, of_relief, planes[-1].sizes))
    of_light = torch.zeros(light_shape)
    flat = outward.view(-1).numpy()
    kernels.vertex_gradient(face, barycentric, faces, flat, columns, normal_at + 6, of_light.numpy())
    return of_tables, of_light


def _surface(samples: Samples) -> list[Any]:
    """Make arrays for the kernels: face, barycentric, faces, the vertices' channels, corner_uv."""
    on_surface, topology = samples.samples, samples.topology
    return as_arrays(on_surface.face, on_surface.barycentric, topology.faces, samples.channels, topology.corner_uv)


def _run(count: int, kernel: Any, inputs: Any, more: Any, out: Any) -> None:
    """Run a kernel over [0, count): its arguments are inputs, the range, and the outputs."""
    in_parallel(lambda first, last: kernel(*inputs, *more, first, last, *out), count)


def read_plane(
    plane: FeaturePlane, uv: Float[Tensor, "S 2"], height: Float[Tensor, " S"], fade: Float[Tensor, " S"]
) -> Float[Tensor, "S C"]:
    """Read a plane, as `FeaturePlane.forward`."""
    return _PlaneRead.apply(plane.table, uv, height, fade, (plane.resolution, plane.heights, plane.channels))


class _PlaneRead(torch.autograd.Function):
    """Features of one plane [S, C] at uv [S, 2] and height [S], multiplied by fade [S]."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, uv: Tensor, height: Tensor, fade: Tensor, sizes: Sizes) -> Tensor:
        """Read a plane; all of one floating-point type, on the CPU."""
        hit_points = tuple(values.detach().contiguous() for values in (uv, height, fade))
        flat = table.detach().contiguous().view(-1)
        out = flat.new_empty(len(uv), sizes[2])
        arrays = [values.numpy() for values in (flat, *hit_points)]
        in_parallel(
            lambda first, last: kernels.read_samples(
                arrays[0], sizes, *arrays[1:], first, last, out.view(-1).numpy(), sizes[2], 0
            ),
            len(uv),
        )
        ctx.sizes = sizes
        ctx.save_for_backward(table, *hit_points)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *outward: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Compute the gradients of the table and, if needed, of uv, height and fade."""
        table, *hit_points = ctx.saved_tensors
        of_features = outward[0].contiguous()
        of_table = _table_gradient(table, hit_points, of_features, ctx.sizes) if ctx.needs_input_grad[0] else None
        if not any(ctx.needs_input_grad[1:4]):
            return of_table, None, None, None, None
        of_place = _place_gradient(table.detach(), hit_points, of_features, ctx.sizes)
        return of_table, of_place[:, :2], of_place[:, 2], of_place[:, 3], None


def _table_gradient(
    table: Float[Tensor, "T C"], hit_points: Sequence[Tensor], outward: Float[Tensor, "S K"], sizes: Sizes, at: int = 0
) -> Float[Tensor, "T C"]:
    """Compute a table's gradient; `outward` has the plane's channels from column `at` on; points: uv, height, fade."""
    gradient = torch.zeros_like(table, memory_format=torch.contiguous_format)
    *arrays, flat, total = as_arrays(*hit_points, outward.view(-1), gradient.view(-1))
    columns = outward.shape[1]
    in_parallel(
        lambda first, last: kernels.table_gradient(sizes, *arrays, flat, columns, at, first, last, total), sizes[0]
    )
    return gradient


def _place_gradient(
    table: Float[Tensor, "T C"], hit_points: list[Tensor], outward: Float[Tensor, "S C"], sizes: Sizes
) -> Float[Tensor, "S 4"]:
    gradient = outward.new_zeros(len(outward), 4)
    inputs, total = as_arrays(*hit_points, outward.view(-1)), gradient.numpy()
    texels = as_arrays(table.contiguous().view(-1))[0]
    in_parallel(
        lambda first, last: kernels.place_gradient(texels, sizes, *inputs, sizes[2], 0, first, last, total),
        len(outward),
    )
    return gradient


class ShadeKernels(ReferenceBackend):
    """Fields in training by kernels."""

    shade = staticmethod(shade)
