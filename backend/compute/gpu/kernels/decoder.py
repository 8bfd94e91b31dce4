"""What goes in and out of the decoder, as `field.relightable`; and layers of networks without tiles."""

from __future__ import annotations

from typing import Any, no_type_check

import warp as wp

from ....field.field import MIN_ALPHA
from .compiled import Floats, Floats2, Floats3, Ints, Vectors, kernel, part

FEW = wp.constant(16)
"""Columns that a thread sums where there are no tiles."""
_Columns = wp.types.vector(length=16, dtype=wp.float32)
_MIN_ALPHA, _TINY = wp.constant(MIN_ALPHA), wp.constant(1e-12)
_LEAST_ARGUMENT = wp.constant(-8.0)


@kernel
@no_type_check
def multiply_rows_plainly(
    limit: Ints,
    first: int,
    shifts: Ints,
    x: Floats2,
    weight: Floats3,
    bias: Floats2,
    mask: Floats2,
    slope: float,
    kept: float,
    y: Floats2,
):
    """Fill rows as `tiles.multiply_rows` does, a few columns a thread: for the CPU, whose compiler unrolls tiles."""
    index, block = wp.tid()
    row = first + index
    if row >= limit[0]:
        return
    total = _Columns()
    column = block * FEW
    for j in range(FEW):
        total[j] = bias[0, column + j]
    if mask[row, 0] > 0.0:
        for tap in range(shifts.shape[0]):
            there = row + shifts[tap]
            for k in range(weight.shape[1]):
                value = x[there, k]
                for j in range(FEW):
                    total[j] += value * weight[tap, k, column + j]
    for j in range(FEW):
        result = wp.max(total[j], slope * total[j])
        if kept > 0.0:
            result += kept * x[row, column + j]
        y[row, column + j] = mask[row, 0] * result


@part
@no_type_check
def _unit(vector: wp.vec3) -> wp.vec3:
    return vector / wp.max(wp.length(vector), _TINY)


@kernel
@no_type_check
def decoder_inputs(
    count: Ints,
    channels: Floats2,
    alpha: Floats,
    near_channels: int,
    view: Vectors,
    normal: Vectors,
    towards: Vectors,
    lit: Floats2,
    out: wp.array2d(dtype=Any),
):
    """Fill the decoder's inputs of rays [R] as `RelightableField.decoder_inputs`, with their ambient occlusion.

    `normal` is that of the points that rays meet; `lit` of all `towards`.
    """
    ray = wp.tid()
    if ray >= count[0]:
        return
    whole = 1.0 / wp.max(alpha[ray], _MIN_ALPHA)
    smooth = wp.vec3()
    relief = wp.vec3()
    for k in range(near_channels):
        out[ray, k] = out.dtype(channels[ray, k] * whole)
    for k in range(3):
        smooth[k] = channels[ray, near_channels + k] * whole
        relief[k] = channels[ray, near_channels + 3 + k] * whole
    smooth = _unit(smooth)
    relief = _unit(relief)
    total = wp.float32(0.0)
    mean = wp.vec3()
    for k in range(towards.shape[0]):
        weight = lit[k, ray] * wp.max(wp.dot(towards[k], normal[ray]), 0.0)
        total += weight
        mean += weight * towards[k]
    mean = _unit(mean)
    away = view[ray]
    facing = -wp.dot(relief, away)
    grazing = 1.0 - wp.clamp(facing, 0.0, 1.0)
    squared = grazing * grazing
    out[ray, near_channels] = out.dtype(-wp.dot(smooth, away))
    out[ray, near_channels + 1] = out.dtype(facing)
    out[ray, near_channels + 2] = out.dtype(squared * squared * grazing)
    out[ray, near_channels + 3] = out.dtype(wp.dot(smooth, relief))
    out[ray, near_channels + 4] = out.dtype(total * 4.0 / float(towards.shape[0]))
    out[ray, near_channels + 5] = out.dtype(wp.dot(mean, relief))
    out[ray, near_channels + 6] = out.dtype(-wp.dot(mean, away))


@kernel
@no_type_check
def decode_rays(count: Ints, coefficients: int, raw: Floats2, alpha: Floats, low: Floats2):
    """Fill the decoded channels of rays [R], premultiplied, as `RelightableField.decode`."""
    ray, channel = wp.tid()
    if ray >= count[0]:
        return
    value = raw[ray, channel]
    if channel < coefficients:
        argument = wp.max(value, _LEAST_ARGUMENT)
        value = wp.max(argument, 0.0) + wp.log(1.0 + wp.exp(-wp.abs(argument)))
    low[ray, channel] = value * alpha[ray]


for _kind in (wp.float16, wp.float32):
    wp.overload(decoder_inputs, {"out": wp.array2d(dtype=_kind)})
