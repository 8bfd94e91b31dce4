"""How Warp's kernels are declared, and the arrays that they take.

What changes from frame to frame is read from arrays and is no argument by value, which a recorded sequence would keep:
cameras, scales and counts. By value are the sizes of images and lists, by which buffers are made.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import warp as wp

wp.config.log_level = logging.WARNING  # standard output belongs to the results of commands

Floats, Floats2, Floats3, Floats4 = (wp.array(dtype=wp.float32, ndim=axes) for axes in (1, 2, 3, 4))
Ints, Ints2, Ints3 = (wp.array(dtype=wp.int32, ndim=axes) for axes in (1, 2, 3))
Longs, Longs2 = wp.array(dtype=wp.int64), wp.array2d(dtype=wp.int64)
Vectors, Vectors2, Matrices = wp.array(dtype=wp.vec3), wp.array2d(dtype=wp.vec3), wp.array(dtype=wp.mat33)
Bytes, Bytes2 = wp.array(dtype=wp.int8), wp.array2d(dtype=wp.int8)
Bools, Bools2, Keys = wp.array(dtype=wp.bool), wp.array2d(dtype=wp.bool), wp.array(dtype=wp.uint64)

INFINITE_BITS = 0x7F800000
"""Of the float infinity, as an int32: bits of positive floats are in the order of their values."""


def kernel(function: Callable[..., None]) -> wp.Kernel:
    """Declare a kernel, without gradients; its types are Warp's, `no_type_check` keeps others from reading them."""
    return wp.kernel(function, enable_backward=False)


def part(function: Callable[..., Any]) -> wp.Function:
    """Declare a function that kernels call; as `kernel`."""
    return wp.func(function)
