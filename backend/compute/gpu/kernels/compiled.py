"""How Warp's kernels are declared, the arrays that they take, and their launch on torch's tensors.

What changes from frame to frame is read from arrays and is no argument by value, which a recorded sequence would keep:
cameras, scales and counts. By value are the sizes of images and lists, by which buffers are made.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any

import torch
import warp as wp
from torch import Tensor

wp.config.log_level = logging.WARNING  # standard output belongs to the results of commands

Floats, Floats2, Floats3, Floats4 = (wp.array(dtype=wp.float32, ndim=axes) for axes in (1, 2, 3, 4))
Ints, Ints2, Ints3 = (wp.array(dtype=wp.int32, ndim=axes) for axes in (1, 2, 3))
Longs, Longs2 = wp.array(dtype=wp.int64), wp.array2d(dtype=wp.int64)
Pairs = wp.array(dtype=wp.vec2)
Vectors, Vectors2, Matrices = wp.array(dtype=wp.vec3), wp.array2d(dtype=wp.vec3), wp.array(dtype=wp.mat33)
Bytes, Bytes2 = wp.array(dtype=wp.int8), wp.array2d(dtype=wp.int8)
Bools, Bools2, Keys = wp.array(dtype=wp.bool), wp.array2d(dtype=wp.bool), wp.array(dtype=wp.uint64)

INFINITE_BITS = 0x7F800000
"""Of the float infinity, as an int32: bits of positive floats are in the order of their values."""


def kernel(function: Callable[..., None]) -> Any:
    """Declare a kernel, without gradients; its types are Warp's, `no_type_check` keeps others from reading them."""
    return wp.kernel(function, enable_backward=False)


def part(function: Callable[..., Any]) -> Any:
    """Declare a function that kernels call; as `kernel`."""
    return wp.func(function)


COUNT = "count"
"""The argument of kernels that stop after as many elements as a number on the device says."""

Argument = Tensor | float | int | bool


def launch(kernel: Any, dim: int | tuple[int, ...], *arguments: Argument) -> None:
    """Run a kernel for every element of `dim`; its arrays are the tensors' own memory, which they must fill densely.

    Args:
        kernel: of `kernels`; one whose first argument is `count` runs for all of `dim`.
        dim: number of threads, along each axis.
        arguments: as the kernel takes them, without `count`; tensors of one device. What it writes must be contiguous.
    """
    device = next(value.device for value in arguments if isinstance(value, Tensor))
    if kernel.adj.args[0].label == COUNT:
        arguments = unlimited(device), *arguments
    given = [
        _as_array(value, argument.type) if isinstance(value, Tensor) else value
        for value, argument in zip(arguments, kernel.adj.args, strict=True)
    ]
    if device.type == "cuda":
        wp.launch(kernel, dim, given, stream=_stream(torch.cuda.current_stream(device)))
    else:
        wp.launch(kernel, dim, given, device="cpu")


def lanes_of(device: torch.device) -> int:
    """Return how many threads share the pixels of a face of the hand's own mesh: those of a warp, or one on the CPU."""
    return 32 if device.type == "cuda" else 1


@cache
def unlimited(device: torch.device) -> Tensor:
    """Return the count [1] of a kernel that stops after none."""
    return torch.full((1,), torch.iinfo(torch.int32).max, dtype=torch.int32, device=device)


def _as_array(values: Tensor, kind: wp.array) -> object:
    """Describe a tensor's memory, or that of its copy in single precision if networks have left it in half."""
    exact = values.float() if values.dtype in (torch.bfloat16, torch.float16) else values
    return wp.from_torch(exact.detach().contiguous(), dtype=kind.dtype, requires_grad=False, return_ctype=True)


@lru_cache(maxsize=8)
def _stream(stream: torch.cuda.Stream) -> wp.Stream:
    return wp.stream_from_torch(stream)
