"""The three networks whose features LPIPS compares, laid out as torchvision numbers their layers.

Images are [B, 3, H, W], already normalised. Each network returns one map per compared layer, after its ReLU.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ...records.errors import LiveHandError


class Layout(NamedTuple):
    """One network.

    Attributes:
        layers: torchvision's `features` up to the last layer needed.
        compared: indices of the layers whose output is compared.
        channels: of those outputs.
        min_side_px: the smallest image side that leaves at least one pixel in every map.
        file: torchvision's checkpoint; the last part of its name is the start of the file's sha256.
    """

    layers: tuple[nn.Module, ...]
    compared: tuple[int, ...]
    channels: tuple[int, ...]
    min_side_px: int
    file: str

    @property
    def name(self) -> str:
        """Torchvision's name of the network."""
        return self.file.split("-")[0]


class Fire(nn.Module):
    """SqueezeNet's block (Iandola et al. 2016): 1x1 down to `squeeze`, then 1x1 and 3x3 side by side."""

    def __init__(self, inputs: int, squeeze: int, expand: int):
        super().__init__()
        self.squeeze = nn.Conv2d(inputs, squeeze, 1)
        self.expand1x1 = nn.Conv2d(squeeze, expand, 1)
        self.expand3x3 = nn.Conv2d(squeeze, expand, 3, padding=1)

    def forward(self, x: Float[Tensor, "B C H W"]) -> Float[Tensor, "B D H W"]:
        """Compute twice `expand` channels."""
        x = self.squeeze(x).relu()
        return torch.cat([self.expand1x1(x).relu(), self.expand3x3(x).relu()], 1)


class Backbone(nn.Module):
    """A frozen network up to the last compared layer."""

    def __init__(self, layout: Layout, weights: dict[str, Tensor]):
        super().__init__()
        self.layers = nn.ModuleList(layout.layers)
        self.name, self.compared, self.min_side_px = layout.name, layout.compared, layout.min_side_px
        names = self.layers.state_dict().keys()
        self.layers.load_state_dict({name: weights[name].float() for name in names})
        self.requires_grad_(False)

    def forward(self, x: Float[Tensor, "B 3 H W"]) -> list[Tensor]:
        """Compute the compared features.

        Raises:
            LiveHandError: the image is too small for the network.
        """
        if min(x.shape[-2:]) < self.min_side_px:
            size = tuple(x.shape[:-3:-1])
            raise LiveHandError(
                f"this perceptual network needs images of at least {self.min_side_px} px per side, got {size}"
            )
        maps = []
        for index, layer in enumerate(self.layers):
            x = layer(x)
            if index in self.compared:
                maps.append(x)
        return maps


def layout_of_name(name: str) -> Layout:
    """Return the layout of `vgg16`, `alexnet` or `squeezenet1_1`."""
    return next(layout for layout in _layouts() if layout.name == name)


def layout_of(weights: dict[str, Tensor]) -> Layout | None:
    """Recognise the network of these weights, which have torchvision's names; None if it is none of the three."""
    for layout in _layouts():
        expected = nn.ModuleList(layout.layers).state_dict()
        if all(name in weights and weights[name].shape == value.shape for name, value in expected.items()):
            return layout
    return None


def _layouts() -> tuple[Layout, ...]:
    return _vgg16(), _alexnet(), _squeezenet()


def _vgg16() -> Layout:
    layers: list[nn.Module] = []
    inputs = 3
    for channels, count in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        layers += [nn.MaxPool2d(2)] if layers else []
        for _ in range(count):
            layers += [nn.Conv2d(inputs, channels, 3, padding=1), nn.ReLU()]
            inputs = channels
    return Layout(tuple(layers), (3, 8, 15, 22, 29), (64, 128, 256, 512, 512), 16, "vgg16-397923af.pth")


def _alexnet() -> Layout:
    sizes = ((3, 64, 11, 4, 2), (64, 192, 5, 1, 2), (192, 384, 3, 1, 1), (384, 256, 3, 1, 1), (256, 256, 3, 1, 1))
    layers: list[nn.Module] = []
    for index, (inputs, outputs, side, stride, padding) in enumerate(sizes):
        layers += [nn.MaxPool2d(3, 2)] if index in (1, 2) else []
        layers += [nn.Conv2d(inputs, outputs, side, stride, padding), nn.ReLU()]
    return Layout(tuple(layers), (1, 4, 7, 9, 11), (64, 192, 384, 256, 256), 31, "alexnet-owt-7be5be79.pth")


def _squeezenet() -> Layout:
    def pool() -> nn.Module:
        return nn.MaxPool2d(3, 2, ceil_mode=True)

    layers = (
        nn.Conv2d(3, 64, 3, 2), nn.ReLU(), pool(), Fire(64, 16, 64), Fire(128, 16, 64), pool(),
        Fire(128, 32, 128), Fire(256, 32, 128), pool(),
        Fire(256, 48, 192), Fire(384, 48, 192), Fire(384, 64, 256), Fire(512, 64, 256),
    )  # fmt: skip
    compared, channels = (1, 4, 7, 9, 10, 11, 12), (64, 128, 256, 384, 384, 512, 512)
    return Layout(layers, compared, channels, 17, "squeezenet1_1-b8a52dc0.pth")
