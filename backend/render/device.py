"""Which device to compute on."""

from __future__ import annotations

import torch

from ..records.errors import LiveHandError
from .backends import has_numba


def rendering_device(name: str) -> torch.device:
    """Choose as `torch_device`, but `auto` is the CPU if its kernels work: two cores beat torch on a large GPU.

    Raises:
        LiveHandError: a GPU is requested and not available.
    """
    return torch.device("cpu") if name == "auto" and has_numba() else torch_device(name)


def torch_device(name: str) -> torch.device:
    """Return the device named `auto` (CUDA if it is available, else the CPU), `cpu`, `cuda` or `mps`, the GPU of a Mac.

    Raises:
        LiveHandError: a GPU is requested and not available.
    """
    has_cuda = torch.cuda.is_available()
    if name == "auto":
        return torch.device("cuda" if has_cuda else "cpu")
    if name == "cuda" and not has_cuda:
        raise LiveHandError(
            "device 'cuda' needs a CUDA GPU, and a CUDA build of torch or, to render, NVIDIA Warp; "
            "got neither; use 'auto' or 'cpu'"
        )
    if name == "mps" and not torch.backends.mps.is_available():
        raise LiveHandError("device 'mps' needs a Mac with Apple silicon, got none; use 'auto' or 'cpu'")
    return torch.device(name)
