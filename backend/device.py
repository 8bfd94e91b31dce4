"""Which device to compute on."""

from __future__ import annotations

import importlib.util

import torch

from .errors import LiveHandError


def torch_device(name: str) -> torch.device:
    """The device of a name: `auto` takes CUDA where there is one; `cpu`, `cuda`.

    Raises:
        LiveHandError: CUDA is asked for and not there.
    """
    has_cuda = torch.cuda.is_available()
    if name == "auto":
        return torch.device("cuda" if has_cuda else "cpu")
    if name == "cuda" and not has_cuda:
        raise LiveHandError(
            "device 'cuda' needs a CUDA GPU and a CUDA build of torch, got neither; use 'auto' or 'cpu'"
        )
    return torch.device(name)


def has_kernels(device: torch.device) -> bool:
    """Whether the CPU's kernels can be used: numba is installed and the tensors are on the CPU."""
    return device.type == "cpu" and importlib.util.find_spec("numba") is not None
