"""Launches of Warp's kernels on torch's tensors, on the device and in the stream in which torch computes."""

from __future__ import annotations

from functools import lru_cache

import torch
import warp as wp
from torch import Tensor

Argument = Tensor | float | int | bool


def launch(kernel: wp.Kernel, dim: int | tuple[int, ...], *arguments: Argument) -> None:
    """Run a kernel for every element of `dim`; its arrays are the tensors' own memory, which they must fill densely.

    Args:
        kernel: of `kernels`.
        dim: number of threads, along each axis.
        arguments: as the kernel takes them; tensors of one device. What it writes must be contiguous.
    """
    device = next(value.device for value in arguments if isinstance(value, Tensor))
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


def _as_array(values: Tensor, kind: wp.array) -> object:
    return wp.from_torch(values.detach().contiguous(), dtype=kind.dtype, requires_grad=False, return_ctype=True)


@lru_cache(maxsize=8)
def _stream(stream: torch.cuda.Stream) -> wp.Stream:
    return wp.stream_from_torch(stream)
