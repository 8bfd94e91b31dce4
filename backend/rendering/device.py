"""Which device to compute on."""

from __future__ import annotations

import logging
from functools import cache
from importlib import import_module

import torch

from ..records.errors import LiveHandError

LOGGER = logging.getLogger(__name__)


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
    """Whether the CPU's kernels can be used: the tensors are on the CPU, and numba is installed and works."""
    return device.type == "cpu" and has_numba()


@cache
def has_numba() -> bool:
    """Whether numba can be imported: it refuses a numpy newer than it knows, with which torch alone still renders."""
    try:
        import_module("numba")
    except ModuleNotFoundError:
        return False
    except Exception as error:  # whatever breaks it, the picture can still be made
        LOGGER.warning("numba is installed but fails (%s); rendering goes on without it, many times slower", error)
        return False
    return True
