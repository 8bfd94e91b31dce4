"""LPIPS' networks in the user's data folder, once `livehand fetch-perceptual` has brought them; none is ever shipped.

The package holds them as pickles of a JAX network's arrays. They are kept as `NETWORK.safetensors`, with torchvision's
names, and `NETWORK_heads.safetensors`: files as `load_lpips` reads them, for training's options too.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save
from torch import Tensor, nn

from ...motion.plain_pickle import read_plain_pickle
from ...records.errors import LiveHandError
from ...system.files import replacing
from ...system.package_files import LICENCE
from .backbones import layout_of_name
from .lpips import LpipsDistance, RangeMode, load_lpips
from .lpips_package import FETCH_COMMAND, LPIPS_NETWORKS, has_lpips, lpips_files, perceptual_folder

_JAX_NAMES = {"alexnet": "AlexNet_0", "vgg16": "VGG16_0"}


def fetched_lpips(name: str, range_mode: RangeMode = "standard", folder: Path | None = None) -> LpipsDistance:
    """Load LPIPS by a network that has been fetched into a folder (None: the user's).

    Raises:
        LiveHandError: it has not been fetched, or is not the published one.
    """
    paths = lpips_files(name, folder)
    if not has_lpips(name, folder):
        raise LiveHandError(
            f"LPIPS by {name} needs its weights in {paths[0].parent}, got none; fetch them: {FETCH_COMMAND}"
        )
    distance = load_lpips(*paths, range_mode)
    if not distance.is_lpips:
        raise LiveHandError(f"{paths[0]} must hold the published LPIPS, got other weights; fetch it: {FETCH_COMMAND}")
    return distance


def keep_lpips(found: Mapping[str, bytes], folder: Path | None = None) -> Path:
    """Write the networks that were taken out of the package into a folder (None: the user's); returns it.

    Raises:
        LiveHandError: they are not the published ones.
    """
    folder = folder or perceptual_folder()
    with replacing(folder / LICENCE) as temporary:
        temporary.write_bytes(found[LICENCE])
    for name in LPIPS_NETWORKS:
        parts = _torch_tensors(name, read_plain_pickle(found[f"{name}.ckpt"]))
        for path, tensors in zip(lpips_files(name, folder), parts, strict=True):
            with replacing(path) as temporary:
                temporary.write_bytes(save(tensors))
        fetched_lpips(name, folder=folder)
    return folder


def _torch_tensors(name: str, tree: Mapping[str, Any]) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """Name the arrays of a JAX network, kernels [H, W, in, out], as torchvision and the published heads do."""
    layers, layout = tree[_JAX_NAMES[name]], layout_of_name(name)
    indices = [index for index, layer in enumerate(layout.layers) if isinstance(layer, nn.Conv2d)]
    network: dict[str, Tensor] = {}
    for number, index in enumerate(indices):
        layer = layers[f"Conv_{number}"]
        network[f"{index}.weight"] = _tensor(layer["kernel"].transpose(3, 2, 0, 1))
        network[f"{index}.bias"] = _tensor(layer["bias"])
    count = len(layout.channels)
    return network, {f"lin{k}": _tensor(tree[f"NetLinLayer_{k}"]["Conv_0"]["kernel"].ravel()) for k in range(count)}


def _tensor(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values))
