"""Reading the weights of others' networks: none are ours to ship, so users name files, or torchvision fetches them."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from ...records.errors import LiveHandError


def read_weights(path: Path, wanted: str) -> dict[str, Tensor]:
    """A network's tensors by name, from a `.safetensors` or a `.pth`; torchvision's prefix `features.` is dropped.

    Args:
        path: the file.
        wanted: what it should be, for the message where it is not there.

    Raises:
        LiveHandError: there is no such file, or it is unreadable.
    """
    if not path.is_file():
        raise LiveHandError(f"no perceptual weights at {path}; give {wanted}")
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            return load_file(path)
        state = dict(torch.load(path, weights_only=True, map_location="cpu"))
    except Exception as error:  # any reader's own kind of error means the same here
        raise LiveHandError(f"perceptual weights {path} must be readable, got {error}") from error
    return _without_prefix(state)


def fetch_weights(url: str, remedy: str) -> dict[str, Tensor]:
    """A torchvision checkpoint, from its cache or its download server.

    Raises:
        LiveHandError: it cannot be had; the message ends in `remedy`.
    """
    cached = Path(torch.hub.get_dir()) / "checkpoints" / url.rsplit("/", 1)[1]
    if cached.is_file():
        return read_weights(cached, url)
    try:
        return _without_prefix(torch.hub.load_state_dict_from_url(url, progress=True, weights_only=True))
    except OSError as error:
        raise LiveHandError(f"{url} could not be downloaded ({error}); {remedy}") from error


def _without_prefix(state: dict[str, Tensor]) -> dict[str, Tensor]:
    return {key.removeprefix("features."): value for key, value in state.items()}
