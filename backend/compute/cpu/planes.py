"""`FeaturePlane.forward` by the kernels, with gradients: the same values, many times faster than torch's gathers."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from ...field.encoding import FeaturePlane
from ..kernels.planes import place_gradient, read_samples, table_gradient
from .threads import in_parallel

Sizes = tuple[int, int, int]
"""Resolution, heights, channels of a plane."""


def read_plane(
    plane: FeaturePlane, uv: Float[Tensor, "S 2"], height: Float[Tensor, " S"], fade: Float[Tensor, " S"]
) -> Float[Tensor, "S C"]:
    """As `FeaturePlane.forward`."""
    return _PlaneRead.apply(plane.table, uv, height, fade, (plane.resolution, plane.heights, plane.channels))


class _PlaneRead(torch.autograd.Function):
    """Features of one plane [S, C] at uv [S, 2] and height [S], multiplied by fade [S]."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, uv: Tensor, height: Tensor, fade: Tensor, sizes: Sizes) -> Tensor:
        """All of one floating-point type, on the CPU."""
        places = tuple(values.detach().contiguous() for values in (uv, height, fade))
        flat = table.detach().contiguous().view(-1)
        out = flat.new_empty(len(uv), sizes[2])
        arrays = [values.numpy() for values in (flat, *places)]
        in_parallel(
            lambda first, last: read_samples(
                arrays[0], sizes, *arrays[1:], first, last, out.view(-1).numpy(), sizes[2], 0
            ),
            len(uv),
        )
        ctx.sizes = sizes
        ctx.save_for_backward(table, *places)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *outward: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradients of the table and, if needed, of uv, height and fade."""
        table, *places = ctx.saved_tensors
        of_features = outward[0].contiguous()
        of_table = _table_gradient(table, places, of_features, ctx.sizes) if ctx.needs_input_grad[0] else None
        if not any(ctx.needs_input_grad[1:4]):
            return of_table, None, None, None, None
        of_place = _place_gradient(table.detach(), places, of_features, ctx.sizes)
        return of_table, of_place[:, :2], of_place[:, 2], of_place[:, 3], None


def _table_gradient(
    table: Float[Tensor, "T C"], places: list[Tensor], outward: Float[Tensor, "S C"], sizes: Sizes
) -> Float[Tensor, "T C"]:
    gradient = torch.zeros_like(table, memory_format=torch.contiguous_format)
    uv, height, fade, flat, total = (values.numpy() for values in (*places, outward.view(-1), gradient.view(-1)))
    in_parallel(
        lambda first, last: table_gradient(sizes, uv, height, fade, flat, sizes[2], 0, first, last, total), sizes[0]
    )
    return gradient


def _place_gradient(
    table: Float[Tensor, "T C"], places: list[Tensor], outward: Float[Tensor, "S C"], sizes: Sizes
) -> Float[Tensor, "S 4"]:
    gradient = outward.new_zeros(len(outward), 4)
    texels, uv, height, fade, flat, total = (
        values.numpy() for values in (table.contiguous().view(-1), *places, outward.view(-1), gradient)
    )
    in_parallel(
        lambda first, last: place_gradient(texels, sizes, uv, height, fade, flat, sizes[2], 0, first, last, total),
        len(outward),
    )
    return gradient
