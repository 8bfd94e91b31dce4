"""The perceptual loss of training: L1 between VGG19 features (Johnson et al. 2016; paper section 3.5)."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from ...records.errors import LiveHandError
from .weights import fetch_weights, read_weights

_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
# torchvision's VGG19 up to relu3_4: convolution index in its `features`, channels in and out, pooled before or not.
_LAYERS = (
    (0, 3, 64, False), (2, 64, 64, False), (5, 64, 128, True), (7, 128, 128, False),
    (10, 128, 256, True), (12, 256, 256, False), (14, 256, 256, False), (16, 256, 256, False),
)  # fmt: skip
_COMPARED = (2, 7, 16)  # relu1_2, relu2_2, relu3_4
_MIN_FEATURE = 1e-3  # keeps the quotient finite on an empty image; features are of order 0.1 to 100
VGG19_URL = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"


class PerceptualLoss(nn.Module):
    """Mean absolute difference of VGG19 features at three depths, each relative to the target's mean, summed.

    It is relative because published weights of the same network differ in the scale of their features.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, weights: dict[str, Tensor]):
        super().__init__()
        self.layers = nn.ModuleDict({str(k): nn.Conv2d(a, b, 3, padding=1) for k, a, b, _ in _LAYERS})
        for k, *_ in _LAYERS:
            self.layers[str(k)].load_state_dict({p: weights[f"{k}.{p}"].float() for p in ("weight", "bias")})
        self.register_buffer("mean", torch.tensor(_MEAN)[:, None, None])
        self.register_buffer("std", torch.tensor(_STD)[:, None, None])
        self.requires_grad_(False)

    def forward(self, image: Float[Tensor, "B 3 H W"], target: Float[Tensor, "B 3 H W"]) -> Float[Tensor, ""]:
        """Compute distance of sRGB-encoded images in [0, 1]."""
        pairs = zip(self.features(image), self.features(target), strict=True)
        return torch.stack([(a - b).abs().mean() / (b.mean() + _MIN_FEATURE) for a, b in pairs]).sum()

    def features(self, image: Float[Tensor, "B 3 H W"]) -> list[Tensor]:
        """Compute relu1_2, relu2_2 and relu3_4 of sRGB-encoded images in [0, 1]."""
        hidden, compared = (image - self.mean) / self.std, []
        for k, _, _, is_pooled in _LAYERS:
            hidden = self.layers[str(k)](avg_pool2d(hidden, 2) if is_pooled else hidden).relu()
            if k in _COMPARED:
                compared.append(hidden)
        return compared


def load_vgg_distance(path: Path | None) -> PerceptualLoss:
    """Load the distance with weights from `path` (.safetensors, torchvision's .pth), or torchvision's cache or server.

    Raises:
        LiveHandError: the file does not hold VGG19, or the download failed.
    """
    remedy = "pass --perceptual-weights FILE with it, or train without it: --perceptual 0"
    if path is None:
        weights = fetch_weights(VGG19_URL, f"the perceptual loss needs VGG19's weights; {remedy}")
    else:
        weights = read_weights(path, f"a VGG19 .safetensors or torchvision's .pth ({VGG19_URL})")
    names = [f"{k}.{parameter}" for k, *_ in _LAYERS for parameter in ("weight", "bias")]
    missing = [name for name in names if name not in weights]
    if missing:
        raise LiveHandError(f"perceptual weights must hold VGG19's convolutions, got none named {missing[0]} in {path}")
    try:
        return PerceptualLoss(weights)
    except RuntimeError as error:
        raise LiveHandError(f"perceptual weights must be of VGG19's sizes, got others in {path} ({error})") from error
