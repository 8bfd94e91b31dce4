"""Which device to compute on."""

from __future__ import annotations

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
