"""Super-resolution: low-resolution colour, features and alpha -> RGBA at twice the size (paper section 3.4).

Images [B, C, H, W]; colour sRGB-encoded and premultiplied by alpha, as everywhere before the frame is developed. The
pixel grids share their corners: low-resolution pixel (i, j) covers the full-resolution pixels 2i..2i+1, 2j..2j+1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import conv2d, interpolate, leaky_relu, pixel_shuffle

from ..field.field import CHANNELS
from ..light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES, SMOOTH

RGBA = 4
_BINOMIAL = (1.0, 2.0, 1.0)
RELIGHTABLE_MAPS = COEFFICIENTS + RELIGHTABLE_FEATURES + 3 + 1
"""Maps that `RelightableSuperRes` takes, premultiplied: coefficients, features, relief normal in camera axes, alpha."""
RELIGHTABLE_DETAIL = COEFFICIENTS - SMOOTH + 3 + 1
"""Channels that it returns: coefficients but the smooth ones, normal in camera axes, alpha."""


@dataclass(frozen=True)
class SuperResConfig:
    """Which network, and its size."""

    kind: Literal["paper", "light", "lit", "bilinear", "none"] = "light"
    """`paper`: the published blocks, 128 and 64 wide, with their constant modulation folded in. `light`: plain
    convolutions at low resolution and a pixel shuffle. `lit`: the same for the coefficients of a relightable field.
    Ablations: `bilinear` enlarges and learns nothing; `none` asks the field at every pixel of the image."""
    width: int = 64
    """Of `light` and `lit`."""
    depth: int = 4
    """Convolutions of `light` and `lit` before the last."""
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Colour gain applied after the network: that of a training camera whose colours the avatar reproduces."""
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Added to the colour, times alpha."""

    @property
    def scale(self) -> int:
        """Pixels of the image per ray, along each side."""
        return 1 if self.kind == "none" else 2


def build_superres(config: SuperResConfig) -> nn.Module:
    """Build the network that the configuration names, with fresh weights."""
    networks: dict[str, Callable[[SuperResConfig], nn.Module]] = {
        "paper": PaperSuperRes,
        "light": SmallSuperRes,
        "lit": RelightableSuperRes,
        "bilinear": BilinearSuperRes,
        "none": NoSuperRes,
    }
    return networks[config.kind](config)


class BilinearSuperRes(nn.Module):
    """Enlarges colour and alpha; it has no parameters."""

    def __init__(self, config: SuperResConfig):
        super().__init__()
        self.config = config

    def forward(self, maps: Float[Tensor, "B 33 H W"]) -> Float[Tensor, "B 4 2*H 2*W"]:
        """Compute RGBA."""
        return _graded(enlarge(_rgba(maps)), self.config)


class NoSuperRes(nn.Module):
    """Colour and alpha of rays through every pixel, as they are."""

    def __init__(self, config: SuperResConfig):
        super().__init__()
        self.config = config

    def forward(self, maps: Float[Tensor, "B 33 H W"]) -> Float[Tensor, "B 4 H W"]:
        """Compute RGBA."""
        return _graded(_rgba(maps), self.config)


class ResidualSuperRes(nn.Module):
    """Convolutions at low resolution, shuffled up, whose result is added to what is enlarged bilinearly."""

    def __init__(self, config: SuperResConfig, maps: int, channels: int):
        super().__init__()
        self.config = config
        self.head = nn.Conv2d(maps, config.width, 3, padding=1)
        self.body = nn.ModuleList(nn.Conv2d(config.width, config.width, 3, padding=1) for _ in range(config.depth - 1))
        self.tail = nn.Conv2d(config.width, channels * 4, 3, padding=1)
        for parameter in self.tail.parameters():
            nn.init.zeros_(parameter)  # start as bilinear enlargement

    def forward(self, maps: Float[Tensor, "B C H W"]) -> Float[Tensor, "B D 2*H 2*W"]:
        """Compute the maps at twice the size."""
        return self.added(maps, self.residual(maps))

    def added(self, maps: Tensor, residual: Tensor) -> Tensor:
        """Combine the maps with their residual."""
        raise NotImplementedError

    def residual(self, maps: Float[Tensor, "B C H W"]) -> Float[Tensor, "B D 2*H 2*W"]:
        """Compute the residual that the convolutions add."""
        hidden = leaky_relu(self.head(maps), 0.2, inplace=True)
        for layer in self.body:
            hidden = _sum(leaky_relu(layer(hidden), 0.2, inplace=True), hidden)
        return pixel_shuffle(conv2d(hidden, *self.even_tail(), padding=1), 2)

    def even_tail(self) -> tuple[Float[Tensor, "F W 3 3"], Float[Tensor, " F"]]:
        """Return weight and bias of the last convolution, whose four pixels are equal wherever its input is even.

        The learnt ones are so only nearly, which shows on smooth skin as a lattice of two pixels. The four pixels' sums
        over the window are made equal by what they differ from their mean, in binomial shares.
        """
        assert self.tail.bias is not None
        weight, bias = self.tail.weight.unflatten(0, (-1, 4)), self.tail.bias.unflatten(0, (-1, 4))
        sums = weight.sum((3, 4), keepdim=True)
        share = weight.new_tensor(_BINOMIAL) / 4
        even = weight - (sums - sums.mean(1, keepdim=True)) * share[:, None] * share
        return even.flatten(0, 1), bias.mean(1, keepdim=True).expand_as(bias).flatten()


class SmallSuperRes(ResidualSuperRes):
    """Enlarges colour and alpha."""

    def __init__(self, config: SuperResConfig):
        super().__init__(config, CHANNELS + 1, RGBA)

    def added(self, maps: Float[Tensor, "B 33 H W"], residual: Float[Tensor, "B 4 2*H 2*W"]) -> Tensor:
        """Combine the maps with their residual into RGBA, not clamped."""
        return _graded(_sum(enlarge(_rgba(maps)), residual), self.config)


class RelightableSuperRes(ResidualSuperRes):
    """Detail of a relightable hand in no light; `image.shading.detailed` adds it to the enlarged maps."""

    def __init__(self, config: SuperResConfig):
        super().__init__(config, RELIGHTABLE_MAPS, RELIGHTABLE_DETAIL)

    def added(self, maps: Float[Tensor, "B 34 H W"], residual: Float[Tensor, "B 12 2*H 2*W"]) -> Tensor:
        """Compute what is added to the straight coefficients after the first `SMOOTH`, to the normal and to alpha."""
        return residual


class PaperSuperRes(nn.Module):
    """The published two blocks (32 -> 128 -> 128, up, 128 -> 64 -> 64) as plain convolutions, with alpha.

    In the published code the styles of the modulated convolutions come from a vector of ones: they are constants, and
    folding them in leaves 295,878 of 320,906 parameters and the same functions; the fourth output adds 194.
    """

    def __init__(self, config: SuperResConfig):
        super().__init__()
        self.config = config
        self.low = nn.ModuleList([nn.Conv2d(CHANNELS, 128, 3, padding=1), nn.Conv2d(128, 128, 3, padding=1)])
        self.low_rgba = nn.Conv2d(128, RGBA, 1)
        self.high = nn.ModuleList([nn.Conv2d(128, 64, 3, padding=1), nn.Conv2d(64, 64, 3, padding=1)])
        self.high_rgba = nn.Conv2d(64, RGBA, 1)
        for parameter in (*self.low_rgba.parameters(), *self.high_rgba.parameters()):
            nn.init.zeros_(parameter)

    def forward(self, maps: Float[Tensor, "B 33 H W"]) -> Float[Tensor, "B 4 2*H 2*W"]:
        """Compute RGBA, not clamped."""
        hidden = maps[:, :CHANNELS]
        for layer in self.low:
            hidden = leaky_relu(layer(hidden), 0.2, inplace=True)
        low = _rgba(maps) + self.low_rgba(hidden)
        hidden = enlarge(hidden)
        for layer in self.high:
            hidden = leaky_relu(layer(hidden), 0.2, inplace=True)
        return _graded(enlarge(low) + self.high_rgba(hidden), self.config)


def enlarge(image: Float[Tensor, "B C H W"]) -> Float[Tensor, "B C 2*H 2*W"]:
    """Enlarge bilinearly, with the grids' corners aligned."""
    return interpolate(image, scale_factor=2, mode="bilinear", align_corners=False)


def _sum(a: Tensor, b: Tensor) -> Tensor:
    """Add both; in place of `a` if there is no gradient, because new memory costs as much as the convolutions."""
    return a + b if torch.is_grad_enabled() else a.add_(b)


def _graded(rgba: Float[Tensor, "B 4 H W"], config: SuperResConfig) -> Float[Tensor, "B 4 H W"]:
    """Apply the configured gain and bias to the premultiplied picture."""
    if config.gain == (1, 1, 1) and config.bias == (0, 0, 0):
        return rgba
    gain, bias = (rgba.new_tensor(values)[:, None, None] for values in (config.gain, config.bias))
    return torch.cat([gain * rgba[:, :3] + bias * rgba[:, 3:], rgba[:, 3:]], 1)


def _rgba(maps: Tensor) -> Tensor:
    """Take colour and alpha of the stack [colour 3, features 29, alpha 1]."""
    return torch.cat([maps[:, :3], maps[:, CHANNELS:]], 1)
