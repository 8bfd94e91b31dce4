"""Networks as products of tiles: a decoder's layers, and convolutions, which are nine shifted products.

An image of rows [h * w, C] has a border of a pixel, which `mask` keeps at zero, so that a pixel's neighbour is a row a
fixed number of rows on. Numbers are of half precision, but for those that leave the network; sums are single.
"""

from __future__ import annotations

from typing import Any, no_type_check

import warp as wp

from .compiled import Floats2, Ints, kernel

THREADS = 128
"""That share a tile."""
# Of tensor cores' library: compiling a kernel with it takes minutes.
wp.set_module_options({"enable_mathdx_gemm": False, "block_dim": THREADS})
ROWS, DEPTH, COLUMNS = (wp.constant(value) for value in (64, 32, 64))
"""Of a tile of the result: its rows, what is multiplied at a time, and its columns. Layers are padded to these."""


@kernel
@no_type_check
def multiply_rows(
    limit: Ints,
    first: int,
    shifts: Ints,
    x: wp.array2d(dtype=Any),
    weight: wp.array3d(dtype=Any),
    bias: Floats2,
    mask: Floats2,
    slope: float,
    kept: float,
    y: wp.array2d(dtype=Any),
):
    """Fill rows of y from `first` on, up to row `limit`: sums of products of shifted rows of x, with a leaky ReLU.

    `weight` [taps, C, D] has a matrix for each of `shifts`; `slope` is that of negative numbers, `kept` the share of x
    that is added.
    """
    tile, block = wp.tid()
    row = first + tile * ROWS
    if row >= limit[0]:
        return
    total = wp.tile_zeros(shape=(ROWS, COLUMNS), dtype=wp.float32)
    for tap in range(shifts.shape[0]):
        for chunk in range(weight.shape[1] / DEPTH):
            rows = wp.tile_load(x, shape=(ROWS, DEPTH), offset=(row + shifts[tap], chunk * DEPTH))
            columns = wp.tile_load(weight, shape=(1, DEPTH, COLUMNS), offset=(tap, chunk * DEPTH, block * COLUMNS))
            wp.tile_matmul(rows, wp.tile_squeeze(columns), total)
    own = wp.tile_load(bias, shape=(1, COLUMNS), offset=(0, block * COLUMNS))
    straight = total + wp.tile_broadcast(own, shape=(ROWS, COLUMNS))
    bent = wp.tile_map(wp.max, straight, straight * slope)
    before = wp.tile_load(x, shape=(ROWS, COLUMNS), offset=(row, block * COLUMNS))
    result = bent + wp.tile_astype(before, dtype=wp.float32) * kept
    inside = wp.tile_load(mask, shape=(ROWS, 1), offset=(row, 0))
    shown = wp.tile_map(wp.mul, result, wp.tile_broadcast(inside, shape=(ROWS, COLUMNS)))
    wp.tile_store(y, wp.tile_astype(shown, dtype=y.dtype), offset=(row, block * COLUMNS))


for _kind in (wp.float16, wp.float32):
    _arrays = {"x": wp.array2d(dtype=wp.float16), "weight": wp.array3d(dtype=wp.float16), "y": wp.array2d(dtype=_kind)}
    wp.overload(multiply_rows, _arrays)
