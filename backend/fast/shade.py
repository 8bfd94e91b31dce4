"""What a field of planes tells along traced rays, by the kernels, with gradients: the costly half of `shading.shade`.

One function from the field's weights to composited features, its gradient written out: the same as torch's own, which
spends its time on temporary copies of all that the samples are told.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import softplus

from ..geometry.mesh import Topology
from ..geometry.uvh import SurfaceSamples
from ..nerf.conditions import LOCAL_POSE_CHANNELS, FrameConditions
from ..nerf.encoding import FeaturePlane
from ..nerf.field import PRIOR_OFFSET, PRIOR_SLOPE, RELIEF_GAIN, PlaneField
from ..nerf.volume import Composite, Steps
from .kernels import gather as kernels
from .kernels import planes as plane_kernels
from .kernels.compiled import in_parallel

# An optical depth that lets 1e-13 through, as in `volume`.
_OPAQUE = 30.0


class Scene(NamedTuple):
    """What the samples lie on; nothing here is learnt.

    Attributes:
        samples: [S] on the surface.
        height: [S] in shells.
        footprint_m: [S] width of a pixel there.
        steps: of the rays.
        topology: of the hand.
        channels: [V, C] of the vertices: normal, rotation, local pose, exposure.
    """

    samples: SurfaceSamples
    height: Tensor
    footprint_m: Tensor
    steps: Steps
    topology: Topology
    channels: Tensor


def composite_gathered(
    field: PlaneField,
    samples: SurfaceSamples,
    topology: Topology,
    conditions: FrameConditions,
    footprint_m: Float[Tensor, " S"],
    steps: Steps,
    shell_m: float,
) -> Composite:
    """What `PlaneField.decode` takes; gradients reach the field's weights, not the geometry."""
    exposure = field.exposure(conditions.visibility).float()
    channels = torch.cat([conditions.vertex_channels, exposure.detach()], 1)
    scene = Scene(samples, samples.height_m / shell_m, footprint_m, steps, topology, channels)
    weights = (field.near.weight, field.near.bias, field.density.weight, field.density.bias)
    tables = [plane.table for plane in (*field.planes, field.relief)]
    return Composite(*_AlongRays.apply(field, scene, exposure, *weights, *tables))


class _AlongRays(torch.autograd.Function):
    """What `Composite` holds, from exposure [V, E], the density's weights and the planes' tables.

    The samples' weights come out without a gradient: nothing that is trained on looks at them.
    """

    @staticmethod
    def forward(
        ctx: Any, field: PlaneField, scene: Scene, exposure: Tensor, *weights: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        near_weight, near_bias, density_weight, density_bias, *tables = (w.detach() for w in weights)
        precision = torch.get_autocast_dtype("cpu") if torch.is_autocast_enabled("cpu") else torch.float32
        planes = _planes_of(field, scene)
        uv, told, relief = _tell(planes, tables, scene, field.gathered_channels)
        near = told[:, : near_weight.shape[1]].to(precision)
        hidden = torch.addmm(near_bias.to(precision), near, near_weight.to(precision).T).relu_()
        raw = torch.addmm(density_bias.to(precision), hidden, density_weight.to(precision).T)[:, 0]
        logit = raw.float() + PRIOR_SLOPE * scene.height + PRIOR_OFFSET
        seen, weight, after = _composite(logit, told, scene.steps)
        ctx.planes, ctx.scene, ctx.shape = planes, scene, exposure.shape
        ctx.kept = uv, told, relief, near, hidden, logit, weight, after
        ctx.save_for_backward(near_weight, density_weight, *tables, *seen)
        ctx.mark_non_differentiable(weight)
        return *seen, weight

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *outward: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        near_weight, density_weight, *tables, _, alpha, depth = ctx.saved_tensors
        uv, told, relief, near, hidden, logit, weight, after = ctx.kept
        scene, precision = ctx.scene, near.dtype
        of_told, of_optical = torch.empty_like(told), torch.empty_like(weight)
        arrays = _arrays(scene.steps.t, told.view(-1), weight, after, alpha, depth)
        _run(
            len(weight),
            kernels.composite_gradient,
            arrays,
            _arrays(*outward[:3]),
            _arrays(of_told.view(-1), of_optical),
        )
        of_logit = (of_optical * scene.steps.step_mm[:, None]).view(-1) * logit.sigmoid()
        of_raw = of_logit.to(precision)[:, None]
        of_hidden = (of_raw @ density_weight.to(precision)).mul_(hidden.sign())  # ten times faster than a mask
        of_told[:, : near.shape[1]] += of_hidden @ near_weight.to(precision)
        of_density = (of_raw.T @ hidden).float(), of_logit.sum(0, keepdim=True)
        of_near = (of_hidden.T @ near).float(), of_hidden.sum(0, dtype=torch.float32)
        of_tables, of_exposure = _tell_gradient(ctx.planes, tables, scene, uv, told, relief, of_told, ctx.shape)
        return None, None, of_exposure, *of_near, *of_density, *of_tables


class _Plane(NamedTuple):
    """Sizes (resolution, heights, channels) of a plane, and its fade at the samples [S]."""

    sizes: tuple[int, int, int]
    fade: Tensor


def _planes_of(field: PlaneField, scene: Scene) -> list[_Plane]:
    """The field's planes, the relief's last."""
    planes = [plane for plane in (*field.planes, field.relief) if isinstance(plane, FeaturePlane)]
    fades = [field.fade(plane, scene.footprint_m) for plane in planes]
    fades[-1] = RELIEF_GAIN * fades[-1]
    sizes = [(plane.resolution, plane.heights, plane.channels) for plane in planes]
    return [_Plane(size, fade) for size, fade in zip(sizes, fades, strict=True)]


def _tell(
    planes: list[_Plane], tables: list[Tensor], scene: Scene, columns: int
) -> tuple[Float[Tensor, "S 2"], Float[Tensor, "S K"], Float[Tensor, "S 3"]]:
    """Atlas coordinates of the samples, all they are told, and the relief's offset."""
    count = len(scene.height)
    uv, told, relief = (torch.empty(count, width) for width in (2, columns, 3))
    face, barycentric, faces, channels, corner_uv = _surface(scene)
    _run(count, kernels.lay_on_atlas, (face, barycentric, corner_uv), (), _arrays(uv))
    *others, bumps = zip(planes, tables, strict=True)
    at = 0
    for plane, table in others:
        _read(plane, table, uv, scene.height, told, at)
        at += plane.sizes[2]
    _read(*bumps, uv, scene.height, relief, 0)
    where = (face, barycentric, *_arrays(scene.height, relief), faces, channels, LOCAL_POSE_CHANNELS)
    flat = told.view(-1).numpy()
    in_parallel(
        lambda first, last: kernels.tell_surface(*where, first, last, flat, columns, at),
        count,
        torch.get_num_threads(),
    )
    return uv, told, relief


def _read(plane: _Plane, table: Tensor, uv: Tensor, height: Tensor, out: Tensor, at: int) -> None:
    texels, *place, flat = _arrays(table.reshape(-1), uv, height, plane.fade, out.view(-1))
    in_parallel(
        lambda first, last: plane_kernels.read_samples(
            texels, plane.sizes, *place, first, last, flat, out.shape[1], at
        ),
        len(uv),
        torch.get_num_threads(),
    )


def _composite(
    logit: Float[Tensor, " S"], told: Float[Tensor, "S K"], steps: Steps
) -> tuple[tuple[Tensor, Tensor, Tensor], Tensor, Tensor]:
    """(channels, alpha, depth), and per sample its weight and what is left behind it [R, N]."""
    optical_depth = softplus(logit).view(steps.t.shape) * steps.step_mm[:, None]
    optical_depth[:, -1] += _OPAQUE * steps.is_stopped
    clear = torch.exp(-optical_depth)
    rays, weight, after = len(clear), torch.empty_like(clear), torch.empty_like(clear)
    seen = torch.empty(rays, told.shape[1]), torch.empty(rays), torch.empty(rays)
    _run(rays, kernels.composite_rays, _arrays(clear, steps.t, told.view(-1)), (), _arrays(weight, after, *seen))
    return seen, weight, after


def _tell_gradient(
    planes: list[_Plane],
    tables: list[Tensor],
    scene: Scene,
    uv: Float[Tensor, "S 2"],
    told: Float[Tensor, "S K"],
    relief: Float[Tensor, "S 3"],
    outward: Float[Tensor, "S K"],
    exposure_shape: torch.Size,
) -> tuple[list[Tensor], Tensor]:
    """Gradients of the tables and of the vertices' exposure [V, E] from those of all that was told."""
    face, barycentric, faces, channels, _ = _surface(scene)
    columns = told.shape[1]
    widths = [plane.sizes[2] for plane in planes[:-1]]
    starts = [sum(widths[:k]) for k in range(len(widths))]
    of_tables = [
        _table_gradient(plane, table, uv, scene.height, outward, at)
        for plane, table, at in zip(planes[:-1], tables[:-1], starts, strict=True)
    ]
    normal_at = sum(widths) + 2 + LOCAL_POSE_CHANNELS
    of_relief = torch.empty_like(relief)
    where = (face, barycentric, relief.numpy(), faces, channels, *_arrays(told.view(-1), outward.view(-1)))
    in_parallel(
        lambda first, last: kernels.relief_gradient(*where, columns, normal_at, first, last, of_relief.numpy()),
        len(relief),
        torch.get_num_threads(),
    )
    of_tables.append(_table_gradient(planes[-1], tables[-1], uv, scene.height, of_relief, 0))
    of_exposure = torch.zeros(exposure_shape)
    flat = outward.view(-1).numpy()
    kernels.vertex_gradient(face, barycentric, faces, flat, columns, normal_at + 6, of_exposure.numpy())
    return of_tables, of_exposure


def _table_gradient(plane: _Plane, table: Tensor, uv: Tensor, height: Tensor, outward: Tensor, at: int) -> Tensor:
    gradient = torch.zeros_like(table)
    *place, flat, total = _arrays(uv, height, plane.fade, outward.view(-1), gradient.view(-1))
    in_parallel(
        lambda first, last: plane_kernels.table_gradient(
            plane.sizes, *place, flat, outward.shape[1], at, first, last, total
        ),
        plane.sizes[0],
        torch.get_num_threads(),
    )
    return gradient


def _surface(scene: Scene) -> list[Any]:
    """As the kernels take it: face, barycentric, faces, the vertices' channels, corner_uv."""
    samples, topology = scene.samples, scene.topology
    return _arrays(samples.face, samples.barycentric, topology.faces, scene.channels, topology.corner_uv)


def _arrays(*values: Tensor) -> list[Any]:
    return [value.detach().contiguous().numpy() for value in values]


def _run(count: int, kernel: Any, inputs: Any, more: Any, out: Any) -> None:
    """A kernel over [0, count), whose arguments are inputs, the range, and what it fills."""
    in_parallel(lambda first, last: kernel(*inputs, *more, first, last, *out), count, torch.get_num_threads())
