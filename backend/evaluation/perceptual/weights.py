"""Reads the weights of networks that LiveHand does not distribute: from the user's file or torchvision's server."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from ...records.errors import LiveHandError


def read_weights(path: Path, wanted: str) -> dict[str, Tensor]:
    """Read a network's tensors by name, from a `.safetensors` or a `.pth`; torchvision's prefix `features.` is dropped.

    Args:
        path: the file.
        wanted: description of the expected file, for the error message.

    Raises:
        LiveHandError: the file is missing or unreadable.
    """
    if not path.is_file():
        raise LiveHandError(f"no perceptual weights at {path}; give {wanted}")
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            return load_file(path)
        state = dict(torch.load(path, weights_only=True, map_location="cpu"))
    except Exception as error:  # readers raise errors of their own kinds
        raise LiveHandError(f"perceptual weights {path} must be readable, got {error}") from error
    return _without_prefix(state)


def fetch_weights(url: str, remedy: str) -> dict[str, Tensor]:
    """Fetch a torchvision checkpoint, from its cache or its download server.

    Raises:
        LiveHandError: the download failed; the message ends in `remedy`.
    """
    cached = Path(torch.hub.get_dir()) / "checkpoints" / url.rsplit("/", 1)[1]
    if cached.is_file():
        return read_weights(cached, url)
    try:
        state = torch.hub.load_state_dict_from_url(url, progress=True, check_hash=True, weights_only=True)
        return _without_prefix(state)
    except (OSError, RuntimeError) as error:  # RuntimeError: another hash than in the file's name
        raise LiveHandError(f"{url} could not be downloaded ({error}); {remedy}") from error


def _without_prefix(state: dict[str, Tensor]) -> dict[str, Tensor]:
    return {key.removeprefix("features."): value for key, value in state.items()}
