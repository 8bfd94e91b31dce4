"""Which device to compute on."""

from __future__ import annotations

import torch

from ..records.errors import LiveHandError


def torch_device(name: str) -> torch.device:
    """The device named `auto` (CUDA if it is available), `cpu` or `cuda`.

    Raises:
        LiveHandError: CUDA is requested and not available.
    """
    has_cuda = torch.cuda.is_available()
    if name == "auto":
        return torch.device("cuda" if has_cuda else "cpu")
    if name == "cuda" and not has_cuda:
        raise LiveHandError(
            "device 'cuda' needs a CUDA GPU and a CUDA build of torch, got neither; use 'auto' or 'cpu'"
        )
    return torch.device(name)
