"""LPIPS version 0.1 (Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric").

Features of a backbone are normalised over channels; their squared differences are weighted by the published linear
heads, averaged over the image and summed over the layers. The weights are not distributed with LiveHand: users fetch
them (`fetched`) or supply the files.

The result is LPIPS only with the published heads and torchvision's backbone, on which they were fitted, as
`LpipsDistance.is_lpips` tells. With other files it is an uncalibrated perceptual distance.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ...records.errors import LiveHandError
from .backbones import Backbone, Layout, layout_of
from .weights import read_weights

RangeMode = Literal["standard", "reference"]
"""`standard`: images are mapped to [-1, 1], on which the heads were fitted. `reference`: images stay in [0, 1], as in
the code of the paper's authors, whose published figures compare only with this mode."""

# ImageNet's mean and deviation for images in [-1, 1], rounded as in the published network.
_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
# Added to a feature's squared length, so that a pixel without features has finite gradients.
_MIN_SQUARED = 1e-10
# sha256, first digits, of the published values in order, float32: of the heads, and of torchvision's networks.
_HEADS = {"vgg16": "9153a204", "alexnet": "718a8b40", "squeezenet1_1": "68f1b175"}
_NETWORKS = {"vgg16": "40acdda7c6b05249", "alexnet": "2b566cc3a4d6f0a7"}
_FILES = (
    "torchvision's vgg16-397923af.pth, alexnet-owt-7be5be79.pth or squeezenet1_1-b8a52dc0.pth "
    "(https://download.pytorch.org/models/)"
)
_HEAD_FILES = "the LPIPS v0.1 linear heads of the same network (vgg.pth, alex.pth or squeeze.pth of the lpips package)"


class LpipsDistance(nn.Module):
    """The distance of two images, differentiable with respect to both."""

    shift: Tensor
    scale: Tensor

    def __init__(self, backbone: Backbone, heads: list[Tensor], is_lpips: bool, range_mode: RangeMode = "standard"):
        super().__init__()
        self.backbone, self.is_lpips, self.range_mode = backbone, is_lpips, range_mode
        for index, head in enumerate(heads):
            self.register_buffer(f"head{index}", head.float().reshape(1, -1, 1, 1))
        self.register_buffer("shift", torch.tensor(_SHIFT)[:, None, None])
        self.register_buffer("scale", torch.tensor(_SCALE)[:, None, None])

    @property
    def column(self) -> str:
        """The name in tables: `lpips` by AlexNet, `lpips_NETWORK` by others, `uncalibrated` with other weights."""
        if not self.is_lpips:
            return "uncalibrated"
        return "lpips" if self.backbone.name == "alexnet" else f"lpips_{self.backbone.name}"

    def forward(self, image: Float[Tensor, "B 3 H W"], target: Float[Tensor, "B 3 H W"]) -> Float[Tensor, ""]:
        """Compute mean distance over the batch of sRGB-encoded images in [0, 1]."""
        pairs = zip(self._features(image), self._features(target), strict=True)
        heads = (getattr(self, f"head{index}") for index in range(len(self.backbone.compared)))
        layers = [(head * (a - b) ** 2).sum(1).mean() for head, (a, b) in zip(heads, pairs, strict=True)]
        return torch.stack(layers).sum()

    def _features(self, image: Tensor) -> list[Tensor]:
        ranged = 2 * image - 1 if self.range_mode == "standard" else image
        return [_unit(values.float()) for values in self.backbone((ranged - self.shift) / self.scale)]


def load_lpips(weights_path: Path | None, heads_path: Path | None, range_mode: RangeMode = "standard") -> LpipsDistance:
    """Load the distance by the network in `weights_path` (VGG16, AlexNet or SqueezeNet 1.1) and its heads.

    Raises:
        LiveHandError: a file is not given, missing, or of another network.
    """
    if weights_path is None or heads_path is None:
        raise LiveHandError(
            f"LPIPS needs two files, got {weights_path} and {heads_path}; give {_FILES}, and {_HEAD_FILES}"
        )
    weights = read_weights(weights_path, _FILES)
    layout = layout_of(weights)
    if layout is None:
        raise LiveHandError(f"LPIPS needs {_FILES}, got another network in {weights_path}")
    heads = _read_heads(heads_path, layout)
    is_lpips = _is_torchvisions(weights_path, weights, layout) and _digest(heads).startswith(_HEADS[layout.name])
    return LpipsDistance(Backbone(layout, weights), heads, is_lpips, range_mode)


def _read_heads(path: Path, layout: Layout) -> list[Tensor]:
    """Read one weight per channel of each compared layer, named `lin0` or, as published, `lin0.model.1.weight`."""
    tensors = {key.split(".")[0]: value for key, value in read_weights(path, _HEAD_FILES).items()}
    heads = [tensors.get(f"lin{index}", torch.empty(0)).flatten() for index in range(len(layout.channels))]
    sizes = tuple(len(head) for head in heads)
    if sizes != layout.channels or len(tensors) != len(heads):
        expected = f"{layout.channels} weights, as {layout.name} has channels"
        raise LiveHandError(f"LPIPS heads {path} must hold {expected}, got {sizes}; give {_HEAD_FILES}")
    return heads


def _is_torchvisions(path: Path, weights: dict[str, Tensor], layout: Layout) -> bool:
    """Tell whether the values are those of torchvision's file, or the file is that one: its name has its sha256."""
    names = nn.ModuleList(layout.layers).state_dict()
    if layout.name in _NETWORKS and _digest([weights[name] for name in names]).startswith(_NETWORKS[layout.name]):
        return True
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return digest.startswith(Path(layout.file).stem.rsplit("-", 1)[1])


def _digest(values: list[Tensor]) -> str:
    return hashlib.sha256(torch.cat([value.flatten() for value in values]).float().numpy().tobytes()).hexdigest()


def _unit(features: Tensor) -> Tensor:
    return features / ((features**2).sum(1, keepdim=True) + _MIN_SQUARED).sqrt()
